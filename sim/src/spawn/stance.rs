//! How a standing robot is laid onto uneven ground: base rolled and pitched along the plane below
//! its feet, each foot on the ground vertically below where the level stand has it.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use vocaloco_plugin_api::RobotDescription;

use super::leg::Leg;
use crate::{plant::BasePose, terrain::Terrain};

/// A little air below the feet, so that nothing starts inside the ground.
const CLEARANCE_M: f64 = 0.002;

/// The robot's stand on level ground, and its legs to adapt it.
#[derive(Clone, Debug)]
pub(super) struct Stance {
    height_m: f64,
    legs: Vec<Leg>,
    stand_rad: Vec<f64>,
}

/// Where a robot should stand, and how it is set down to get there.
#[derive(Clone, Debug)]
pub(super) struct Placement {
    pub(super) base: BasePose,
    pub(super) joint_position_rad: Vec<f32>,
}

impl Stance {
    pub(super) fn new(robot: &RobotDescription) -> Self {
        Self {
            height_m: robot.stand_height_m,
            legs: (0..robot.feet.len()).map(|foot| Leg::new(robot, foot)).collect(),
            stand_rad: robot.joints.iter().map(|joint| joint.stand_rad).collect(),
        }
    }

    /// The stand at (x, y) with a yaw, as high above the plane through the ground below its feet as on
    /// level ground; `None` where a foot would stand outside the map or out of its leg's reach.
    ///
    /// On level ground it is the stand itself. On a slope the feet stay below the hips, so that the
    /// robot's weight stays between them.
    pub(super) fn on(&self, terrain: &Terrain, x_m: f64, y_m: f64, yaw_rad: f64) -> Option<Placement> {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad);
        let mut rotation = turn;
        let mut base = Vector3::new(x_m, y_m, 0.0);
        // The feet move as the plane tilts: three rounds bring them within a millimetre.
        for _ in 0..3 {
            let mut normal_matrix = Matrix3::zeros();
            let mut right_side = Vector3::zeros();
            for leg in &self.legs {
                let below = Self::below(leg, rotation);
                let ground_m = height(terrain, base + below)?;
                let in_yaw_frame = turn.inverse() * below;
                let row = Vector3::new(1.0, in_yaw_frame.x, in_yaw_frame.y);
                normal_matrix += row * row.transpose();
                right_side += row * ground_m;
            }
            let plane = normal_matrix.try_inverse()? * right_side;
            let (ground_m, slope_x, slope_y) = (plane.x, plane.y, plane.z);
            let up = Vector3::new(-slope_x, -slope_y, 1.0).normalize();
            let forward = Vector3::new(1.0, 0.0, slope_x).normalize();
            rotation = turn * Rotation3::from_basis_unchecked(&[forward, up.cross(&forward), up]);
            base.z = ground_m + self.height_m;
        }
        let mut joint_position_rad = self.stand_rad.clone();
        for leg in &self.legs {
            let mut foot = base + Self::below(leg, rotation);
            foot.z = Self::ground_for(terrain, foot, leg.radius_m())? + CLEARANCE_M;
            leg.reach(rotation.inverse() * (foot - base), &mut joint_position_rad)?;
        }
        let orientation = UnitQuaternion::from_rotation_matrix(&rotation);
        Some(Placement {
            base: BasePose {
                position_m: [base.x as f32, base.y as f32, base.z as f32],
                orientation_xyzw: [orientation.i, orientation.j, orientation.k, orientation.w]
                    .map(|part| part as f32),
            },
            joint_position_rad: joint_position_rad.iter().map(|position| *position as f32).collect(),
        })
    }

    /// Where a foot of the level stand lies from the base, seen from above, once the base is turned.
    fn below(leg: &Leg, rotation: Rotation3<f64>) -> Vector3<f64> {
        let stand = leg.stand_in_base();
        rotation * Vector3::new(stand.x, stand.y, 0.0)
    }

    /// Lowest height of a foot's centre at which it is not inside the ground.
    fn ground_for(terrain: &Terrain, foot: Vector3<f64>, radius_m: f64) -> Option<f64> {
        let mut centre_m = height(terrain, foot)? + radius_m;
        for side in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
            let beside = foot + Vector3::new(side[0], side[1], 0.0) * radius_m;
            centre_m = centre_m.max(height(terrain, beside)?);
        }
        Some(centre_m)
    }
}

fn height(terrain: &Terrain, point: Vector3<f64>) -> Option<f64> {
    let height_m = terrain.height_m(point.x as f32, point.y as f32);
    height_m.is_finite().then(|| f64::from(height_m))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use vocaloco_core::robot::RobotModel;

    use super::*;
    use crate::{kinematics, terrain::TerrainKind};

    fn robot() -> RobotModel {
        let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        RobotModel::load(&robots, "anymal_d").unwrap()
    }

    /// Centres of the feet in the world.
    fn feet(robot: &RobotModel, placed: &Placement) -> Vec<[f32; 3]> {
        let links =
            kinematics::forward_kinematics(&robot.description, &placed.base, &placed.joint_position_rad);
        let legs = kinematics::legs(&robot.description, &links);
        legs.iter().map(|points| *points.last().unwrap()).collect()
    }

    #[test]
    fn on_flat_ground_it_is_the_stand_itself() {
        let robot = robot();
        let terrain = Terrain::tile(TerrainKind::Flat, 0.0, 0);
        let placed = Stance::new(&robot.description).on(&terrain, 0.4, -0.3, 0.7).unwrap();
        let stand_height_m = robot.description.stand_height_m as f32;
        assert!((placed.base.position_m[2] - stand_height_m).abs() < 1e-5);
        assert!((placed.base.yaw() - 0.7).abs() < 1e-5);
        for (found, stand) in placed.joint_position_rad.iter().zip(robot.stand_position_rad()) {
            assert!((found - stand).abs() < 0.02, "{found} {stand}");
        }
    }

    #[test]
    fn on_a_ramp_it_pitches_up_and_keeps_its_yaw_and_its_feet_below_the_hips() {
        let robot = robot();
        let stance = Stance::new(&robot.description);
        let terrain = Terrain::tile(TerrainKind::Slope, 0.3, 0);
        // The way up runs from x = −3.5 to −0.5.
        let placed = stance.on(&terrain, -2.0, 0.0, 0.0).unwrap();
        let forward = placed.base.vector_in_world([1.0, 0.0, 0.0]);
        assert!((forward[2] / forward[0] - 0.3).abs() < 1e-4, "{forward:?}");
        let middle_m = feet(&robot, &placed).iter().map(|foot| foot[0]).sum::<f32>() / 4.0;
        assert!((middle_m + 2.0).abs() < 0.01, "the feet are {middle_m}, the base is at -2");
        let sideways = stance.on(&terrain, -2.0, 0.0, std::f64::consts::FRAC_PI_2).unwrap();
        assert!((sideways.base.yaw() - std::f32::consts::FRAC_PI_2).abs() < 1e-4);
    }

    #[test]
    fn every_foot_starts_on_the_steps_and_none_inside_them() {
        let robot = robot();
        let stance = Stance::new(&robot.description);
        let terrain = Terrain::tile(TerrainKind::StairsUp, 0.2, 0);
        let mut placements = 0;
        for n in 0..60 {
            let x_m = 1.5 + 0.05 * f64::from(n);
            let Some(placed) = stance.on(&terrain, x_m, 0.0, 0.2) else { continue };
            placements += 1;
            for foot in feet(&robot, &placed) {
                let air_m = foot[2] - 0.0315 - terrain.height_m(foot[0], foot[1]);
                // A foot that overlaps the next step stands on that step's edge.
                assert!((0.0..0.21).contains(&air_m), "x {x_m}: {air_m} m of air");
            }
        }
        assert!(placements > 40, "{placements} of 60");
    }

    #[test]
    fn a_foot_outside_the_map_is_no_place_to_stand() {
        let stance = Stance::new(&robot().description);
        let terrain = Terrain::course(crate::terrain::CourseKind::StairsUp, 0.1, 3);
        assert!(stance.on(&terrain, 0.2, 0.0, 0.0).is_none());
        assert!(stance.on(&terrain, 1.0, 0.0, 0.0).is_some());
    }

    #[test]
    fn a_foot_out_of_reach_is_no_place_to_stand() {
        let stance = Stance::new(&robot().description);
        let terrain = Terrain::tile(TerrainKind::Gap, 0.6, 0);
        // The right front foot alone would have to stand on the trench's floor, 1.5 m down.
        assert!(stance.on(&terrain, 1.5, 0.0, 0.5).is_none());
    }
}
