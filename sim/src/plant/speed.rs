//! What a physics step costs, measured on a robot that stands.

use std::{sync::Arc, time::Instant};

use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::JointTarget;

use super::{Plant, PlantKind};
use crate::terrain::{Terrain, TerrainKind};

/// Steps in which the robot comes to rest before time is taken.
pub const SETTLING_STEPS: usize = 200;
/// Rounds of which the fastest counts: other work on the machine only ever slows one down.
pub const ROUNDS: usize = 20;
/// Steps to a round.
pub const STEPS: usize = 100;

/// Targets that hold the stand at the stand's gains, in the robot's joint order.
pub fn standing_targets(robot: &RobotModel) -> Vec<JointTarget> {
    let target = |position_rad| JointTarget {
        position_rad,
        stiffness_nm_per_rad: robot.stand.stiffness_nm_per_rad,
        damping_nms_per_rad: robot.stand.damping_nms_per_rad,
        feed_forward_nm: 0.0,
    };
    robot.stand_position_rad().into_iter().map(target).collect()
}

/// Time of a physics step of 5 ms while the robot stands on flat ground, drives and measurement
/// included: µs on one thread, mean of the fastest of [`ROUNDS`] rounds.
pub fn standing_step_us(robot: &Arc<RobotModel>, kind: PlantKind) -> f64 {
    let mut plant = Plant::new(robot, &Terrain::tile(TerrainKind::Flat, 0.0, 1), kind);
    let targets = standing_targets(robot);
    for _ in 0..SETTLING_STEPS {
        plant.step(&targets);
    }
    let mut fastest_s = f64::INFINITY;
    for _ in 0..ROUNDS {
        #[expect(clippy::disallowed_methods, reason = "this function measures time")]
        let start = Instant::now();
        for _ in 0..STEPS {
            plant.step(&targets);
        }
        fastest_s = fastest_s.min(start.elapsed().as_secs_f64());
    }
    1e6 * fastest_s / STEPS as f64
}
