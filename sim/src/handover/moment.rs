//! The moment at which the stairs are nearly done: fore feet past the last riser, hind feet before it.

use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::RobotDescription;

use crate::{
    kinematics::{forward_kinematics, legs},
    plant::{BasePose, Measurement},
    terrain::{FLAT_M, TREAD_M},
};

/// Steps of the staircase.
pub const STEPS: usize = 3;
/// Where its last riser is: the landing begins there, or the lower flat.
pub const LAST_RISER_X_M: f32 = FLAT_M + (STEPS - 1) as f32 * TREAD_M;

/// Which of a robot's feet are fore feet, as it stands.
pub(super) struct Feet {
    is_fore: Vec<bool>,
}

impl Feet {
    pub(super) fn of(robot: &RobotModel) -> Self {
        let level = BasePose::from_yaw([0.0; 3], 0.0);
        let feet = feet_in_world(&robot.description, &level, &robot.stand_position_rad());
        Self { is_fore: feet.iter().map(|foot| foot[0] > 0.0).collect() }
    }

    /// Whether every fore foot is past the last riser and every hind foot over the tread before it.
    pub(super) fn straddle_the_last_riser(&self, feet_in_world: &[[f32; 3]]) -> bool {
        self.is_fore.iter().zip(feet_in_world).all(|(is_fore, [x_m, _, _])| {
            let past_m = x_m - LAST_RISER_X_M;
            if *is_fore { past_m > 0.0 } else { (-TREAD_M..=0.0).contains(&past_m) }
        })
    }
}

/// Centres of the feet, in the order of the robot's feet, m.
pub(super) fn feet_of(robot: &RobotDescription, measured: &Measurement) -> Vec<[f32; 3]> {
    feet_in_world(robot, &measured.base, &measured.joint_position_rad)
}

fn feet_in_world(robot: &RobotDescription, base: &BasePose, joint_position_rad: &[f32]) -> Vec<[f32; 3]> {
    let legs = legs(robot, &forward_kinematics(robot, base, joint_position_rad));
    legs.iter().filter_map(|leg| leg.last().copied()).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::terrain::{CourseKind, Terrain};

    #[test]
    fn the_last_riser_parts_the_last_step_from_the_far_flat() {
        let (before_m, after_m) = (LAST_RISER_X_M - 0.01, LAST_RISER_X_M + 0.01);
        for (kind, rise_m) in [(CourseKind::StairsUp, 0.12), (CourseKind::StairsDown, -0.12)] {
            let terrain = Terrain::course(kind, 0.12, STEPS);
            let risen_m = terrain.height_m(after_m, 0.3) - terrain.height_m(before_m, 0.3);
            assert!((risen_m - rise_m).abs() < 1e-5, "{kind:?}: {risen_m} m");
            let flat_m = terrain.height_m(after_m + 2.5, 0.3) - terrain.height_m(after_m, 0.3);
            assert_eq!(flat_m, 0.0, "{kind:?}");
            let tread_m = terrain.height_m(LAST_RISER_X_M - TREAD_M + 0.01, 0.3);
            assert_eq!(tread_m, terrain.height_m(before_m, 0.3), "{kind:?}");
        }
    }

    #[test]
    fn a_hind_foot_that_has_stepped_up_or_is_a_step_behind_is_not_on_the_last_step() {
        let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        let feet = Feet::of(&RobotModel::load(&robots, "anymal_d").unwrap());
        assert_eq!(feet.is_fore, [true, true, false, false], "LF RF LH RH");
        let at = |past_m: [f32; 4]| past_m.map(|past_m| [LAST_RISER_X_M + past_m, 0.2, 0.5]);
        assert!(feet.straddle_the_last_riser(&at([0.4, 0.5, -0.3, -0.02])));
        assert!(!feet.straddle_the_last_riser(&at([0.4, 0.5, -0.3, 0.02])));
        assert!(!feet.straddle_the_last_riser(&at([0.4, 0.5, -0.33, -0.1])));
        assert!(!feet.straddle_the_last_riser(&at([-0.01, 0.5, -0.3, -0.1])));
        assert!(!feet.straddle_the_last_riser(&at([f32::NAN, 0.5, -0.3, -0.1])));
    }
}
