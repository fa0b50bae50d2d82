//! What a policy network was trained with, by name: joints, observation, action, gains.
//!
//! A manifest's `[contract]`, the parameter text of the `onnx` plugin and a training environment are
//! all this one type, so that they cannot differ. It knows no file format: serde reads and writes it.

mod number;

use std::collections::BTreeMap;
use std::fmt::Display;
use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};
use thiserror::Error;

pub(crate) use number::by_name as number_by_name;
pub use number::{Factor, PerJoint};

use crate::action::ActionMap;
use crate::observation::{HistoryLayout, ObservationTerm, Observer, Term};
use crate::{CommandKind, ErrorCode, RobotDescription, SkillError};

/// Most terms of an observation, and most values of a term's history.
pub const MAX_TERMS: usize = 64;

/// What a policy was trained with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contract {
    /// Ticks per second, Hz; 50 by default.
    #[serde(default = "rate_hz")]
    pub rate_hz: f64,
    /// Where in its cycle a policy with a `gait_phase` starts, 0 to 1; 0 by default.
    #[serde(default)]
    pub initial_phase: f64,
    /// How terms with a history lie in the observation.
    #[serde(default)]
    pub history_layout: HistoryLayout,
    /// Joints, in the policy's own order: all of the robot's.
    pub joints: Vec<String>,
    /// What it observes, in order.
    pub observation: Vec<ObservationTerm>,
    /// What its output means.
    pub action: Action,
    /// Gains that its joint targets are followed with.
    pub gains: Gains,
}

/// What a policy's output means: `target = default + scale · output`, rad.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Action {
    /// The quantity that the output sets.
    pub kind: ActionKind,
    /// Radians per unit of output.
    pub scale: PerJoint,
    /// The output is clipped to ± this; 100 by default, as in `legged_gym`.
    #[serde(default = "clip")]
    pub clip: f64,
    /// Position at an output of zero, rad; every joint by name.
    pub default_position_rad: BTreeMap<String, f64>,
}

/// The quantity that a policy's output sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActionKind {
    /// Position targets of the joints.
    JointPosition,
}

/// Gains of the PD law.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gains {
    /// Stiffness, N·m/rad.
    pub stiffness_nm_per_rad: PerJoint,
    /// Damping, N·m·s/rad.
    pub damping_nms_per_rad: PerJoint,
}

fn rate_hz() -> f64 {
    50.0
}

fn clip() -> f64 {
    100.0
}

/// A part of a contract that does not fit: field, what was found, what would be right.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{field}: found {found}, wanted {wanted}")]
pub struct ContractError {
    /// The field, such as `action.scale`.
    pub field: String,
    /// What stands there.
    pub found: String,
    /// What would be right.
    pub wanted: String,
}

impl ContractError {
    /// An error about `field`.
    pub fn new(field: impl Into<String>, found: impl Display, wanted: impl Display) -> Self {
        Self { field: field.into(), found: found.to_string(), wanted: wanted.to_string() }
    }
}

impl From<ContractError> for SkillError {
    fn from(error: ContractError) -> Self {
        Self::new(ErrorCode::Parameters, error.to_string())
    }
}

/// `value` if it is inside; NaN never is.
pub(crate) fn inside(
    field: impl Into<String>,
    value: f64,
    range: RangeInclusive<f64>,
) -> Result<f64, ContractError> {
    if range.contains(&value) {
        return Ok(value);
    }
    Err(ContractError::new(field, value, format!("{} to {}", range.start(), range.end())))
}

impl Contract {
    /// What is wrong with this contract on `robot`: the first thing of the joints, of the observation
    /// and of the action each.
    pub fn misfits(&self, robot: &RobotDescription) -> Vec<ContractError> {
        let joints = self.joints_on(robot).map(drop);
        if let Err(error) = joints {
            return vec![error];
        }
        let observation = Observer::new(self, robot).map(drop);
        let action = ActionMap::new(self, robot).map(drop);
        [observation, action].into_iter().filter_map(Result::err).collect()
    }

    /// The command that the policy follows: a velocity, unless it observes a position target.
    ///
    /// # Errors
    /// It observes both.
    pub fn command(&self) -> Result<CommandKind, ContractError> {
        let place = |wanted| self.observation.iter().position(|term| term.term == wanted);
        match (place(Term::VelocityCommand), place(Term::PositionTarget)) {
            (Some(_), Some(target)) => {
                let field = format!("observation[{target}].term");
                let wanted = "either that or velocity_command: a policy follows one command";
                Err(ContractError::new(field, Term::PositionTarget.name(), wanted))
            }
            (None, Some(_)) => Ok(CommandKind::PositionTarget),
            (_, None) => Ok(CommandKind::Velocity),
        }
    }

    /// For each joint in the policy's order, its index on `robot`.
    ///
    /// # Errors
    /// A joint that `robot` lacks, or one that is left out or there twice.
    pub fn joints_on(&self, robot: &RobotDescription) -> Result<Vec<usize>, ContractError> {
        let names: Vec<&str> = robot.joints.iter().map(|joint| joint.name.as_str()).collect();
        let mut indices = Vec::with_capacity(names.len());
        for (position, joint) in self.joints.iter().enumerate() {
            let field = format!("joints[{position}]");
            let index = names.iter().position(|name| name == joint).ok_or_else(|| {
                let wanted = format!("joints of {}: {}", robot.name, names.join(", "));
                ContractError::new(&field, format!("{joint:?}"), wanted)
            })?;
            if indices.contains(&index) {
                return Err(ContractError::new(field, format!("{joint:?} again"), "every joint once"));
            }
            indices.push(index);
        }
        if indices.len() != names.len() {
            let wanted = format!("{}, as {} has", names.len(), robot.name);
            return Err(ContractError::new("joints", format!("{} joints", indices.len()), wanted));
        }
        Ok(indices)
    }
}

#[cfg(test)]
pub(crate) mod tests;
