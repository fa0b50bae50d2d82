//! One term of an observation.

use serde::{Deserialize, Serialize};

use super::HeightPatch;
use crate::contract::{ContractError, Factor, MAX_TERMS, inside};

/// What is measured. J joints in the contract's order, F feet in the robot's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Term {
    /// Of the base origin, m/s, base frame; 3.
    BaseLinearVelocity,
    /// rad/s, base frame; 3.
    BaseAngularVelocity,
    /// Unit vector of gravity, base frame; 3.
    ProjectedGravity,
    /// Commanded forward m/s, left m/s, yaw rate rad/s; 3.
    VelocityCommand,
    /// Commanded target in the yaw-aligned base frame: x m, y m, heading rad, time left s; 4.
    PositionTarget,
    /// Position less `action.default_position_rad`, rad; J.
    JointPosition,
    /// rad/s; J.
    JointVelocity,
    /// Measured or estimated, N·m; J.
    JointTorque,
    /// The policy's previous output, clipped, before its scale; zero after a reset; J.
    LastAction,
    /// 1 touching, 0 not; F.
    FootContact,
    /// sin 2πφ and cos 2πφ with φ = ticks since reset / (`rate_hz` · `period_s`) + `initial_phase`; 2.
    GaitPhase,
    /// −`offset_m` − h with h the terrain's height relative to the base origin, m; as many as the
    /// patch has points. See [`HeightPatch`].
    Heights,
}

impl Term {
    /// Its id in manifests.
    pub const fn name(self) -> &'static str {
        match self {
            Self::BaseLinearVelocity => "base_linear_velocity",
            Self::BaseAngularVelocity => "base_angular_velocity",
            Self::ProjectedGravity => "projected_gravity",
            Self::VelocityCommand => "velocity_command",
            Self::PositionTarget => "position_target",
            Self::JointPosition => "joint_position",
            Self::JointVelocity => "joint_velocity",
            Self::JointTorque => "joint_torque",
            Self::LastAction => "last_action",
            Self::FootContact => "foot_contact",
            Self::GaitPhase => "gait_phase",
            Self::Heights => "heights",
        }
    }
}

/// A term as the policy sees it: `clamp(value, ±clip) · scale`, the latest `history` values of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObservationTerm {
    /// What is measured.
    pub term: Term,
    /// Factor on the physical value; 1 by default.
    #[serde(default)]
    pub scale: Factor,
    /// Bound on the physical value, before the scale; none by default, 1 m for heights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clip: Option<f64>,
    /// How many values are seen, the oldest first; 1 by default. After a reset all are the first value.
    #[serde(default = "one")]
    pub history: usize,
    /// Period of the cycle, s; `gait_phase` alone has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period_s: Option<f64>,
    /// Which points; `heights` alone has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub patch: Option<HeightPatch>,
}

fn one() -> usize {
    1
}

impl ObservationTerm {
    /// The term with this scale, neither clip nor history.
    pub fn new(term: Term, scale: f64) -> Self {
        Self { term, scale: Factor::All(scale), clip: None, history: 1, period_s: None, patch: None }
    }

    /// A gait phase of this period.
    pub fn gait_phase(period_s: f64) -> Self {
        Self { period_s: Some(period_s), ..Self::new(Term::GaitPhase, 1.0) }
    }

    /// Heights of this patch, clipped to ±1 m, with this scale.
    pub fn heights(patch: HeightPatch, scale: f64) -> Self {
        Self { patch: Some(patch), clip: Some(1.0), ..Self::new(Term::Heights, scale) }
    }

    /// Checks what depends on no robot; `field` is its own, for errors.
    pub(crate) fn check(&self, field: &str) -> Result<(), ContractError> {
        if let Some(clip) = self.clip {
            inside(format!("{field}.clip"), clip, 1e-6..=1e6)?;
        }
        inside(format!("{field}.history"), self.history as f64, 1.0..=MAX_TERMS as f64)?;
        let name = self.term.name();
        let field_of = |part: &str| format!("{field}.{part}");
        match (self.term, self.period_s) {
            (Term::GaitPhase, Some(period_s)) => {
                inside(field_of("period_s"), period_s, 0.05..=10.0)?;
            }
            (Term::GaitPhase, None) => {
                return Err(ContractError::new(field_of("period_s"), "nothing", "seconds, 0.05 to 10"));
            }
            (_, Some(period_s)) => {
                return Err(ContractError::new(field_of("period_s"), period_s, format!("none for {name}")));
            }
            (_, None) => {}
        }
        match (self.term, &self.patch) {
            (Term::Heights, Some(patch)) => patch.check(&field_of("patch")),
            (Term::Heights, None) => {
                let wanted = "back_m, front_m, half_width_m, resolution_m, offset_m";
                Err(ContractError::new(field_of("patch"), "nothing", wanted))
            }
            (_, Some(_)) => Err(ContractError::new(field_of("patch"), "a patch", format!("none for {name}"))),
            (_, None) => Ok(()),
        }
    }
}
