//! The protocol in both simulators: each pose is settled in rapier, where its rollout is the one of
//! `evaluate viability`, and rolled out again in MuJoCo with the same draws.

use std::{
    path::PathBuf,
    sync::{Arc, Mutex, PoisonError},
};

use rayon::prelude::*;
use vocaloco_core::robot::RobotModel;

use super::{Interpreter, MujocoPlant, TransferError};
use crate::{
    angle::wrapped_rad,
    evaluate::{Query, Staging},
    physics::Physics,
    plant::{BasePose, STEP_S},
    rollout::{RolledSkill, Rollout, Trial},
    scene::Scene,
    spawn::{Spawn, SpawnRules},
};

/// How long the robot stands in MuJoCo, in rapier's settled pose, before a rollout, s.
pub const STAND_S: f64 = 0.3;

/// One pose, rolled out in both.
#[derive(Clone, Debug)]
pub struct Pair {
    /// In rapier.
    pub rapier: Rollout,
    /// In MuJoCo.
    pub mujoco: Rollout,
}

/// MuJoCo's processes, started when a thread wants one more.
pub struct Peers {
    interpreter: Interpreter,
    robots_folder: PathBuf,
    robot: Arc<RobotModel>,
    version: String,
    idle: Mutex<Vec<MujocoPlant>>,
}

impl Peers {
    /// Starts the first, so that a missing interpreter or package is found at once.
    ///
    /// # Errors
    /// As [`MujocoPlant::start`].
    pub fn start(
        interpreter: Interpreter,
        robots_folder: PathBuf,
        robot: &Arc<RobotModel>,
    ) -> Result<Self, TransferError> {
        let first = MujocoPlant::start(&interpreter, &robots_folder, robot)?;
        Ok(Self {
            interpreter,
            robots_folder,
            robot: Arc::clone(robot),
            version: first.version().to_owned(),
            idle: Mutex::new(vec![first]),
        })
    }

    /// Version of MuJoCo.
    pub fn version(&self) -> &str {
        &self.version
    }

    fn with<R>(
        &self,
        work: impl FnOnce(&mut MujocoPlant) -> Result<R, TransferError>,
    ) -> Result<R, TransferError> {
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let waiting = idle().pop();
        let mut plant = match waiting {
            Some(plant) => plant,
            None => MujocoPlant::start(&self.interpreter, &self.robots_folder, &self.robot)?,
        };
        let result = work(&mut plant)?;
        idle().push(plant);
        Ok(result)
    }
}

/// Rolls a skill out from fresh poses in both simulators, in parallel on the current rayon pool, in the
/// order of the poses; `progress` is called once for each, from any thread.
///
/// In MuJoCo the robot is put down as it stood in rapier and stands there for [`STAND_S`] under the same
/// targets. A pose that is then no longer valid by [`SpawnRules`] is `None`: it counts in neither.
///
/// # Errors
/// When no valid pose is found, or MuJoCo's process fails.
pub fn sample_pairs(
    robot: &Arc<RobotModel>,
    skill: &RolledSkill,
    query: &Query,
    peers: &Peers,
    progress: &(dyn Fn() + Sync),
) -> Result<Vec<Option<Pair>>, TransferError> {
    let staging = Staging::new(robot, query);
    let one = |row: usize| {
        let (seed, Scene { terrain, mut plant, spawn }) = staging.row(row as u64)?;
        let chance = staging.chance(seed);
        let standing_rad = plant.measure().joint_position_rad.clone();
        let trial = Trial { terrain: &terrain, spawn: &spawn, skill, rules: &query.rules };
        let mujoco = peers.with(|peer| {
            peer.lay(&terrain)?;
            peer.place(&spawn.base, &standing_rad)?;
            let stands = stand(peer, &spawn, &query.spawn);
            let rollout = stands.then(|| trial.roll_on(peer, &chance));
            peer.check()?;
            Ok(rollout)
        })?;
        let pair = mujoco.map(|mujoco| Pair { rapier: trial.roll_out(&mut plant, &chance), mujoco });
        progress();
        Ok(pair)
    };
    (0..query.samples as usize).into_par_iter().with_max_len(1).map(one).collect()
}

/// Stands for a while; whether the pose is valid after it.
fn stand(plant: &mut impl Physics, spawn: &Spawn, rules: &SpawnRules) -> bool {
    for _ in 0..(STAND_S / f64::from(STEP_S)).round() as usize {
        plant.step(&spawn.targets);
        if plant.measure().base_contact {
            return false;
        }
    }
    is_near(&plant.measure().base, &spawn.base, rules)
}

/// Phrased as "is inside", so that a pose of NaN is not near.
fn is_near(found: &BasePose, wanted: &BasePose, rules: &SpawnRules) -> bool {
    let square_m2: f32 =
        found.position_m.iter().zip(wanted.position_m).map(|(found, wanted)| (found - wanted).powi(2)).sum();
    square_m2.sqrt() <= rules.position_tolerance_m
        && wrapped_rad(found.yaw() - wanted.yaw()).abs() <= rules.yaw_tolerance_rad
}
