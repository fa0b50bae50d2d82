//! A log decided over again: the same selector and switch filter, fed with recorded or with fresh
//! predictions, under the recorded rules or under others.

use vocaloco_plugin_api::Command;

use crate::decision::{Decision, Forced, STAND, STOP, SkillVerdict};
use crate::decision_log::Setup;
use crate::moves::Moves;
use crate::selector::{Choice, Prediction, Reason, Rule, Selector};
use crate::switch::{Active, SwitchFilter, Windows};

/// What a tick comes to the second time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Replayed {
    /// A skill, or `stop`.
    pub choice: String,
    /// A skill, or `stand`.
    pub active: String,
}

impl Replayed {
    /// Whether the record says the same.
    pub fn agrees_with(&self, decision: &Decision) -> bool {
        self.choice == decision.choice && self.active == decision.active
    }
}

/// Decides every tick again, under `rules` and `windows`, with the predictions that `predict` gives
/// for a tick and a skill; see [`Replayer::tick`].
pub fn replay(
    rules: &[Rule],
    windows: Windows,
    decisions: &[Decision],
    mut predict: impl FnMut(&Decision, usize) -> Prediction,
) -> Vec<Replayed> {
    let mut replayer = Replayer::new(rules.to_vec(), windows);
    decisions.iter().map(|decision| replayer.tick(decision, &mut predict)).collect()
}

/// A log being decided over again, tick by tick: one that is too long for memory, or in several files.
#[derive(Debug)]
pub struct Replayer {
    rules: Vec<Rule>,
    selector: Selector,
    filter: SwitchFilter,
    predictions: Vec<Prediction>,
    reasons: Vec<Reason>,
}

impl Replayer {
    /// One that stands at the start of a loop.
    pub fn new(rules: Vec<Rule>, windows: Windows) -> Self {
        Self {
            selector: Selector::new(rules.clone()),
            rules,
            filter: SwitchFilter::new(windows),
            predictions: Vec::new(),
            reasons: Vec::new(),
        }
    }

    /// Decides the next tick again, with the predictions that `predict` gives for it and a skill.
    ///
    /// What overruled the window then (unknown terrain, unusable measurements, a fall, a zero command) does so
    /// again; a plugin that failed, or was late, does so again if it is the active one in the same tick. Skills that
    /// came while the loop ran come again, under the rules they had; those that went on keep `rules`.
    pub fn tick(
        &mut self,
        decision: &Decision,
        mut predict: impl FnMut(&Decision, usize) -> Prediction,
    ) -> Replayed {
        let Self { rules, selector, filter, predictions, reasons } = self;
        if let Some(roster) = &decision.roster {
            let after = roster.iter().map(|skill| (skill.setup.name.as_str(), skill.is_new));
            let moves = Moves::between(rules.iter().map(|rule| rule.name.as_str()), after);
            let before = std::mem::take(rules);
            *rules = moves.carry(before, |skill| roster[skill].setup.rule()).0;
            selector.adopt(rules.clone(), &moves);
            filter.adopt(&moves);
        }
        let forced = decision.forced;
        let mut choice = Choice::Stop;
        if matches!(forced, Some(Forced::Terrain | Forced::Observation)) {
            filter.stop_now();
        } else {
            for (skill, then) in decision.skills.iter().enumerate().take(rules.len()) {
                // Its prediction was late for the third time, before anything was chosen.
                if then.reason == Reason::TooSlow && then.viability.is_none() && then.cot.is_none() {
                    selector.retire(skill, Reason::TooSlow);
                }
            }
            predictions.clear();
            predictions.extend((0..rules.len()).map(|skill| predict(decision, skill)));
            let [forward, left, yaw_rate] = decision.command;
            let command = Command::velocity(forward, left, yaw_rate);
            choice = selector.choose(predictions, &command, filter.active(), reasons);
            let viable = |skill: usize| matches!(reasons.get(skill), Some(Reason::Viable { .. }));
            let verdict = match filter.active() {
                Active::Skill(skill) => reasons.get(skill).copied(),
                Active::Stand => None,
            };
            if verdict.is_some_and(Reason::is_out_of_service) || forced == Some(Forced::Fallen) {
                filter.stop_now();
                choice = Choice::Stop;
            } else if forced == Some(Forced::ZeroCommand) {
                filter.stand_now();
            } else {
                // Logs from before `committed` was recorded say so where nothing else overruled the window.
                if decision.committed || forced == Some(Forced::Committed) {
                    filter.count(choice, viable);
                } else {
                    filter.step(choice, viable);
                }
                if let Active::Skill(skill) = filter.active()
                    && let Some(why @ (Reason::PluginFailed | Reason::TooSlow)) =
                        decision.skills.get(skill).map(|then| then.reason)
                {
                    selector.retire(skill, why);
                    filter.stop_now();
                    choice = Choice::Stop;
                }
            }
        }
        let name = |skill: usize| rules[skill].name.clone();
        Replayed {
            choice: match choice {
                Choice::Stop => STOP.to_owned(),
                Choice::Skill(skill) => name(skill),
            },
            active: match filter.active() {
                // The skill is the active one still, and was late in this tick.
                _ if forced == Some(Forced::Overrun) => STAND.to_owned(),
                Active::Stand => STAND.to_owned(),
                Active::Skill(skill) => name(skill),
            },
        }
    }

    /// Decides the next tick again, with the recorded predictions.
    pub fn as_recorded(&mut self, decision: &Decision) -> Replayed {
        self.tick(decision, |decision, skill| {
            decision.skills.get(skill).map_or(Prediction::NONE, SkillVerdict::prediction)
        })
    }
}

/// The recorded predictions under the recorded rules: what must come out as it did.
pub fn as_recorded(setup: &Setup, decisions: &[Decision]) -> Vec<Replayed> {
    let mut replayer = Replayer::new(setup.rules(), setup.windows());
    decisions.iter().map(|decision| replayer.as_recorded(decision)).collect()
}
