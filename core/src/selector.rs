//! Which skill should walk: the cheapest of those that are viable, or stop.
//!
//! Knows numbers only: predictions, thresholds and the command. It takes a skill out of service
//! when its predictions cannot be used three times in a row; all else is judged anew each tick.

#[cfg(test)]
mod tests;

use std::fmt;

use serde::{Deserialize, Serialize};
use vocaloco_plugin_api::{Command, CommandKind};

use crate::manifest::CommandRange;
use crate::moves::Moves;
use crate::switch::Active;

/// Unusable predictions in a row that take a skill out of service.
pub const UNUSABLE_IN_A_ROW: u32 = 3;
/// Slack on a declared command range, m/s: f32 commands against ranges written in decimals.
const COMMAND_SLACK: f64 = 1e-5;
/// Below this in every component a velocity command is zero, m/s and rad/s.
const ZERO: f32 = 1e-3;

/// What a skill's two predictors say; NaN where one failed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Probability of getting ahead without a base collision, 0 to 1.
    pub viability: f32,
    /// Cost of transport.
    pub cot: f32,
    /// How unlike the terrain that the predictors know this one is, up to 1 known; none where they do
    /// not say what they know.
    pub strangeness: Option<f32>,
}

impl Prediction {
    /// No prediction at all.
    pub const NONE: Self = Self::of(f32::NAN, f32::NAN);

    /// Of predictors that do not say what terrain they know.
    pub const fn of(viability: f32, cot: f32) -> Self {
        Self { viability, cot, strangeness: None }
    }

    /// Whether both numbers can be used.
    pub fn is_usable(&self) -> bool {
        (0.0..=1.0).contains(&self.viability) && self.cot.is_finite()
    }
}

/// What the selector knows of a skill.
#[derive(Clone, Debug, PartialEq)]
pub struct Rule {
    /// Its name.
    pub name: String,
    /// Least predicted viability at which it may be chosen.
    pub viability_threshold: f32,
    /// Least predicted viability at which it may go on while it drives; not above the threshold.
    pub hold_threshold: f32,
    /// Share by which another viable skill must be cheaper once this one has won.
    pub cost_margin: f32,
    /// Commands it takes.
    pub command: CommandRange,
    /// Time for the way to a position target, s.
    pub time_limit_s: f64,
    /// Once active, it stays until its position target, its time limit or a fault.
    pub committed: bool,
}

impl Rule {
    /// Sets another viability threshold; what a skill that drives is held to follows where it was the same, and
    /// is never above it.
    pub fn set_threshold(&mut self, threshold: f32) {
        let follows = self.hold_threshold >= self.viability_threshold;
        self.viability_threshold = threshold;
        self.hold_threshold = if follows { threshold } else { self.hold_threshold.min(threshold) };
    }
}

/// Why a skill is, or is not, viable this tick.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "code", rename_all = "snake_case")]
pub enum Reason {
    /// Predicted viability reaches its threshold.
    Viable {
        /// The threshold.
        threshold: f32,
    },
    /// Predicted viability is below its threshold.
    BelowThreshold {
        /// The threshold.
        threshold: f32,
    },
    /// Terrain unlike any that its predictors were fitted to, whatever they say of it.
    UnknownTerrain {
        /// How unlike: a known one has at most 1.
        strangeness: f32,
    },
    /// Predicted cost of transport is zero or less, which no walking robot has.
    CotNotPositive,
    /// A prediction is not a finite number, or viability not within 0 to 1.
    Unusable,
    /// The forward command is outside its range.
    CommandOutside {
        /// The command, m/s.
        found: f32,
        /// Smallest it takes, m/s.
        least: f32,
        /// Greatest it takes, m/s.
        greatest: f32,
    },
    /// The command is of the other kind.
    CommandKind,
    /// The terrain is not known, so nothing was predicted.
    NoTerrain,
    /// The measurement cannot be used, so nothing was predicted.
    NoObservation,
    /// Out of service: its predictions failed three times in a row.
    PredictionsFailed,
    /// Out of service: its plugin failed.
    PluginFailed,
    /// Out of service: three of its calls within a second took longer than their budget.
    TooSlow,
}

impl Reason {
    /// Whether the skill will not be looked at again in this run.
    pub const fn is_out_of_service(self) -> bool {
        matches!(self, Self::PredictionsFailed | Self::PluginFailed | Self::TooSlow)
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Viable { threshold } => write!(f, "viable: at or above {threshold}"),
            Self::BelowThreshold { threshold } => write!(f, "viability below {threshold}"),
            Self::UnknownTerrain { strangeness } => {
                write!(
                    f,
                    "terrain unlike any it was trained on: strangeness {strangeness:.2}, at most 1 is known"
                )
            }
            Self::CotNotPositive => f.write_str("predicted cost of transport is not positive"),
            Self::Unusable => f.write_str("a prediction is not a usable number"),
            Self::CommandOutside { found, least, greatest } => {
                write!(f, "forward command {found} m/s outside {least} to {greatest} m/s")
            }
            Self::CommandKind => f.write_str("takes another kind of command"),
            Self::NoTerrain => f.write_str("terrain unknown"),
            Self::NoObservation => f.write_str("measurement unusable"),
            Self::PredictionsFailed => f.write_str("out of service: three unusable predictions in a row"),
            Self::PluginFailed => f.write_str("out of service: its plugin failed"),
            Self::TooSlow => f.write_str("out of service: three calls over their budget within a second"),
        }
    }
}

/// The selector's answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// No skill is viable.
    Stop,
    /// This skill, by its place in the deployment.
    Skill(usize),
}

/// Judges the skills of a deployment.
#[derive(Clone, Debug)]
pub struct Selector {
    rules: Vec<Rule>,
    unusable: Vec<u32>,
    out_of_service: Vec<Option<Reason>>,
    winner: Option<usize>,
}

impl Selector {
    /// A selector with every skill in service.
    pub fn new(rules: Vec<Rule>) -> Self {
        let count = rules.len();
        Self { rules, unusable: vec![0; count], out_of_service: vec![None; count], winner: None }
    }

    /// The rules, in the deployment's order.
    pub fn rules(&self) -> &[Rule] {
        &self.rules
    }

    /// Why a skill is out of service; none while it serves.
    pub fn out_of_service(&self, skill: usize) -> Option<Reason> {
        self.out_of_service[skill]
    }

    /// Takes a skill out of service for good.
    pub fn retire(&mut self, skill: usize, why: Reason) {
        self.out_of_service[skill].get_or_insert(why);
    }

    /// Puts every skill back into service.
    pub fn restart(&mut self) {
        self.unusable.fill(0);
        self.out_of_service.fill(None);
        self.winner = None;
    }

    /// Other skills from now on; what is known of those that go on stays known.
    pub(crate) fn adopt(&mut self, rules: Vec<Rule>, moves: &Moves) {
        self.rules = rules;
        self.unusable = moves.carry(std::mem::take(&mut self.unusable), |_| 0).0;
        self.out_of_service = moves.carry(std::mem::take(&mut self.out_of_service), |_| None).0;
        self.winner = self.winner.and_then(|winner| moves.to(winner));
    }

    /// Judges every skill and chooses: of the viable ones the lowest cost of transport, of equal
    /// ones the first. `reasons` gets one entry a skill.
    ///
    /// The winner of the tick before stays while it is viable and no other is cheaper by more than
    /// its [`Rule::cost_margin`]: with fresh noise on every field, two skills of nearly one cost would
    /// otherwise win by turns, no window would ever agree, and the robot would stop before stairs
    /// that both can climb.
    ///
    /// The skill that drives, if one does, is held to its [`Rule::hold_threshold`]: a stop half-way down
    /// a flight may be more dangerous than what made the prediction sink.
    ///
    /// # Source
    /// Wu et al. (2025), selection steps 3 and 4; commands, unusable predictions, costs that are not
    /// positive, the margin and holding are our own; a margin of 0 and a [`Rule::hold_threshold`] equal to
    /// the threshold are the paper's rule.
    pub fn choose(
        &mut self,
        predictions: &[Prediction],
        command: &Command,
        drives: Active,
        reasons: &mut Vec<Reason>,
    ) -> Choice {
        reasons.clear();
        let mut cheapest: Option<(usize, f32)> = None;
        for (skill, prediction) in predictions.iter().enumerate().take(self.rules.len()) {
            let reason = self.judge(skill, *prediction, command, drives == Active::Skill(skill));
            reasons.push(reason);
            let is_cheaper = cheapest.is_none_or(|(_, cot)| prediction.cot < cot);
            if matches!(reason, Reason::Viable { .. }) && is_cheaper {
                cheapest = Some((skill, prediction.cot));
            }
        }
        let kept = self.winner.filter(|&winner| {
            let margin = self.rules[winner].cost_margin;
            matches!(reasons.get(winner), Some(Reason::Viable { .. }))
                && cheapest.is_some_and(|(_, cot)| cot >= predictions[winner].cot * (1.0 - margin))
        });
        self.winner = kept.or(cheapest.map(|(skill, _)| skill));
        self.winner.map_or(Choice::Stop, Choice::Skill)
    }

    fn judge(&mut self, skill: usize, prediction: Prediction, command: &Command, drives: bool) -> Reason {
        if let Some(why) = self.out_of_service[skill] {
            return why;
        }
        if !prediction.is_usable() {
            self.unusable[skill] += 1;
            if self.unusable[skill] >= UNUSABLE_IN_A_ROW {
                self.retire(skill, Reason::PredictionsFailed);
                return Reason::PredictionsFailed;
            }
            return Reason::Unusable;
        }
        self.unusable[skill] = 0;
        let rule = &self.rules[skill];
        if let Some(reason) = refusal(&rule.command, command) {
            return reason;
        }
        let threshold = if drives { rule.hold_threshold } else { rule.viability_threshold };
        // Phrased as "is inside", so that NaN is refused too.
        let strange = prediction.strangeness.filter(|strangeness| !(0.0..=1.0).contains(strangeness));
        if let Some(strangeness) = strange {
            Reason::UnknownTerrain { strangeness }
        } else if prediction.cot <= 0.0 {
            Reason::CotNotPositive
        } else if prediction.viability >= threshold {
            Reason::Viable { threshold }
        } else {
            Reason::BelowThreshold { threshold }
        }
    }
}

/// Whether a command asks for no motion at all.
pub fn is_zero(command: &Command) -> bool {
    command.kind == CommandKind::Velocity && command.velocity.iter().all(|value| value.abs() < ZERO)
}

fn refusal(range: &CommandRange, command: &Command) -> Option<Reason> {
    // A skill that goes to a target sets it itself, along the commanded velocity.
    if command.kind != CommandKind::Velocity && range.kind != command.kind {
        return Some(Reason::CommandKind);
    }
    let [least, greatest] = range.forward_m_per_s;
    let found = command.velocity[0];
    let forward = f64::from(found);
    let open = range.kind == CommandKind::PositionTarget && greatest <= least;
    let inside = forward >= least - COMMAND_SLACK && forward <= greatest + COMMAND_SLACK;
    if inside || open {
        return None;
    }
    Some(Reason::CommandOutside { found, least: least as f32, greatest: greatest as f32 })
}
