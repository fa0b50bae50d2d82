//! Which skill should walk: the cheapest of those that are viable, or stop.
//!
//! Knows numbers only: predictions, thresholds and the command. It takes a skill out of service
//! when its predictions cannot be used three times in a row; all else is judged anew each tick.

use std::fmt;

use serde::{Deserialize, Serialize};
use vocaloco_plugin_api::{Command, CommandKind};

use crate::manifest::CommandRange;
use crate::moves::Moves;

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
    /// Share by which another viable skill must be cheaper once this one has won.
    pub cost_margin: f32,
    /// Commands it takes.
    pub command: CommandRange,
    /// Time for the way to a position target, s.
    pub time_limit_s: f64,
    /// Once active, it stays until its position target, its time limit or a fault.
    pub committed: bool,
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
    /// # Source
    /// Wu et al. (2025), selection steps 3 and 4; commands, unusable predictions, costs that are not
    /// positive and the margin are our own; a margin of 0 is the paper's rule.
    pub fn choose(
        &mut self,
        predictions: &[Prediction],
        command: &Command,
        reasons: &mut Vec<Reason>,
    ) -> Choice {
        reasons.clear();
        let mut cheapest: Option<(usize, f32)> = None;
        for (skill, prediction) in predictions.iter().enumerate().take(self.rules.len()) {
            let reason = self.judge(skill, *prediction, command);
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

    fn judge(&mut self, skill: usize, prediction: Prediction, command: &Command) -> Reason {
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
        let threshold = rule.viability_threshold;
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

#[cfg(test)]
mod tests {
    use super::*;

    const FORWARD: Command = Command::velocity(0.6, 0.0, 0.0);

    fn rule(name: &str, viability_threshold: f32) -> Rule {
        let command = CommandRange {
            kind: CommandKind::Velocity,
            forward_m_per_s: [0.4, 0.7],
            target_distance_m: None,
        };
        Rule {
            name: name.into(),
            viability_threshold,
            cost_margin: 0.0,
            command,
            time_limit_s: 4.0,
            committed: false,
        }
    }

    fn selector() -> Selector {
        Selector::new(vec![rule("walk", 0.95), rule("ascend", 0.925), rule("descend", 0.925)])
    }

    fn choose(
        selector: &mut Selector,
        predictions: [(f32, f32); 3],
        command: &Command,
    ) -> (Choice, Vec<Reason>) {
        let predictions = predictions.map(|(viability, cot)| Prediction::of(viability, cot));
        let mut reasons = Vec::new();
        let choice = selector.choose(&predictions, command, &mut reasons);
        (choice, reasons)
    }

    #[test]
    fn two_skills_of_nearly_one_cost_do_not_win_by_turns_within_the_margin() {
        let walks = Command::velocity(0.6, 0.0, 0.0);
        let turns = |margin: f32| {
            let rules = [rule("walk", 0.95), rule("ascend", 0.925), rule("descend", 0.925)];
            let mut selector = Selector::new(rules.map(|rule| Rule { cost_margin: margin, ..rule }).into());
            let costs = [(0.52, 0.53), (0.54, 0.51), (0.51, 0.53), (0.55, 0.52)];
            costs.map(|(ascend, descend)| {
                choose(&mut selector, [(0.5, 0.3), (0.99, ascend), (0.98, descend)], &walks).0
            })
        };
        let [ascend, descend] = [Choice::Skill(1), Choice::Skill(2)];
        assert_eq!(turns(0.0), [ascend, descend, ascend, descend], "the paper's rule");
        assert_eq!(turns(0.1), [ascend; 4]);
    }

    #[test]
    fn a_margin_keeps_no_winner_that_is_unviable_or_clearly_dearer() {
        let walks = Command::velocity(0.6, 0.0, 0.0);
        let rules = [rule("walk", 0.95), rule("ascend", 0.925), rule("descend", 0.925)];
        let mut selector = Selector::new(rules.map(|rule| Rule { cost_margin: 0.1, ..rule }).into());
        let mut winner = |predictions| choose(&mut selector, predictions, &walks).0;
        assert_eq!(winner([(0.5, 0.3), (0.99, 0.50), (0.98, 0.53)]), Choice::Skill(1));
        assert_eq!(winner([(0.97, 0.44), (0.99, 0.50), (0.98, 0.53)]), Choice::Skill(0), "12 % cheaper");
        assert_eq!(winner([(0.5, 0.44), (0.9, 0.45), (0.98, 0.53)]), Choice::Skill(2), "unviable");
        assert_eq!(winner([(0.5, 0.44), (0.9, 0.45), (0.9, 0.53)]), Choice::Stop);
    }

    #[test]
    fn the_cheapest_viable_skill_wins() {
        let (choice, _) = choose(&mut selector(), [(0.99, 0.2), (0.99, 0.9), (0.99, 0.5)], &FORWARD);
        assert_eq!(choice, Choice::Skill(0));
        let (choice, reasons) = choose(&mut selector(), [(0.94, 0.2), (0.99, 0.9), (0.93, 0.5)], &FORWARD);
        assert_eq!(choice, Choice::Skill(2), "walk is cheaper but below its threshold");
        assert_eq!(reasons[0], Reason::BelowThreshold { threshold: 0.95 });
    }

    #[test]
    fn a_viability_at_its_threshold_is_viable_and_of_equal_costs_the_first_wins() {
        let (choice, _) = choose(&mut selector(), [(0.95, 0.5), (0.925, 0.5), (0.99, 0.5)], &FORWARD);
        assert_eq!(choice, Choice::Skill(0));
    }

    #[test]
    fn with_no_viable_skill_it_stops() {
        let (choice, _) = choose(&mut selector(), [(0.0, 0.2), (0.9, 0.9), (0.92, 0.5)], &FORWARD);
        assert_eq!(choice, Choice::Stop);
    }

    #[test]
    fn a_cost_that_is_not_positive_is_not_viable_but_stays_in_service() {
        let mut selector = selector();
        for _ in 0..10 {
            let (choice, reasons) = choose(&mut selector, [(0.99, 0.0), (0.99, -0.1), (0.99, 0.5)], &FORWARD);
            assert_eq!(choice, Choice::Skill(2));
            assert_eq!(reasons[..2], [Reason::CotNotPositive; 2]);
        }
        assert_eq!(selector.out_of_service(0), None);
    }

    #[test]
    fn three_unusable_predictions_in_a_row_take_a_skill_out_of_service() {
        for bad in [(f32::NAN, 0.2), (0.99, f32::INFINITY), (1.01, 0.2), (-0.01, 0.2)] {
            let mut selector = selector();
            let mut tick = |walk| choose(&mut selector, [walk, (0.99, 0.9), (0.0, 0.5)], &FORWARD);
            for _ in 0..2 {
                assert_eq!(tick(bad), (Choice::Skill(1), tick_reasons(Reason::Unusable)));
            }
            assert_eq!(tick((0.99, 0.2)).0, Choice::Skill(0), "a usable one in between counts anew");
            for _ in 0..2 {
                tick(bad);
            }
            assert_eq!(tick(bad).1[0], Reason::PredictionsFailed);
            assert_eq!(tick((0.99, 0.2)), (Choice::Skill(1), tick_reasons(Reason::PredictionsFailed)));
        }
    }

    fn tick_reasons(walk: Reason) -> Vec<Reason> {
        vec![walk, Reason::Viable { threshold: 0.925 }, Reason::BelowThreshold { threshold: 0.925 }]
    }

    #[test]
    fn a_command_outside_the_declared_range_is_not_viable() {
        let viable = [(0.99, 0.2), (0.99, 0.9), (0.99, 0.5)];
        for (forward, inside) in [(0.39, false), (0.4, true), (0.7, true), (0.71, false), (-0.5, false)] {
            let (choice, reasons) = choose(&mut selector(), viable, &Command::velocity(forward, 0.0, 0.0));
            assert_eq!(choice != Choice::Stop, inside, "{forward} m/s: {reasons:?}");
        }
        let mut target = FORWARD;
        target.kind = CommandKind::PositionTarget;
        assert_eq!(choose(&mut selector(), viable, &target).1, [Reason::CommandKind; 3]);
    }

    #[test]
    fn a_skill_added_with_lower_cost_wins_and_changes_no_other_verdict() {
        let mut grown = selector();
        let (_, before) = choose(&mut grown, [(0.99, 0.3), (0.99, 0.9), (0.1, 0.5)], &FORWARD);
        let mut rules = grown.rules().to_vec();
        rules.push(rule("trot", 0.95));
        let mut grown = Selector::new(rules);
        let predictions = [(0.99, 0.3), (0.99, 0.9), (0.1, 0.5), (0.99, 0.25)];
        let predictions = predictions.map(|(viability, cot)| Prediction::of(viability, cot));
        let mut reasons = Vec::new();
        assert_eq!(grown.choose(&predictions, &FORWARD, &mut reasons), Choice::Skill(3));
        assert_eq!(reasons[..3], before[..]);
    }

    #[test]
    fn only_a_command_without_any_motion_is_zero() {
        assert!(is_zero(&Command::velocity(0.0, -0.0, 0.0)));
        assert!(!is_zero(&Command::velocity(0.0, 0.0, 0.2)));
        assert!(!is_zero(&Command::velocity(-0.1, 0.0, 0.0)));
    }

    #[test]
    fn terrain_unlike_the_training_s_is_not_viable_however_sure_the_prediction() {
        let mut selector = selector();
        let mut reasons = Vec::new();
        let strange =
            |strangeness: f32| Prediction { strangeness: Some(strangeness), ..Prediction::of(0.99, 0.2) };
        for strangeness in [1.01, 40.0, f32::NAN, f32::INFINITY, -1.0] {
            let predictions = [strange(strangeness), strange(1.0), Prediction::of(0.99, 0.5)];
            assert_eq!(
                selector.choose(&predictions, &FORWARD, &mut reasons),
                Choice::Skill(1),
                "{strangeness}"
            );
            assert!(matches!(reasons[0], Reason::UnknownTerrain { .. }), "{strangeness}: {}", reasons[0]);
            assert!(!reasons[0].is_out_of_service());
        }
    }
}
