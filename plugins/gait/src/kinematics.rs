//! A leg of three revolute joints: forward kinematics, Jacobian and inverse kinematics in the base frame.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use vocaloco_plugin_api::{ErrorCode, RobotDescription, SkillError};

/// Distance kept from the joints' limits and from the straight leg.
const LIMIT_MARGIN_RAD: f64 = 0.03;
const STRAIGHTEST: f64 = 0.985;
const NEWTON_STEPS: usize = 8;

/// A link of a leg: its joint, and the mass behind it.
#[derive(Clone, Debug)]
struct Segment {
    origin: Vector3<f64>,
    axis: Unit<Vector3<f64>>,
    lower: f64,
    upper: f64,
    mass_kg: f64,
    com: Vector3<f64>,
}

/// One leg, from the base to its foot.
#[derive(Clone, Debug)]
pub(crate) struct Leg {
    /// Index of each joint in the robot's order, from the base outwards.
    pub(crate) joints: [usize; 3],
    segments: [Segment; 3],
    foot: Vector3<f64>,
    /// Radius of the foot, m.
    pub(crate) foot_radius_m: f64,
    /// Joint positions in the stand, rad.
    pub(crate) stand: Vector3<f64>,
    reach_m: f64,
}

/// Where a leg's foot is and how it moves with the joints, in the base frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FootPose {
    /// Centre of the foot, m.
    pub(crate) position: Vector3<f64>,
    /// ∂position/∂q, m/rad.
    pub(crate) jacobian: Matrix3<f64>,
    /// Mass of the leg, kg, times its centre of mass, m.
    pub(crate) mass_moment: Vector3<f64>,
    /// ∂(mass moment)/∂q.
    pub(crate) mass_jacobian: Matrix3<f64>,
}

impl Leg {
    /// The legs of a robot, in the order of its feet.
    ///
    /// # Errors
    /// When a foot does not hang on exactly three joints.
    pub(crate) fn of(robot: &RobotDescription) -> Result<Vec<Self>, SkillError> {
        robot
            .feet
            .iter()
            .map(|foot| {
                let mut chain = Vec::new();
                let mut next = i32::try_from(foot.joint).unwrap_or(-1);
                while let Some(joint) = usize::try_from(next).ok().and_then(|index| robot.joints.get(index)) {
                    chain.insert(0, next as usize);
                    next = joint.parent;
                }
                let joints: [usize; 3] = chain.try_into().map_err(|chain: Vec<usize>| {
                    SkillError::new(
                        ErrorCode::Robot,
                        format!(
                            "robot {}: foot {}: found {} joints to the base, wanted 3",
                            robot.name,
                            foot.name,
                            chain.len(),
                        ),
                    )
                })?;
                let segments = joints.map(|index| {
                    let joint = &robot.joints[index];
                    Segment {
                        origin: joint.origin_in_parent_m.into(),
                        axis: Unit::new_normalize(joint.axis.into()),
                        lower: joint.lower_rad,
                        upper: joint.upper_rad,
                        mass_kg: joint.mass_kg,
                        com: joint.com_in_link_m.into(),
                    }
                });
                let foot_in_link = Vector3::from(foot.centre_in_link_m);
                Ok(Self {
                    joints,
                    // Hip to knee and knee to foot, both in the plane of the leg.
                    reach_m: STRAIGHTEST * (segments[2].origin.xz().norm() + foot_in_link.xz().norm()),
                    stand: joints.map(|index| robot.joints[index].stand_rad).into(),
                    segments,
                    foot: foot_in_link,
                    foot_radius_m: foot.radius_m,
                })
            })
            .collect()
    }

    /// Mass of the leg, kg.
    pub(crate) fn mass_kg(&self) -> f64 {
        self.segments.iter().map(|segment| segment.mass_kg).sum()
    }

    /// Origin of the second joint with the first at zero: what the leg hangs from.
    pub(crate) fn hip(&self) -> Vector3<f64> {
        self.segments[0].origin + self.segments[1].origin
    }

    /// Lateral distance from the second joint to the foot with the first joint at zero.
    pub(crate) fn lateral_m(&self) -> f64 {
        self.segments[2].origin.y + self.foot.y
    }

    /// Position and Jacobian of the foot at joint positions `q`.
    pub(crate) fn pose(&self, q: &Vector3<f64>) -> FootPose {
        let mut rotation = Rotation3::identity();
        let mut origin = Vector3::zeros();
        let mut axes = [Vector3::zeros(); 3];
        let mut origins = [Vector3::zeros(); 3];
        let mut coms = [Vector3::zeros(); 3];
        for (index, segment) in self.segments.iter().enumerate() {
            origin += rotation * segment.origin;
            axes[index] = rotation * segment.axis.into_inner();
            origins[index] = origin;
            rotation *= rotation_about(&segment.axis, q[index]);
            coms[index] = origin + rotation * segment.com;
        }
        let position = origin + rotation * self.foot;
        let mut jacobian = Matrix3::zeros();
        let mut mass_jacobian = Matrix3::zeros();
        let mut mass_moment = Vector3::zeros();
        for joint in 0..3 {
            jacobian.set_column(joint, &axes[joint].cross(&(position - origins[joint])));
            mass_moment += self.segments[joint].mass_kg * coms[joint];
            let mut column = Vector3::zeros();
            for (segment, com) in self.segments.iter().zip(&coms).skip(joint) {
                column += segment.mass_kg * axes[joint].cross(&(com - origins[joint]));
            }
            mass_jacobian.set_column(joint, &column);
        }
        FootPose { position, jacobian, mass_moment, mass_jacobian }
    }

    /// Joint positions that put the foot's centre at `target` (base frame), or as near as the reach
    /// and the joints' limits allow, searched from `start` by damped Newton steps.
    pub(crate) fn inverse(&self, target: &Vector3<f64>, start: &Vector3<f64>) -> Vector3<f64> {
        let target = self.within_reach(target);
        let mut q = *start;
        for _ in 0..NEWTON_STEPS {
            let pose = self.pose(&q);
            let error = target - pose.position;
            if error.norm_squared() < 1e-10 {
                break;
            }
            let transposed = pose.jacobian.transpose();
            let damped = pose.jacobian * transposed + Matrix3::identity() * 1e-5;
            let Some(inverse) = damped.try_inverse() else { break };
            let step = transposed * (inverse * error);
            for joint in 0..3 {
                let segment = &self.segments[joint];
                q[joint] = (q[joint] + step[joint].clamp(-0.5, 0.5))
                    .clamp(segment.lower + LIMIT_MARGIN_RAD, segment.upper - LIMIT_MARGIN_RAD);
            }
        }
        q
    }

    /// From [`Leg::hip`] to the centre of the foot with the leg as straight as it gets, m.
    pub(crate) fn longest_m(&self) -> f64 {
        let lateral = self.lateral_m();
        // The first joint is near the second, so the distance from their common place bounds the leg.
        (self.reach_m * self.reach_m + lateral * lateral).sqrt()
    }

    fn within_reach(&self, target: &Vector3<f64>) -> Vector3<f64> {
        let hip = self.hip();
        let offset = target - hip;
        let longest = self.longest_m();
        let length = offset.norm();
        if length > longest { hip + offset * (longest / length) } else { *target }
    }
}

/// Rotation about an axis by an angle, with `libm`, so that it is the same on every machine.
fn rotation_about(axis: &Unit<Vector3<f64>>, angle: f64) -> Rotation3<f64> {
    let (sin, cos) = (libm::sin(angle), libm::cos(angle));
    let cross = axis.cross_matrix();
    Rotation3::from_matrix_unchecked(Matrix3::identity() + cross * sin + cross * cross * (1.0 - cos))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_robot::quadruped;

    #[test]
    fn inverse_finds_the_joints_that_forward_came_from() {
        for leg in &Leg::of(&quadruped()).unwrap() {
            let q = leg.stand + Vector3::new(0.1, -0.2, 0.15);
            let found = leg.inverse(&leg.pose(&q).position, &leg.stand);
            assert!((found - q).norm() < 1e-4, "found {found}, wanted {q}");
        }
    }

    #[test]
    fn the_jacobian_is_the_derivative_of_the_position() {
        let leg = &Leg::of(&quadruped()).unwrap()[1];
        let q = leg.stand + Vector3::new(-0.1, 0.2, -0.3);
        let pose = leg.pose(&q);
        for joint in 0..3 {
            let mut moved = q;
            moved[joint] += 1e-6;
            let ahead = leg.pose(&moved);
            let slope = (ahead.position - pose.position) / 1e-6;
            assert!((slope - pose.jacobian.column(joint)).norm() < 1e-5);
            let slope = (ahead.mass_moment - pose.mass_moment) / 1e-6;
            assert!((slope - pose.mass_jacobian.column(joint)).norm() < 1e-4);
        }
    }

    #[test]
    fn a_target_out_of_reach_gives_a_finite_pose_inside_the_limits() {
        let leg = &Leg::of(&quadruped()).unwrap()[0];
        let q = leg.inverse(&Vector3::new(2.0, 1.0, -3.0), &leg.stand);
        assert!(q.iter().all(|value| value.is_finite()));
    }
}
