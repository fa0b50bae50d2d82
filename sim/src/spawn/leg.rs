//! One leg's joints, from the base to its foot, and the positions that bring the foot somewhere.

use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3};
use vocaloco_plugin_api::{JointDescription, RobotDescription};

/// A leg of any number of joints.
#[derive(Clone, Debug)]
pub(super) struct Leg {
    /// Index and description of each joint, the base's first.
    joints: Vec<(usize, JointDescription)>,
    foot_in_link_m: Vector3<f64>,
    radius_m: f64,
    stand_in_base: Vector3<f64>,
}

/// Farther than this from the foot's goal is not there, m.
const TOLERANCE_M: f64 = 1e-3;
const ROUNDS: usize = 60;
/// Keeps a step finite where the leg is straight, m².
const DAMPING_M2: f64 = 1e-5;

impl Leg {
    pub(super) fn new(robot: &RobotDescription, foot: usize) -> Self {
        let foot = &robot.feet[foot];
        let mut joints = Vec::new();
        let mut next = i32::try_from(foot.joint).ok();
        while let Some(index) = next.and_then(|index| usize::try_from(index).ok()) {
            joints.push((index, robot.joints[index].clone()));
            next = Some(robot.joints[index].parent);
        }
        joints.reverse();
        let mut leg = Self {
            joints,
            foot_in_link_m: Vector3::from(foot.centre_in_link_m),
            radius_m: foot.radius_m,
            stand_in_base: Vector3::zeros(),
        };
        let stand_rad: Vec<f64> = leg.joints.iter().map(|(_, joint)| joint.stand_rad).collect();
        leg.stand_in_base = leg.foot_and_jacobian(&stand_rad).0;
        leg
    }

    /// Centre of the foot in the stand, base frame.
    pub(super) fn stand_in_base(&self) -> Vector3<f64> {
        self.stand_in_base
    }

    pub(super) fn radius_m(&self) -> f64 {
        self.radius_m
    }

    /// Writes this leg's joint positions into `joint_position_rad`, so that the foot's centre is at
    /// `foot_in_base`; `None` where it cannot get there within its joints' ranges.
    ///
    /// Damped least squares from where the joints are: Δq = Jᵀ(JJᵀ + λ)⁻¹·e.
    pub(super) fn reach(&self, foot_in_base: Vector3<f64>, joint_position_rad: &mut [f64]) -> Option<()> {
        let mut position: Vec<f64> =
            self.joints.iter().map(|(index, _)| joint_position_rad[*index]).collect();
        for _ in 0..ROUNDS {
            let (foot, jacobian) = self.foot_and_jacobian(&position);
            let error = foot_in_base - foot;
            if error.norm() < 0.1 * TOLERANCE_M {
                break;
            }
            let mut square = Matrix3::identity() * DAMPING_M2;
            for column in &jacobian {
                square += column * column.transpose();
            }
            let step = square.try_inverse()? * error;
            for ((q, column), (_, joint)) in position.iter_mut().zip(&jacobian).zip(&self.joints) {
                *q = (*q + column.dot(&step)).clamp(joint.lower_rad, joint.upper_rad);
            }
        }
        // Phrased as "is inside", so that a foot at NaN is not there.
        let there = (foot_in_base - self.foot_and_jacobian(&position).0).norm() <= TOLERANCE_M;
        there.then(|| {
            for ((index, _), q) in self.joints.iter().zip(&position) {
                joint_position_rad[*index] = *q;
            }
        })
    }

    /// Centre of the foot in the base frame, and how it moves with each joint, m/rad.
    fn foot_and_jacobian(&self, position_rad: &[f64]) -> (Vector3<f64>, Vec<Vector3<f64>>) {
        let mut origin = Vector3::zeros();
        let mut turn = UnitQuaternion::identity();
        let mut hinges = Vec::with_capacity(self.joints.len());
        for ((_, joint), q) in self.joints.iter().zip(position_rad) {
            origin += turn * Vector3::from(joint.origin_in_parent_m);
            let axis = Unit::new_normalize(Vector3::from(joint.axis));
            hinges.push((origin, turn * axis.into_inner()));
            turn *= UnitQuaternion::from_axis_angle(&axis, *q);
        }
        let foot = origin + turn * self.foot_in_link_m;
        (foot, hinges.iter().map(|(origin, axis)| axis.cross(&(foot - origin))).collect())
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use vocaloco_core::robot::RobotModel;

    use super::*;

    fn legs() -> (RobotDescription, Vec<Leg>) {
        let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        let robot = RobotModel::load(&robots, "anymal_d").unwrap().description;
        let legs = (0..robot.feet.len()).map(|foot| Leg::new(&robot, foot)).collect();
        (robot, legs)
    }

    #[test]
    fn every_foot_gets_to_where_it_is_sent_and_no_other_leg_moves() {
        let (robot, legs) = legs();
        let stand: Vec<f64> = robot.joints.iter().map(|joint| joint.stand_rad).collect();
        for (foot, leg) in legs.iter().enumerate() {
            let goal = leg.stand_in_base() + Vector3::new(0.11, -0.04, 0.13);
            let mut position = stand.clone();
            leg.reach(goal, &mut position).unwrap();
            let own: Vec<f64> = leg.joints.iter().map(|(index, _)| position[*index]).collect();
            let off_m = (leg.foot_and_jacobian(&own).0 - goal).norm();
            assert!(off_m < TOLERANCE_M, "foot {foot}: {off_m} m off");
            let moved = position.iter().zip(&stand).filter(|(a, b)| (*a - *b).abs() > 1e-9).count();
            assert_eq!(moved, 3, "foot {foot}");
        }
    }

    #[test]
    fn a_goal_beyond_the_leg_is_refused_and_changes_nothing() {
        let (robot, legs) = legs();
        let stand: Vec<f64> = robot.joints.iter().map(|joint| joint.stand_rad).collect();
        let mut position = stand.clone();
        assert!(
            legs[0].reach(legs[0].stand_in_base() - Vector3::new(0.0, 0.0, 0.4), &mut position).is_none()
        );
        assert_eq!(position, stand);
    }
}
