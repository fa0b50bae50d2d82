//! A skill as the runtime holds it: what drives, what predicts, and the fences around both.

use std::time::Duration;

use vocaloco_plugin_api::{Command, JointTarget, Needs, RobotDescription, RobotState, SkillError};

use super::{RuntimeError, WatchedController, WatchedPredictors};
use crate::heightfield::Field;
use crate::plugin::PluginInstance;
use crate::predictor::Predictor;
use crate::registry::LoadedSkill;
use crate::selector::{Prediction, Rule};

/// Why a call came to nothing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CallFault {
    /// It took longer than its budget, or an earlier one still hangs.
    #[error("found no answer, wanted one within {:.1} ms", 1e3 * .0.as_secs_f64())]
    Overrun(Duration),
    /// It failed; the line for people.
    #[error("{0}")]
    Failed(String),
}

impl From<SkillError> for CallFault {
    fn from(error: SkillError) -> Self {
        Self::Failed(error.message.into())
    }
}

/// What drives the joints while its skill is active: a plugin's instance, or a test's stand-in.
pub trait Controller: Send {
    /// Forget everything; called on activation.
    ///
    /// # Errors
    /// When the controller cannot start from `state`.
    fn reset(&mut self, state: &RobotState<'_>) -> Result<(), CallFault>;

    /// One tick: fills `joints`, in the robot's order.
    ///
    /// # Errors
    /// When the controller has no targets for this tick.
    fn act(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), CallFault>;

    /// The first tick: [`reset`](Self::reset), then [`act`](Self::act), within one budget.
    ///
    /// # Errors
    /// As either, with its name.
    fn begin(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), (&'static str, CallFault)> {
        self.reset(state).map_err(|fault| ("reset", fault))?;
        self.act(state, command, joints).map_err(|fault| ("act", fault))
    }

    /// Calls have another budget from now on, where they have any.
    fn set_budget(&mut self, _: Duration) {}

    /// The number of the process that it runs in, where that is not this one.
    fn process(&self) -> Option<u32> {
        None
    }

    /// The loop starts over: what has ended for good in the last run is there again for the next.
    fn revive(&mut self) {}
}

impl Controller for PluginInstance {
    fn reset(&mut self, state: &RobotState<'_>) -> Result<(), CallFault> {
        Ok(Self::reset(self, state)?)
    }

    fn act(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), CallFault> {
        Ok(Self::act(self, state, command, joints)?)
    }

    fn process(&self) -> Option<u32> {
        Self::process(self)
    }

    fn revive(&mut self) {
        Self::revive(self);
    }
}

/// What predicts a skill's viability and cost: its two networks, an oracle, or a test's stand-in.
pub trait Predict: Send {
    /// The prediction for a field, NaN where there is none, and what failed.
    fn predict(&mut self, field: &Field) -> (Prediction, Option<CallFault>);

    /// Predictions have another budget from now on, where they have any.
    fn set_budget(&mut self, _: Duration) {}
}

/// The two networks of a skill.
#[derive(Debug)]
pub struct Networks {
    /// Viability.
    pub viability: Predictor,
    /// Cost of transport.
    pub cot: Predictor,
}

impl Predict for Networks {
    fn predict(&mut self, field: &Field) -> (Prediction, Option<CallFault>) {
        let mut failed = None;
        let mut value = |predicted: Result<f32, crate::predictor::ModelError>| {
            predicted.unwrap_or_else(|error| {
                failed = Some(CallFault::Failed(error.to_string()));
                f32::NAN
            })
        };
        let viability = value(self.viability.predict(field));
        let cot = value(self.cot.predict(field));
        (Prediction { viability, cot, strangeness: self.viability.strangeness(field) }, failed)
    }
}

/// A skill, ready to run.
pub struct Skill {
    /// How the selector treats it.
    pub rule: Rule,
    /// What its controller reads each tick.
    pub needs: Needs,
    /// What drives.
    pub controller: Box<dyn Controller>,
    /// What predicts.
    pub predictors: Box<dyn Predict>,
}

impl Skill {
    /// A loaded skill with an instance of its plugin made.
    ///
    /// # Errors
    /// The plugin refuses, or the skill lacks its predictors.
    pub fn of(loaded: LoadedSkill, robot: &RobotDescription) -> Result<Self, RuntimeError> {
        let rule = Self::rule_of(&loaded);
        let controller = Box::new(loaded.create(robot)?);
        let (Some(viability), Some(cot)) = (loaded.viability, loaded.cot) else {
            return Err(RuntimeError::NoPredictors(rule.name));
        };
        let predictors = Box::new(Networks { viability, cot });
        Ok(Self { rule, needs: loaded.needs, controller, predictors })
    }

    /// The same with its calls on threads of their own and budgets for them.
    pub(super) fn watched(self, act: Duration, predict: Duration) -> Result<Self, RuntimeError> {
        let Self { rule, needs, controller, predictors } = self;
        let name = &rule.name;
        let no_thread = |error: std::io::Error| RuntimeError::Thread(name.clone(), error.to_string());
        let controller = WatchedController::start(name, controller, act).map_err(no_thread)?;
        let predictors = WatchedPredictors::start(name, predictors, predict).map_err(no_thread)?;
        Ok(Self { controller: Box::new(controller), predictors: Box::new(predictors), needs, rule })
    }

    /// The selector's rule of a loaded skill, with what its deployment says of it.
    pub fn rule_of(loaded: &LoadedSkill) -> Rule {
        let manifest = &loaded.manifest;
        let viability_threshold = manifest.selection.viability_threshold;
        Rule {
            name: manifest.name.clone(),
            viability_threshold,
            hold_threshold: loaded.hold_threshold.unwrap_or(viability_threshold),
            cost_margin: manifest.selection.cost_margin,
            command: manifest.command,
            time_limit_s: manifest.rollout.time_limit_s,
            committed: manifest.selection.committed,
        }
    }
}

/// What a joint may be told: beyond it a controller is broken, whatever it meant.
#[derive(Clone, Debug)]
pub(super) struct Limits(Vec<JointLimits>);

#[derive(Clone, Debug)]
struct JointLimits {
    name: String,
    lower_rad: f32,
    upper_rad: f32,
    effort_nm: f32,
}

/// Largest stiffness, N·m/rad, and damping, N·m·s/rad, that a drive is given.
const MAX_STIFFNESS: f32 = 1000.0;
const MAX_DAMPING: f32 = 100.0;
/// Smallest: a drive without gains lets the robot fall.
const MIN_STIFFNESS: f32 = 1.0;
const MIN_DAMPING: f32 = 0.01;
/// Slack of a position target beyond the joint's range, rad.
const SLACK_RAD: f32 = 0.2;

impl Limits {
    pub(super) fn of(robot: &RobotDescription) -> Self {
        let limits = |joint: &vocaloco_plugin_api::JointDescription| JointLimits {
            name: joint.name.to_string(),
            lower_rad: joint.lower_rad as f32,
            upper_rad: joint.upper_rad as f32,
            effort_nm: joint.effort_nm as f32,
        };
        Self(robot.joints.iter().map(limits).collect())
    }

    /// Checks every target; each comparison is phrased so that NaN fails.
    ///
    /// Feed-forward torque is often folded into the position target (`q* + τ/k`), so a target may
    /// lie outside the joint's range by as much as its drive's effort is worth.
    ///
    /// # Errors
    /// One line: joint, quantity, what was found, what would be right.
    pub(super) fn check(&self, joints: &[JointTarget]) -> Result<(), String> {
        for (target, joint) in joints.iter().zip(&self.0) {
            let wanted = |quantity: &str, found: f32, least: f32, greatest: f32| {
                let inside = found >= least && found <= greatest;
                let name = &joint.name;
                if inside {
                    Ok(())
                } else {
                    Err(format!("{name}: {quantity} {found}, {least} to {greatest} wanted"))
                }
            };
            // First, since what a controller leaves out is no number here.
            let folded = joint.effort_nm / target.stiffness_nm_per_rad.max(MIN_STIFFNESS) + SLACK_RAD;
            let (least, greatest) = (joint.lower_rad - folded, joint.upper_rad + folded);
            wanted("position_rad", target.position_rad, least, greatest)?;
            wanted("stiffness_nm_per_rad", target.stiffness_nm_per_rad, MIN_STIFFNESS, MAX_STIFFNESS)?;
            wanted("damping_nms_per_rad", target.damping_nms_per_rad, MIN_DAMPING, MAX_DAMPING)?;
            wanted("feed_forward_nm", target.feed_forward_nm, -joint.effort_nm, joint.effort_nm)?;
        }
        Ok(())
    }
}
