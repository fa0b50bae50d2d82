//! A log in words: who drove when, why each change came, what went wrong.

use std::fmt;

use serde::Serialize;
use vocaloco_core::decision::{Decision, SkillVerdict};
use vocaloco_core::decision_log::{DecisionLog, Setup};

/// A stretch of ticks with one and the same skill.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Stretch {
    from_s: f64,
    to_s: f64,
    ticks: usize,
    active: String,
}

impl fmt::Display for Stretch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:8.2} to {:.2} s  {} ({} ticks)", self.from_s, self.to_s, self.active, self.ticks)
    }
}

/// The stretches of a log, by the name that `active` gives a tick.
pub(super) fn stretches(decisions: &[Decision], mut active: impl FnMut(&Decision) -> String) -> Vec<Stretch> {
    let mut stretches: Vec<Stretch> = Vec::new();
    for decision in decisions {
        let name = active(decision);
        match stretches.last_mut().filter(|stretch| stretch.active == name) {
            Some(stretch) => {
                stretch.to_s = decision.t_s;
                stretch.ticks += 1;
            }
            None => {
                stretches.push(Stretch { from_s: decision.t_s, to_s: decision.t_s, ticks: 1, active: name });
            }
        }
    }
    stretches
}

/// A change of who drives, and why.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Turn {
    t_s: f64,
    tick: u64,
    from: String,
    to: String,
    why: String,
    skills: Vec<String>,
}

impl fmt::Display for Turn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { t_s, tick, from, to, why, skills } = self;
        write!(f, "{t_s:8.2} s, tick {tick}: {from} → {to}: {why}")?;
        skills.iter().try_for_each(|skill| write!(f, "\n            {skill}"))
    }
}

/// Every change of who drives; the loop begins standing.
pub(super) fn changes(log: &DecisionLog) -> Vec<Turn> {
    let mut before = vocaloco_core::decision::STAND;
    let mut changes = Vec::new();
    for decision in &log.decisions {
        if decision.active != before {
            changes.push(Turn {
                t_s: decision.t_s,
                tick: decision.tick,
                from: before.to_owned(),
                to: decision.active.clone(),
                why: decision.reason.clone(),
                skills: decision.skills.iter().map(verdict).collect(),
            });
            before = &decision.active;
        }
    }
    changes
}

/// Something besides the choice.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Event {
    t_s: f64,
    tick: u64,
    /// Ticks in a row in which it happened.
    ticks: u64,
    what: String,
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:8.2} s, tick {}: {}", self.t_s, self.tick, self.what)?;
        if self.ticks > 1 { write!(f, " ({} ticks)", self.ticks) } else { Ok(()) }
    }
}

/// Every event, one that repeats from tick to tick counted once.
pub(super) fn events(decisions: &[Decision]) -> Vec<Event> {
    let mut events: Vec<Event> = Vec::new();
    for decision in decisions {
        for event in &decision.events {
            let repeats = |before: &&mut Event| {
                before.what == *event && before.tick.checked_add(before.ticks) == Some(decision.tick)
            };
            if let Some(before) = events.last_mut().filter(repeats) {
                before.ticks += 1;
            } else {
                events.push(Event { t_s: decision.t_s, tick: decision.tick, ticks: 1, what: event.clone() });
            }
        }
    }
    events
}

/// One tick, every skill against its threshold.
pub(super) fn tick(decision: &Decision, setup: &Setup) -> Vec<String> {
    let [forward, left, yaw_rate] = decision.command;
    let terrain = match &decision.field {
        Some(field) => {
            let (low, high) = field
                .as_slice()
                .iter()
                .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &h| (low.min(h), high.max(h)));
            format!(
                "terrain {low:+.2} to {high:+.2} m around the field's centre, hash {}",
                decision.heightfield_hash
            )
        }
        None => "no usable terrain".to_owned(),
    };
    let mut lines = vec![
        format!(
            "tick {} at {:.2} s: {} drives, {} chosen",
            decision.tick, decision.t_s, decision.active, decision.choice
        ),
        format!("  {}", decision.reason),
        format!("  command {forward} m/s forward, {left} m/s left, {yaw_rate} rad/s"),
        format!("  {terrain}"),
    ];
    lines.extend(decision.skills.iter().map(|skill| format!("  {}", verdict(skill))));
    if decision.stopped {
        lines.push(format!("  stopped until one skill has won {} ticks", setup.resume_window));
    }
    lines.extend(decision.events.iter().map(|event| format!("  {event}")));
    if let Some(timings) = &decision.timings {
        let (predict, act, total) = (timings.predict_us, timings.act_us, timings.total_us);
        lines.push(format!("  {predict:.0} µs predicting, {act:.0} µs acting, {total:.0} µs in all"));
    }
    lines
}

fn verdict(skill: &SkillVerdict) -> String {
    let number = |value: Option<f32>| value.map_or_else(|| "none".to_owned(), |value| format!("{value:.3}"));
    format!(
        "{}: viability {}, cost of transport {}: {}",
        skill.name,
        number(skill.viability),
        number(skill.cot),
        skill.reason
    )
}
