//! A course with something that chooses skills: where it starts, how it is commanded, how it ends.
//!
//! The robot is steered to the terrain's heading and nothing else; whoever decides is a [`Pilot`],
//! the selector of `vocaloco-core` or one skill alone. Deterministic for a seed and a rollout.

mod blame;
mod drive;
mod oracle;
mod pilot;
mod record;
mod runtimes;
mod stage;
mod success;
mod switches;

#[cfg(test)]
mod tests;

pub use blame::{Blame, blame};
pub use drive::drive;
pub use oracle::{Ground, Oracle, Worth};
pub use pilot::{Pilot, PilotTick, SelectorPilot, SkillPilot};
pub use record::{CourseRun, CourseTick, Outcome, Switch};
pub use runtimes::{Crew, Runtimes};
pub use stage::CourseStage;
pub use success::{Lost, Selector, SuccessRow, roll_out, roll_out_each, success};
pub use switches::{Peaks, SwitchesRow, switches};

use thiserror::Error;
use vocaloco_core::{plugin::PluginError, registry::LoadError, runtime::RuntimeError};
use vocaloco_plugin_api::SkillError;

use crate::{
    driver::SensorNoise,
    occlusion::Occlusion,
    spawn::{NoValidPose, SpawnRules},
    terrain::{Course, CourseKind},
};

/// Forward command, m/s (docs/method.md).
pub const FORWARD_M_PER_S: f32 = 0.6;
/// Where the target lies on the far flat, from its near edge, m.
pub const TARGET_ON_FLAT_M: f32 = 2.0;
/// Reached: the base is within this of the target, m.
pub const REACHED_WITHIN_M: f32 = 0.5;
/// Stopped: standing for this long without a break, s.
pub const STOPPED_AFTER_S: f64 = 2.0;

/// Which course, how it starts and what is uncertain about it.
#[derive(Clone, Debug, PartialEq)]
pub struct CourseConfig {
    /// Which one.
    pub kind: CourseKind,
    /// Its size: the height of a step; of the course of obstacles see [`CourseKind::Obstacles`], m.
    pub size_m: f32,
    /// Steps of a flight.
    pub steps: usize,
    /// Seed of every stream.
    pub seed: u64,
    /// Which of the seed's rollouts.
    pub rollout: u64,
    /// Where along the near flat the base is set down, smallest and largest x, m.
    pub start_m: [f32; 2],
    /// How the robot is set down.
    pub spawn: SpawnRules,
    /// Noise on what plugins and the runtime measure, the elevation map included.
    pub noise: SensorNoise,
    /// Half-width of the uniform noise on every value of the predictors' field, fresh each tick, m.
    pub field_noise_m: f32,
    /// What the predictors' field is made from.
    pub occlusion: Occlusion,
    /// Draw friction and base mass as a collection's repeats do; otherwise they are nominal.
    pub varied: bool,
    /// Keep every tick, for pictures and logs.
    pub recorded: bool,
}

impl CourseConfig {
    /// The course itself.
    pub const fn course(&self) -> Course {
        Course { kind: self.kind, size_m: self.size_m, steps: self.steps }
    }

    /// A rollout of the evaluation: spawned anywhere on the near flat, varied, not recorded.
    pub fn evaluation(kind: CourseKind, size_m: f32, seed: u64, rollout: u64) -> Self {
        Self {
            kind,
            size_m,
            steps: 6,
            seed,
            rollout,
            start_m: [0.8, 2.2],
            spawn: SpawnRules { any_yaw_share: 0.0, ..SpawnRules::default() },
            noise: SensorNoise::default(),
            field_noise_m: 0.1,
            occlusion: Occlusion::None,
            varied: true,
            recorded: false,
        }
    }

    /// The demo's staircase: three steps, from the back of the near flat so that it begins with
    /// level ground in view, every tick kept.
    pub fn demo(kind: CourseKind, size_m: f32, seed: u64) -> Self {
        Self {
            steps: 3,
            start_m: [0.8, 1.0],
            spawn: SpawnRules { any_yaw_share: 0.0, yaw_rad: 0.1, ..SpawnRules::default() },
            varied: false,
            recorded: true,
            ..Self::evaluation(kind, size_m, seed, 0)
        }
    }
}

/// Why a course could not be driven to its end.
#[derive(Debug, Error)]
pub enum CourseError {
    /// The robot could not be set down.
    #[error(transparent)]
    Spawn(#[from] NoValidPose),
    /// The deployment did not load.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The one skill that drives could not be made.
    #[error(transparent)]
    Plugin(#[from] PluginError),
    /// The runtime could not start.
    #[error("runtime: {0}")]
    Runtime(#[from] RuntimeError),
    /// The one skill that drives failed.
    #[error("skill `{skill}` at {t_s:.2} s: {error}")]
    Skill {
        /// Its name.
        skill: String,
        /// When.
        t_s: f64,
        /// What the plugin reported.
        error: SkillError,
    },
}
