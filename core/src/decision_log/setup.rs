//! The first message of a log.

use serde::{Deserialize, Serialize};
use vocaloco_plugin_api::CommandKind;

use super::SCHEMA;
use crate::manifest::CommandRange;
use crate::runtime::Runtime;
use crate::selector::Rule;
use crate::switch::Windows;

/// What the loop was configured with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// [`SCHEMA`].
    pub schema: u32,
    /// Version of this program.
    pub version: String,
    /// Name of the deployment.
    pub deployment: String,
    /// Name of the robot.
    pub robot: String,
    /// The model runtime, with its version.
    pub backend: String,
    /// Rate of ticks, Hz.
    pub rate_hz: f64,
    /// Ticks that must agree before a switch.
    pub switch_window: usize,
    /// Ticks that must agree before a stop.
    pub stop_window: usize,
    /// Ticks that must agree before a stop is left.
    pub resume_window: usize,
    /// What the selector knew of each skill, in the deployment's order.
    pub skills: Vec<SetupSkill>,
}

/// What the selector knew of a skill.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SetupSkill {
    /// Its name.
    pub name: String,
    /// Least predicted viability at which it may be chosen.
    pub viability_threshold: f32,
    /// Least predicted viability at which it might go on while it drove; none was the threshold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hold_threshold: Option<f32>,
    /// Share by which another had to be cheaper once it had won.
    #[serde(default)]
    pub cost_margin: f32,
    /// Whether it goes to position targets rather than following a velocity.
    pub position_target: bool,
    /// Forward velocity that it takes, m/s.
    pub forward_m_per_s: [f64; 2],
}

impl Setup {
    /// The setup of a runtime.
    pub fn of(runtime: &Runtime, deployment: &str) -> Self {
        let config = runtime.config();
        let backend = crate::predictor::backend();
        Self {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            deployment: deployment.to_owned(),
            robot: runtime.robot().name.clone(),
            backend: format!("{} {}", backend.name, backend.version),
            rate_hz: config.rate_hz,
            switch_window: config.windows.switch,
            stop_window: config.windows.stop,
            resume_window: config.windows.resume,
            skills: runtime.rules().iter().map(SetupSkill::of).collect(),
        }
    }

    /// The switch filter's windows.
    pub const fn windows(&self) -> Windows {
        Windows { switch: self.switch_window, stop: self.stop_window, resume: self.resume_window }
    }

    /// The selector's rules.
    pub fn rules(&self) -> Vec<Rule> {
        self.skills.iter().map(SetupSkill::rule).collect()
    }
}

impl SetupSkill {
    /// What the selector knows of a skill.
    pub fn of(rule: &Rule) -> Self {
        Self {
            name: rule.name.clone(),
            viability_threshold: rule.viability_threshold,
            hold_threshold: Some(rule.hold_threshold).filter(|hold| *hold != rule.viability_threshold),
            cost_margin: rule.cost_margin,
            position_target: rule.command.kind == CommandKind::PositionTarget,
            forward_m_per_s: rule.command.forward_m_per_s,
        }
    }

    /// The selector's rule.
    pub fn rule(&self) -> Rule {
        let kind = if self.position_target { CommandKind::PositionTarget } else { CommandKind::Velocity };
        Rule {
            name: self.name.clone(),
            viability_threshold: self.viability_threshold,
            hold_threshold: self.hold_threshold.unwrap_or(self.viability_threshold),
            cost_margin: self.cost_margin,
            command: CommandRange { kind, forward_m_per_s: self.forward_m_per_s, target_distance_m: None },
            // Both show in what was decided.
            time_limit_s: f64::INFINITY,
            committed: false,
        }
    }
}
