//! MuJoCo's own speed, beside which ours is told.

use std::{path::Path, sync::Arc};

use vocaloco_core::robot::RobotModel;

use super::{Interpreter, MujocoPlant, TransferError};
use crate::{
    plant::BasePose,
    scene::Scene,
    terrain::{Terrain, TerrainKind},
};

/// MuJoCo, timed.
#[derive(Clone, Debug, PartialEq)]
pub struct PeerSpeed {
    /// Its version.
    pub version: String,
    /// Of a step of 5 ms, µs on one thread.
    pub step_us: f64,
    /// Wall time for a step of `mujoco.rollout`, µs, by the numbers of threads asked for.
    pub rollouts_step_us: Vec<f64>,
}

/// Times MuJoCo's `mj_step` on the robot and ground of [`plant::speed`](crate::plant::speed), standing, and
/// its `rollout` from the pose of a scene.
///
/// # Errors
/// The interpreter or the package is missing, or the robot does not stand.
pub fn time_peer(
    interpreter: &Interpreter,
    robots_folder: &Path,
    robot: &Arc<RobotModel>,
    scene: &Scene,
    threads: &[usize],
) -> Result<PeerSpeed, TransferError> {
    let mut plant = MujocoPlant::start(interpreter, robots_folder, robot)?;
    plant.lay(&Terrain::tile(TerrainKind::Flat, 0.0, 1))?;
    let pose = BasePose::from_yaw([0.0, 0.0, robot.description.stand_height_m as f32], 0.0);
    plant.place(&pose, &robot.stand_position_rad())?;
    let step_us = plant.standing_step_us()?;
    plant.lay(&scene.terrain)?;
    let held_rad: Vec<f32> = scene.spawn.targets.iter().map(|target| target.position_rad).collect();
    plant.place(&scene.spawn.base, &held_rad)?;
    let rollouts_step_us = threads
        .iter()
        .map(|threads| plant.rollouts_step_us(&held_rad, *threads))
        .collect::<Result<_, _>>()?;
    Ok(PeerSpeed { version: plant.version().to_owned(), step_us, rollouts_step_us })
}
