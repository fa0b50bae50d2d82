//! What is claimed of skills that are added later.

use vocaloco_sim::{course::SuccessRow, terrain::CourseKind};

use super::super::findings::{ADDED, FREE};
use super::{Claim, Evidence, Verdict, percent};

/// The course is traversed when this share reaches its end.
const REACHED: f64 = 0.95;

impl Evidence<'_> {
    pub(super) fn new_skills(&self) -> Claim {
        let words = "Climb and gap are added without retraining anything, and an obstacle course with a wall and a 0.5 m gap is traversed.";
        let Some((deployment, skills)) = self.added else {
            let why = "There is no deployment with skills added to these.";
            return Self::unmeasured("new_skills", words, why, self.plan.seed);
        };
        let of = |selector: &str| self.findings.obstacles.iter().find(|row| row.selector == selector);
        let ours = of(ADDED);
        let new: Vec<&str> = skills.iter().copied().filter(|name| !self.skills.contains(name)).collect();
        Claim {
            id: "new_skills",
            words: words.to_owned(),
            by: "paper",
            ours: format!(
                "with {} added to a deployment: {}; the same without commitment: {}; without them: {}; {} alone: {}",
                new.join(" and "),
                told(ours),
                told(of(FREE)),
                told(of("vocaloco")),
                self.baseline,
                told(of(&self.baseline_selector()))
            ),
            verdict: Verdict::of(
                ours.is_some_and(|row| row.reached >= REACHED && row.crashed <= row.stopped),
            ),
            why: format!(
                "Agrees when at least {} reach the end and of the rest no more crash than stop. That no file of another skill changed \
                 is held by a test, tests/a_skill_is_added_and_no_other_changes.rs.",
                percent(REACHED)
            ),
            n: format!("{} a deployment", self.plan.rollouts),
            seed: self.plan.seed,
            command: format!(
                "vocaloco evaluate success --course {} --selector vocaloco --rollouts {} --steps {} --deployment {deployment} --seed {}",
                CourseKind::Obstacles.id(),
                self.plan.rollouts,
                self.plan.demo_steps,
                self.plan.seed
            ),
            figure: Some("obstacles"),
        }
    }
}

fn told(row: Option<&SuccessRow>) -> String {
    row.map_or_else(
        || "not measured".to_owned(),
        |row| {
            format!(
                "{} reached ({} to {}), {} crashed, {} stopped, {} stuck",
                percent(row.reached),
                percent(row.reached_low),
                percent(row.reached_high),
                percent(row.crashed),
                percent(row.stopped),
                percent(row.stuck)
            )
        },
    )
}
