//! `--what-if`: the recorded predictions under other rules.

use std::fmt;
use std::str::FromStr;

use serde::Serialize;
use vocaloco_core::decision::SkillVerdict;
use vocaloco_core::decision_log::DecisionLog;
use vocaloco_core::replay::replay;
use vocaloco_core::selector::Prediction;

use super::story::{Stretch, stretches};

/// Changes to the recorded rules.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Changes(Vec<Change>);

#[derive(Clone, Debug, PartialEq)]
enum Change {
    Threshold(String, f32),
    Window(usize),
    StopWindow(usize),
    ResumeWindow(usize),
}

impl FromStr for Changes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        text.split(',').map(|part| part.trim().parse()).collect::<Result<_, _>>().map(Self)
    }
}

impl FromStr for Change {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (key, value) = text.split_once('=').ok_or_else(|| format!("found {text:?}, wanted KEY=VALUE"))?;
        if let Some(skill) = key.strip_prefix("threshold.") {
            let threshold: Option<f32> = value.parse().ok().filter(|value| (0.0..=1.0).contains(value));
            let threshold = threshold.ok_or_else(|| format!("{key}: found {value:?}, wanted 0 to 1"))?;
            return Ok(Self::Threshold(skill.to_owned(), threshold));
        }
        let window = match key {
            "window" => Self::Window,
            "stop_window" => Self::StopWindow,
            "resume_window" => Self::ResumeWindow,
            _ => {
                let wanted = "threshold.SKILL, window, stop_window or resume_window";
                return Err(format!("found {key:?}, wanted {wanted}"));
            }
        };
        let ticks: Option<usize> = value.parse().ok().filter(|ticks| (1..=1000).contains(ticks));
        ticks.map(window).ok_or_else(|| format!("{key}: found {value:?}, wanted 1 to 1000 ticks"))
    }
}

impl fmt::Display for Changes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, change) in self.0.iter().enumerate() {
            let comma = if index > 0 { "," } else { "" };
            match change {
                Change::Threshold(skill, value) => write!(f, "{comma}threshold.{skill}={value}")?,
                Change::Window(ticks) => write!(f, "{comma}window={ticks}")?,
                Change::StopWindow(ticks) => write!(f, "{comma}stop_window={ticks}")?,
                Change::ResumeWindow(ticks) => write!(f, "{comma}resume_window={ticks}")?,
            }
        }
        Ok(())
    }
}

/// What would have been.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Alternative {
    pub(super) changes: String,
    /// Ticks with another choice or another active skill.
    pub(super) differing_ticks: usize,
    pub(super) stretches: Vec<Stretch>,
}

/// Decides a log over again under `changes`. A stop window that was the same as the switch window
/// follows it, as in a deployment.
///
/// # Errors
/// When a threshold is for a skill that the log does not know.
pub(super) fn decide(changes: &Changes, log: &DecisionLog) -> anyhow::Result<Alternative> {
    let mut rules = log.setup.rules();
    let mut windows = log.setup.windows();
    let names_stop = changes.0.iter().any(|change| matches!(change, Change::StopWindow(_)));
    let stop_follows = windows.stop == windows.switch && !names_stop;
    for change in &changes.0 {
        match change {
            Change::Threshold(skill, threshold) => {
                let rule = rules.iter_mut().find(|rule| rule.name == *skill).ok_or_else(|| {
                    let names: Vec<_> = log.setup.skills.iter().map(|skill| skill.name.as_str()).collect();
                    anyhow::anyhow!(
                        "--what-if threshold: found {skill:?}, wanted one of {}",
                        names.join(", ")
                    )
                })?;
                rule.set_threshold(*threshold);
            }
            Change::Window(ticks) => {
                windows.switch = *ticks;
                if stop_follows {
                    windows.stop = *ticks;
                }
            }
            Change::StopWindow(ticks) => windows.stop = *ticks,
            Change::ResumeWindow(ticks) => windows.resume = *ticks,
        }
    }
    let replayed = replay(&rules, windows, &log.decisions, |decision, skill| {
        decision.skills.get(skill).map_or(Prediction::NONE, SkillVerdict::prediction)
    });
    let differing = replayed.iter().zip(&log.decisions).filter(|(again, then)| !again.agrees_with(then));
    let mut active = replayed.iter().map(|again| again.active.clone());
    Ok(Alternative {
        changes: changes.to_string(),
        differing_ticks: differing.count(),
        stretches: stretches(&log.decisions, |_| active.next().unwrap_or_default()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_read_back_as_they_were_written() {
        let text = "threshold.walk=0.9,window=5,stop_window=1,resume_window=50";
        assert_eq!(text.parse::<Changes>().map(|changes| changes.to_string()), Ok(text.to_owned()));
    }

    #[test]
    fn a_change_that_makes_no_sense_says_what_would() {
        for (text, wanted) in [
            ("threshold.walk=1.5", "wanted 0 to 1"),
            ("threshold.walk=NaN", "wanted 0 to 1"),
            ("window=0", "wanted 1 to 1000 ticks"),
            ("window", "wanted KEY=VALUE"),
            ("speed=3", "wanted threshold.SKILL, window"),
            ("", "wanted KEY=VALUE"),
        ] {
            let error = text.parse::<Changes>().unwrap_err();
            assert!(error.contains(wanted), "{text:?}: {error}");
        }
    }
}
