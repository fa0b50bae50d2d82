//! Where the feet are in the stand, and how a standing robot is laid onto uneven ground.

use nalgebra::{Matrix3, Rotation3, Unit, UnitQuaternion, Vector3};
use vocaloco_plugin_api::RobotDescription;

use crate::{plant::BasePose, terrain::Terrain};

/// A little air below the lowest foot, so that nothing starts inside the ground.
const CLEARANCE_M: f64 = 0.002;

/// The feet of the standing robot.
#[derive(Clone, Debug)]
pub(super) struct Stance {
    height_m: f64,
    /// Centre in the base frame, and radius.
    feet: Vec<(Vector3<f64>, f64)>,
}

/// Where a robot should stand, and where it is dropped from to get there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    pub(super) desired: BasePose,
    pub(super) start: BasePose,
}

impl Stance {
    pub(super) fn new(robot: &RobotDescription) -> Self {
        let mut base_from_link: Vec<(Vector3<f64>, UnitQuaternion<f64>)> = Vec::new();
        for joint in &robot.joints {
            let (origin, turn) = usize::try_from(joint.parent)
                .map_or_else(|_| (Vector3::zeros(), UnitQuaternion::identity()), |i| base_from_link[i]);
            let axis = Unit::new_normalize(Vector3::from(joint.axis));
            base_from_link.push((
                origin + turn * Vector3::from(joint.origin_in_parent_m),
                turn * UnitQuaternion::from_axis_angle(&axis, joint.stand_rad),
            ));
        }
        let feet = robot
            .feet
            .iter()
            .map(|foot| {
                let (origin, turn) = base_from_link[foot.joint as usize];
                (origin + turn * Vector3::from(foot.centre_in_link_m), foot.radius_m)
            })
            .collect();
        Self { height_m: robot.stand_height_m, feet }
    }

    /// The stand at (x, y) with a yaw, rolled and pitched along the plane through the ground below
    /// its feet; `None` where a foot would stand outside the map.
    ///
    /// The robot starts as far above the desired pose as it takes to keep every foot out of the
    /// ground.
    pub(super) fn on(&self, terrain: &Terrain, x_m: f64, y_m: f64, yaw_rad: f64) -> Option<Placement> {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad);
        let mut rotation = turn;
        let mut base = Vector3::new(x_m, y_m, 0.0);
        // The feet move as the plane tilts: three rounds bring them within a millimetre.
        for _ in 0..3 {
            let mut normal_matrix = Matrix3::zeros();
            let mut right_side = Vector3::zeros();
            for (foot_in_base, _) in &self.feet {
                let offset = rotation * foot_in_base;
                let ground_m = height(terrain, base + offset)?;
                let in_yaw_frame = turn.inverse() * offset;
                let row = Vector3::new(1.0, in_yaw_frame.x, in_yaw_frame.y);
                normal_matrix += row * row.transpose();
                right_side += row * ground_m;
            }
            let plane = normal_matrix.try_inverse()? * right_side;
            let (ground_m, slope_x, slope_y) = (plane.x, plane.y, plane.z);
            let up = Vector3::new(-slope_x, -slope_y, 1.0).normalize();
            let forward = Vector3::new(1.0, 0.0, slope_x).normalize();
            rotation = turn * Rotation3::from_basis_unchecked(&[forward, up.cross(&forward), up]);
            base.z = ground_m + self.height_m / up.z;
        }
        let mut lift_m = 0.0_f64;
        for (foot_in_base, radius_m) in &self.feet {
            let foot = base + rotation * foot_in_base;
            let mut needed_m = height(terrain, foot)? + radius_m - foot.z;
            for side in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
                let beside = foot + Vector3::new(side[0], side[1], 0.0) * *radius_m;
                needed_m = needed_m.max(height(terrain, beside)? - foot.z);
            }
            lift_m = lift_m.max(needed_m);
        }
        let orientation = UnitQuaternion::from_rotation_matrix(&rotation);
        let pose = |z_m: f64| BasePose {
            position_m: [base.x as f32, base.y as f32, z_m as f32],
            orientation_xyzw: [orientation.i, orientation.j, orientation.k, orientation.w]
                .map(|part| part as f32),
        };
        Some(Placement { desired: pose(base.z), start: pose(base.z + lift_m + CLEARANCE_M) })
    }
}

fn height(terrain: &Terrain, point: Vector3<f64>) -> Option<f64> {
    let height_m = terrain.height_m(point.x as f32, point.y as f32);
    height_m.is_finite().then(|| f64::from(height_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::TerrainKind;

    /// Four feet at the corners of 0.7 × 0.4 m, 0.5 m below the base.
    fn stance() -> Stance {
        let corner = |x: f64, y: f64| (Vector3::new(x, y, -0.5), 0.03);
        Stance {
            height_m: 0.53,
            feet: vec![corner(0.35, 0.2), corner(0.35, -0.2), corner(-0.35, 0.2), corner(-0.35, -0.2)],
        }
    }

    #[test]
    fn on_flat_ground_the_robot_stands_level_at_its_stand_height() {
        let terrain = Terrain::tile(TerrainKind::Flat, 0.0, 0);
        let placed = stance().on(&terrain, 0.4, -0.3, 0.7).unwrap();
        assert!((placed.desired.position_m[2] - 0.53).abs() < 1e-5);
        assert!((placed.desired.yaw() - 0.7).abs() < 1e-5);
        assert!((placed.start.position_m[2] - 0.532).abs() < 1e-5);
    }

    #[test]
    fn on_a_ramp_the_robot_pitches_up_with_it_and_keeps_its_yaw() {
        let terrain = Terrain::tile(TerrainKind::Slope, 0.3, 0);
        // The way up runs from x = −3.5 to −0.5.
        let placed = stance().on(&terrain, -2.0, 0.0, 0.0).unwrap();
        let [x, y, z, w] = placed.desired.orientation_xyzw.map(f64::from);
        let forward = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z)) * Vector3::x();
        assert!((forward.z / forward.x - 0.3).abs() < 1e-4, "{forward:?}");
        let above_m = f64::from(placed.desired.position_m[2]) - 0.45;
        assert!((above_m - 0.53 * (1.0_f64 + 0.09).sqrt()).abs() < 1e-3, "{above_m}");
        let sideways = stance().on(&terrain, -2.0, 0.0, std::f64::consts::FRAC_PI_2).unwrap();
        assert!((sideways.desired.yaw() - std::f32::consts::FRAC_PI_2).abs() < 1e-4);
    }

    #[test]
    fn no_foot_starts_inside_a_step() {
        let terrain = Terrain::tile(TerrainKind::StairsUp, 0.2, 0);
        for n in 0..60 {
            let x_m = 1.5 + 0.05 * f64::from(n);
            let placed = stance().on(&terrain, x_m, 0.0, 0.2).unwrap();
            let [x, y, z, w] = placed.start.orientation_xyzw.map(f64::from);
            let turn = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
            let base = Vector3::from(placed.start.position_m.map(f64::from));
            for (foot, radius_m) in &stance().feet {
                let centre = base + turn * foot;
                let ground_m = f64::from(terrain.height_m(centre.x as f32, centre.y as f32));
                assert!(centre.z - radius_m >= ground_m, "x {x_m}: {} above {ground_m}", centre.z);
            }
        }
    }

    #[test]
    fn a_foot_outside_the_map_is_no_place_to_stand() {
        let terrain = Terrain::course(crate::terrain::CourseKind::StairsUp, 0.1, 3);
        assert!(stance().on(&terrain, 0.2, 0.0, 0.0).is_none());
        assert!(stance().on(&terrain, 1.0, 0.0, 0.0).is_some());
    }
}
