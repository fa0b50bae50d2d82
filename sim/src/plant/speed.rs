//! What a physics step costs, measured on a robot that stands.

use std::{sync::Arc, time::Instant};

use rayon::prelude::*;
use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::JointTarget;

use super::{Plant, PlantKind};
use crate::{
    scene::Scene,
    spawn::{NoValidPose, SpawnRules, Spawner},
    terrain::{Terrain, TerrainKind},
};

/// Steps in which the robot comes to rest before time is taken.
pub const SETTLING_STEPS: usize = 200;
/// Rounds of which the fastest counts: other work on the machine only ever slows one down.
pub const ROUNDS: usize = 20;
/// Steps to a round.
pub const STEPS: usize = 100;

/// Rollouts that are timed together.
pub const ROLLOUTS: usize = 32;
/// Steps to each of them.
pub const ROLLOUT_STEPS: usize = 200;
/// Rounds of them, of which the fastest counts.
pub const ROLLOUT_ROUNDS: usize = 3;

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

/// A robot that stands on stairs up of 15 cm, to roll out from.
///
/// # Errors
/// It finds no place to stand.
pub fn rollout_scene(robot: &Arc<RobotModel>, kind: PlantKind) -> Result<Scene, NoValidPose> {
    let spawner = Spawner::new(robot, SpawnRules { any_yaw_share: 0.0, ..SpawnRules::default() });
    Scene::stage(robot, &spawner, (TerrainKind::StairsUp, 0.15), 1, kind)
}

/// Wall time for a physics step of 5 ms while [`ROLLOUTS`] robots stand in a scene's pose for
/// [`ROLLOUT_STEPS`] each on the threads of the present pool: µs, fastest of [`ROLLOUT_ROUNDS`] rounds.
pub fn rollouts_step_us(scene: &Scene) -> f64 {
    let mut fastest_s = f64::INFINITY;
    for _ in 0..ROLLOUT_ROUNDS {
        #[expect(clippy::disallowed_methods, reason = "this function measures time")]
        let start = Instant::now();
        (0..ROLLOUTS).into_par_iter().with_max_len(1).for_each(|_| {
            let mut plant = Plant::from_snapshot(&scene.spawn.snapshot);
            for _ in 0..ROLLOUT_STEPS {
                plant.step(&scene.spawn.targets);
            }
        });
        fastest_s = fastest_s.min(start.elapsed().as_secs_f64());
    }
    1e6 * fastest_s / (ROLLOUTS * ROLLOUT_STEPS) as f64
}
