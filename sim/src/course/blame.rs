//! Which skill a crash is laid at, and what it had predicted.

use serde::{Deserialize, Serialize};
use vocaloco_core::decision::{Decision, STAND};

use super::{CourseRun, Outcome};
use crate::driver::TICK_S;

/// How far back before a crash the skill is asked what it saw, s: one horizon of 1.5 m at 0.5 m/s.
const LOOK_BACK_S: f64 = 3.0;
/// The last of a crash: the base may be anyhow, and no refusal helps, s.
const TOO_LATE_S: f64 = 0.5;

/// A crash, and what would have kept its skill from driving.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Blame {
    /// The skill that drove last.
    pub skill: String,
    /// A viability threshold above this would have refused the skill for a whole window before the crash.
    pub predicted: f32,
}

/// The blame for a crash; none for a run that did not crash, was not recorded, or that no skill drove.
///
/// The skill is the last that was active, the stand aside. A refusal for `window` ticks in a row would have
/// kept it from taking over, or ended its drive; it may begin a window before the skill took over, at most
/// three seconds before the crash, and has to end half a second before it. Of these windows the one counts
/// whose highest prediction is lowest. A skill that `is_held` to less while it drives could have been kept
/// from taking over alone, so there it is the window before that.
pub fn blame(run: &CourseRun, window: usize, is_held: impl Fn(&str) -> bool) -> Option<Blame> {
    if run.outcome != Outcome::Crashed {
        return None;
    }
    let decisions: Vec<&Decision> = run.ticks.iter().filter_map(|tick| tick.decision.as_ref()).collect();
    let last = decisions.iter().rposition(|decision| decision.active != STAND)?;
    let skill = &decisions[last].active;
    let took_over = decisions[..last].iter().rposition(|decision| decision.active != *skill);
    let drives_from = took_over.map_or(0, |before| before + 1);
    let begins = drives_from.saturating_sub(window);
    let back = |seconds: f64| decisions.len().saturating_sub((seconds / TICK_S).round() as usize);
    let (begins, ends) = if is_held(skill) {
        (begins, drives_from)
    } else {
        (begins.max(back(LOOK_BACK_S)).min(last), back(TOO_LATE_S))
    };
    let ends = ends.clamp(begins + 1, last + 1);
    // What was not predicted refused the skill already.
    let predicted = |decision: &&Decision| {
        let own = decision.skills.iter().find(|verdict| verdict.name == *skill);
        own.and_then(|verdict| verdict.viability).unwrap_or(0.0)
    };
    let predicted: Vec<f32> = decisions[begins..ends].iter().map(predicted).collect();
    let highest = |ticks: &[f32]| ticks.iter().copied().fold(0.0, f32::max);
    let lowest = predicted.windows(window.clamp(1, predicted.len())).map(highest).min_by(f32::total_cmp)?;
    Some(Blame { skill: skill.clone(), predicted: lowest })
}

#[cfg(test)]
mod tests {
    use vocaloco_core::decision::SkillVerdict;
    use vocaloco_core::selector::Reason;

    use super::*;
    use crate::{course::CourseTick, plant::BasePose, terrain::CourseKind};

    /// A recorded run: who was active and what `walk` predicted, by ticks.
    fn run(outcome: Outcome, ticks: &[(&str, f32)]) -> CourseRun {
        let tick = |(active, viability): &(&str, f32)| {
            let verdict = SkillVerdict {
                name: "walk".into(),
                viability: Some(*viability),
                cot: Some(0.3),
                strangeness: None,
                viable: true,
                reason: Reason::Viable { threshold: 0.5 },
            };
            let decision =
                Decision { active: (*active).into(), skills: vec![verdict], ..Decision::default() };
            CourseTick {
                decision: Some(decision),
                base: BasePose { position_m: [0.0; 3], orientation_xyzw: [0.0, 0.0, 0.0, 1.0] },
                joint_position_rad: Vec::new(),
                foot_contact: Vec::new(),
            }
        };
        CourseRun {
            kind: CourseKind::StairsDown,
            size_m: 0.1,
            steps: 6,
            outcome,
            duration_s: ticks.len() as f64 * TICK_S,
            distance_m: 1.0,
            cot: None,
            cot_signed: None,
            switches: Vec::new(),
            nonfoot_contact: false,
            unseen: None,
            ticks: ticks.iter().map(tick).collect(),
        }
    }

    fn never(_: &str) -> bool {
        false
    }

    fn ticks(parts: &[(usize, &'static str, f32)]) -> Vec<(&'static str, f32)> {
        parts.iter().flat_map(|(n, active, viability)| vec![(*active, *viability); *n]).collect()
    }

    #[test]
    fn only_a_crash_that_a_skill_drove_into_is_laid_at_one() {
        let walking = ticks(&[(100, "walk", 0.9)]);
        assert_eq!(blame(&run(Outcome::Reached, &walking), 10, never), None);
        assert_eq!(blame(&run(Outcome::Crashed, &ticks(&[(100, "stand", 0.9)])), 10, never), None);
        assert_eq!(blame(&run(Outcome::Crashed, &[]), 10, never), None);
        let blamed = blame(&run(Outcome::Crashed, &walking), 10, never).unwrap();
        assert_eq!((blamed.skill.as_str(), blamed.predicted), ("walk", 0.9));
        // It had stopped, too late.
        let stopping = ticks(&[(100, "walk", 0.9), (10, "stand", 0.1)]);
        assert_eq!(blame(&run(Outcome::Crashed, &stopping), 10, never).unwrap().skill, "walk");
    }

    #[test]
    fn the_window_that_refuses_most_easily_counts() {
        // Before taking over, while driving, in a crash's last half second: 0.95, 0.97 with ten ticks of 0.91, 0.2.
        let parts = [
            (50, "stand", 0.95),
            (30, "walk", 0.97),
            (10, "walk", 0.91),
            (40, "walk", 0.97),
            (25, "walk", 0.2),
        ];
        let blamed = |parts: &[_]| blame(&run(Outcome::Crashed, &ticks(parts)), 10, never).unwrap().predicted;
        assert_eq!(blamed(&parts), 0.91);
        // Nine ticks are no window: the one before it took over is the lowest.
        let mut parts = parts;
        parts[2].0 = 9;
        assert_eq!(blamed(&parts), 0.95);
        // What lies three seconds back had no part in it.
        parts[3].0 = 150;
        assert_eq!(blamed(&parts), 0.97);
    }

    #[test]
    fn a_skill_that_is_held_is_laid_what_it_saw_before_it_took_over() {
        let parts = [(200, "stand", 0.95), (5, "stand", 0.96), (5, "stand", 0.94), (200, "walk", 0.3)];
        let run = run(Outcome::Crashed, &ticks(&parts));
        assert_eq!(blame(&run, 10, |skill| skill == "walk").unwrap().predicted, 0.96);
        assert_eq!(blame(&run, 10, |skill| skill == "climb").unwrap().predicted, 0.3);
    }

    #[test]
    fn a_crash_within_the_first_window_is_laid_at_what_was_seen() {
        assert_eq!(
            blame(&run(Outcome::Crashed, &ticks(&[(3, "walk", 0.8)])), 10, never).unwrap().predicted,
            0.8
        );
    }
}
