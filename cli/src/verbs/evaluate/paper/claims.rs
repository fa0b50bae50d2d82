//! The paper's claims (docs/method.md), each beside what was measured here. A verdict is computed from
//! numbers alone, and says by which rule.

mod adding;
mod choosing;
mod predicting;

pub(super) use choosing::ThresholdPoint;

use serde::Serialize;
use vocaloco_sim::course::SuccessRow;

use super::findings::Findings;
use super::plan::Plan;
use super::roles::Roles;

/// Whether a claim holds here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Verdict {
    Agrees,
    Differs,
    NotMeasured,
}

impl Verdict {
    fn of(agrees: bool) -> Self {
        if agrees { Self::Agrees } else { Self::Differs }
    }
}

/// A line of the report.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Claim {
    pub(super) id: &'static str,
    /// What the paper, or the promise, says.
    #[serde(rename = "claim")]
    pub(super) words: String,
    /// Who says it.
    pub(super) by: &'static str,
    /// What was measured, in numbers.
    pub(super) ours: String,
    pub(super) verdict: Verdict,
    /// By which rule it agrees; where it does not, what is known about why.
    pub(super) why: String,
    /// Rollouts behind the numbers.
    pub(super) n: String,
    pub(super) seed: u64,
    pub(super) command: String,
    /// The figure that shows it.
    pub(super) figure: Option<&'static str>,
}

/// What claims are judged from.
pub(super) struct Evidence<'a> {
    pub(super) findings: &'a Findings,
    pub(super) plan: &'a Plan,
    pub(super) roles: &'a Roles,
    pub(super) skills: &'a [&'a str],
    pub(super) baseline: &'a str,
    pub(super) deployment: &'a str,
    /// The deployment whose thresholds promise something.
    pub(super) promised: Option<&'a str>,
    /// The deployment with skills added for the course of obstacles, and all its skills in its order.
    pub(super) added: Option<(&'a str, &'a [&'a str])>,
    /// Names in the order of their colours.
    pub(super) palette: &'a [String],
}

impl Evidence<'_> {
    /// Every claim, in the order of the paper.
    pub(super) fn claims(&self) -> Vec<Claim> {
        vec![
            self.viability_falls_and_cost_rises(),
            self.predictions_follow(),
            self.cost_follows(),
            self.level_skill_is_cheapest_on_low_steps(),
            self.up_skill_fails_down_stairs(),
            self.stops_where_the_baseline_crashes(),
            self.at_twenty_two_centimetres(),
            self.few_crashes(),
            self.promised_crashes(),
            self.reaches_what_is_safe(),
            self.demo_switches(),
            self.energy(),
            self.windows(),
            self.horizons(),
            self.thresholds(),
            self.filling(),
            self.new_skills(),
            Self::unmeasured(
                "robot",
                "On the real ANYmal-D the staircases are walked with nothing retuned.",
                "There is no robot here. The nearest is a second simulator: vocaloco evaluate transfer.",
                self.plan.seed,
            ),
        ]
    }

    fn unmeasured(id: &'static str, claim: &str, why: &str, seed: u64) -> Claim {
        Claim {
            id,
            words: claim.to_owned(),
            by: "paper",
            ours: "–".to_owned(),
            verdict: Verdict::NotMeasured,
            why: why.to_owned(),
            n: "–".to_owned(),
            seed,
            command: String::new(),
            figure: None,
        }
    }

    /// The command that repeats rows of success.
    fn success_command(&self, courses: &str, selectors: &[&str], sizes_m: &[f32], rollouts: u64) -> String {
        format!(
            "vocaloco evaluate success --course {courses} --size-m {} --selector {} --rollouts {rollouts} \
             --oracle-samples {} --steps {} --deployment {} --seed {}",
            list(sizes_m),
            selectors.join(","),
            self.plan.samples,
            self.plan.steps,
            self.deployment,
            self.plan.seed
        )
    }

    /// The command that repeats cells.
    fn cells_command(&self, skills: &[&str], terrains: &str) -> String {
        format!(
            "vocaloco evaluate calibration --skill {} --terrain {terrains} --size-m {} --samples {} --seed {}",
            skills.join(","),
            list(&self.plan.sizes_m),
            self.plan.samples,
            self.plan.seed
        )
    }

    /// The command that repeats everything, ablations included.
    fn all_command(&self) -> String {
        let quick = if self.plan.quick { " --quick" } else { "" };
        format!("vocaloco evaluate all{quick} --deployment {} --seed {}", self.deployment, self.plan.seed)
    }

    /// The baseline as rows name it.
    pub(super) fn baseline_name(&self) -> String {
        self.baseline_selector()
    }

    fn baseline_selector(&self) -> String {
        format!("skill:{}", self.baseline)
    }
}

fn list(sizes_m: &[f32]) -> String {
    sizes_m.iter().map(|size| format!("{size}")).collect::<Vec<_>>().join(",")
}

/// A share in whole percent; a dash of nothing.
fn percent(share: f64) -> String {
    if share.is_finite() { format!("{:.0} %", share * 100.0) } else { "–".to_owned() }
}

/// A height as people say it.
fn centimetres(size_m: f32) -> String {
    let text = format!("{:.1}", size_m * 100.0);
    format!("{} cm", text.strip_suffix(".0").unwrap_or(&text))
}

fn course_words(row: &SuccessRow) -> String {
    format!("{} of {}", row.course.id().replace('_', " "), centimetres(row.size_m))
}
