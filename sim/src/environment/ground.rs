//! What all environments of a run share: robot, contract, experts, and tiles with robots standing on
//! them, all drawn from the run's seed.

use std::{collections::BTreeMap, sync::Arc};

use rayon::prelude::*;
use thiserror::Error;
use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::{
    CommandKind,
    action::ActionMap,
    contract::{Action, ActionKind, Contract, ContractError, Factor, Gains, PerJoint},
    observation::{HeightOrder, HeightPatch, HistoryLayout, ObservationTerm, Observer, Term},
};

use super::config::{ConfigError, EnvironmentConfig, TerrainShare};
use super::mirror::Mirror;
use crate::{
    driver::TICK_S,
    plant::{Plant, PlantKind},
    rollout::RolledSkill,
    spawn::{NoValidPose, Spawn, SpawnRules, Spawner},
    stream::{derived_seed, stream, uniform},
    terrain::{Terrain, TerrainKind, WALL_DEPTH_M},
};

/// Tiles drawn for one place of the bank before it is given up.
const TILES: u64 = 10;

/// Why no environment can be made.
#[derive(Debug, Error)]
pub enum EnvironmentError {
    /// A field of the table.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The contract does not fit the robot.
    #[error("environment.contract.{0}")]
    Contract(ContractError),
    /// The contract's rate is not the simulator's.
    #[error("environment.contract.rate_hz: found {0}, wanted 50")]
    Rate(f64),
    /// An expert, or a skill that leads, that nobody handed over.
    #[error("environment.{field}: found {name:?}, wanted one of: {}", known.join(", "))]
    Expert {
        /// The field that asks for it.
        field: String,
        /// The skill asked for.
        name: String,
        /// Skills that are there.
        known: Vec<String>,
    },
    /// A terrain on which the robot cannot stand.
    #[error(transparent)]
    Pose(#[from] NoValidPose),
}

// Not `#[from]`: that makes it a source too, and a report of the chain says it twice.
impl From<ContractError> for EnvironmentError {
    fn from(error: ContractError) -> Self {
        Self::Contract(error)
    }
}

/// Shared by all environments of a run.
pub struct TrainingGround {
    pub(super) config: EnvironmentConfig,
    pub(super) robot: Arc<RobotModel>,
    pub(super) contract: Contract,
    pub(super) action_map: ActionMap,
    pub(super) mirror: Option<Mirror>,
    /// Cloned by each environment.
    pub(super) observer: Observer,
    /// In the robot's order.
    pub(super) stand_rad: Vec<f32>,
    pub(super) experts: BTreeMap<TerrainKind, RolledSkill>,
    /// For each terrain of the mix.
    pub(super) leaders: Vec<Option<RolledSkill>>,
    pub(super) seed: u64,
    /// `[terrain of the mix][level][variant]`, flattened.
    stages: Vec<Stage>,
}

/// A tile and robots standing on it.
pub(super) struct Stage {
    pub(super) terrain: Terrain,
    pub(super) spawns: Vec<Spawn>,
}

impl TrainingGround {
    /// Checks the configuration and builds all tiles and poses, on all threads of the present pool.
    ///
    /// # Errors
    /// As [`EnvironmentError`] says.
    pub fn new(
        config: EnvironmentConfig,
        robot: &Arc<RobotModel>,
        experts: &BTreeMap<String, RolledSkill>,
        seed: u64,
    ) -> Result<Self, EnvironmentError> {
        config.check()?;
        let contract = config.contract.clone().unwrap_or_else(|| standard_contract(robot));
        let observer = Observer::new(&contract, &robot.description)?;
        let action_map = ActionMap::new(&contract, &robot.description)?;
        if (contract.rate_hz * TICK_S - 1.0).abs() > 1e-9 {
            return Err(EnvironmentError::Rate(contract.rate_hz));
        }
        agree_on_command(&config, contract.command()?)?;
        let mirror = Mirror::new(&contract, &robot.description);
        if let Some((field, name)) = config.skills().find(|(_, name)| !experts.contains_key(*name)) {
            let known = experts.keys().cloned().collect();
            return Err(EnvironmentError::Expert { field, name: name.to_owned(), known });
        }
        let skill = |name: &String| experts.get(name).cloned();
        let chosen = config.experts.iter().filter_map(|(kind, name)| Some((*kind, skill(name)?))).collect();
        let leads = |share: &TerrainShare| share.led.as_ref().and_then(|led| skill(&led.by));
        let leaders = config.terrain.iter().map(leads).collect();
        let stages = build_stages(&config, robot, seed)?;
        Ok(Self {
            config,
            robot: Arc::clone(robot),
            stand_rad: robot.stand_position_rad(),
            contract,
            action_map,
            mirror,
            observer,
            experts: chosen,
            leaders,
            seed,
            stages,
        })
    }

    /// The configuration.
    pub fn config(&self) -> &EnvironmentConfig {
        &self.config
    }

    /// What the policy observes and what its output means: for the manifest of what is trained.
    pub fn contract(&self) -> &Contract {
        &self.contract
    }

    /// The robot.
    pub fn robot(&self) -> &Arc<RobotModel> {
        &self.robot
    }

    pub(super) fn stage(&self, terrain: usize, level: u32, variant: u32) -> &Stage {
        let EnvironmentConfig { levels, variants, .. } = self.config;
        &self.stages[((terrain as u32 * levels + level) * variants + variant) as usize]
    }
}

/// Refuses targets that the policy does not observe, and a policy without the targets that it observes.
fn agree_on_command(config: &EnvironmentConfig, kind: CommandKind) -> Result<(), ConfigError> {
    match (kind, config.target) {
        (CommandKind::PositionTarget, None) => {
            let wanted = "distance_m and time_s: the policy observes a position_target";
            Err(ConfigError::new("target", "nothing", wanted))
        }
        (CommandKind::Velocity, Some(_)) => {
            Err(ConfigError::new("target", "a target", "none: the policy observes no position_target"))
        }
        _ => Ok(()),
    }
}

/// The contract of docs/method.md, for a robot: proprioception, command, last action and 17 × 11
/// heights; targets about the stand with a scale of 0.5, 80 N·m/rad and 2 N·m·s/rad.
pub fn standard_contract(robot: &RobotModel) -> Contract {
    let joints = || robot.description.joints.iter();
    Contract {
        rate_hz: 50.0,
        initial_phase: 0.0,
        history_layout: HistoryLayout::TermMajor,
        joints: joints().map(|joint| joint.name.to_string()).collect(),
        observation: vec![
            ObservationTerm::new(Term::BaseLinearVelocity, 2.0),
            ObservationTerm::new(Term::BaseAngularVelocity, 0.25),
            ObservationTerm::new(Term::ProjectedGravity, 1.0),
            ObservationTerm {
                scale: Factor::Each(vec![2.0, 2.0, 0.25]),
                ..ObservationTerm::new(Term::VelocityCommand, 1.0)
            },
            ObservationTerm::new(Term::JointPosition, 1.0),
            ObservationTerm::new(Term::JointVelocity, 0.05),
            ObservationTerm::new(Term::LastAction, 1.0),
            ObservationTerm::heights(standard_patch(), 5.0),
        ],
        action: Action {
            kind: ActionKind::JointPosition,
            scale: PerJoint::All(0.5),
            clip: 100.0,
            default_position_rad: joints().map(|joint| (joint.name.to_string(), joint.stand_rad)).collect(),
        },
        gains: Gains { stiffness_nm_per_rad: PerJoint::All(80.0), damping_nms_per_rad: PerJoint::All(2.0) },
    }
}

/// `legged_gym`'s 17 × 11 heights.
pub(super) fn standard_patch() -> HeightPatch {
    HeightPatch {
        back_m: 0.8,
        front_m: 0.8,
        half_width_m: 0.5,
        resolution_m: 0.1,
        offset_m: 0.5,
        order: HeightOrder::RowsFromRight,
    }
}

fn build_stages(
    config: &EnvironmentConfig,
    robot: &Arc<RobotModel>,
    seed: u64,
) -> Result<Vec<Stage>, NoValidPose> {
    let EnvironmentConfig { levels, variants, poses, plant, .. } = *config;
    let spawner_of = |share: &TerrainShare| {
        let start_before_m = share.start_before_m.or(config.spawn.start_before_m);
        Spawner::new(robot, SpawnRules { start_before_m, ..config.spawn })
    };
    let spawners: Vec<Spawner> = config.terrain.iter().map(spawner_of).collect();
    let places = (0..config.terrain.len() as u32 * levels * variants).into_par_iter();
    places
        .map(|place| {
            let (terrain, level, variant) =
                (place / (levels * variants), place / variants % levels, place % variants);
            let index = [terrain, level, variant].map(u64::from);
            let mut rng = stream(seed, "environment/size", &index);
            let step = level as f32 + (variant as f32 + uniform(&mut rng, 0.0, 1.0)) / variants as f32;
            let share = &config.terrain[terrain as usize];
            let spawner = &spawners[terrain as usize];
            Stage::build(robot, spawner, (share, step / levels as f32), (seed, index), poses, plant)
        })
        .collect()
}

impl Stage {
    /// A tile of the size at `difficulty` 0 to 1, with `poses` settled robots.
    fn build(
        robot: &Arc<RobotModel>,
        spawner: &Spawner,
        (share, difficulty): (&TerrainShare, f32),
        (seed, [terrain, level, variant]): (u64, [u64; 3]),
        poses: u32,
        plant: PlantKind,
    ) -> Result<Self, NoValidPose> {
        let [least_m, most_m] = share.size_m;
        let size_m = least_m + difficulty * (most_m - least_m);
        let build = |attempt: u64| {
            let index = [terrain, level, variant, attempt];
            let depth_m = share.depth_m.map_or(WALL_DEPTH_M, |[least_m, most_m]| {
                uniform(&mut stream(seed, "environment/depth", &index), least_m, most_m)
            });
            let tile_seed = derived_seed(seed, "environment/tile", &index);
            let tile = Terrain::deep_tile(share.kind, size_m, depth_m, tile_seed);
            let mut plant = Plant::new(robot, &tile, plant);
            let mut rng = stream(seed, "environment/pose", &index);
            let settled: Result<Vec<Spawn>, _> =
                (0..poses).map(|_| spawner.settle(&mut plant, &tile, &mut rng)).collect();
            settled.map(|spawns| Self { terrain: tile, spawns })
        };
        let mut built = build(0);
        for attempt in 1..TILES {
            if built.is_ok() {
                break;
            }
            built = build(attempt);
        }
        built
    }
}
