//! `evaluate success`: many rollouts of one course with one selector, as a row of shares.

use std::sync::Arc;

use rayon::prelude::*;
use serde::Serialize;
use vocaloco_core::{robot::RobotModel, runtime::Runtime};

use super::{
    CourseConfig, CourseError, CourseRun, CourseStage, Outcome, Pilot, SelectorPilot, SkillPilot, drive,
};
use crate::{
    evaluate::{mean, standard_deviation, wilson},
    rollout::RolledSkill,
};

/// Who chooses.
pub enum Selector<'a> {
    /// The method: a fresh runtime of a deployment for every rollout.
    Vocaloco(&'a (dyn Fn() -> Result<Runtime, CourseError> + Sync)),
    /// One skill alone, whatever lies ahead.
    Skill(&'a RolledSkill),
}

impl Selector<'_> {
    /// The id used on the command line.
    pub fn id(&self) -> String {
        match self {
            Self::Vocaloco(_) => "vocaloco".to_owned(),
            Self::Skill(skill) => format!("skill:{}", skill.name),
        }
    }
}

/// A row of `evaluate success`. Outcomes are shares of `n`.
#[derive(Clone, Debug, Serialize)]
pub struct SuccessRow {
    /// Course.
    pub course: &'static str,
    /// Height of a step, m.
    pub size_m: f32,
    /// Who chose.
    pub selector: String,
    /// Number of rollouts.
    pub n: u64,
    /// Share that reached the target, with its 95 % interval.
    pub reached: f64,
    /// Lower end.
    pub reached_low: f64,
    /// Upper end.
    pub reached_high: f64,
    /// Share that touched something with the base or left the map, with its 95 % interval.
    pub crashed: f64,
    /// Lower end.
    pub crashed_low: f64,
    /// Upper end.
    pub crashed_high: f64,
    /// Share that ran out of time, or stood because of a fault.
    pub stuck: f64,
    /// Share that stopped, faults left out.
    pub stopped: f64,
    /// Mean cost of transport of those that reached the target.
    pub cot_mean: Option<f64>,
    /// Its standard deviation.
    pub cot_std: Option<f64>,
    /// Mean duration of those that reached the target, s.
    pub duration_mean_s: Option<f64>,
    /// Mean number of changes of the active skill.
    pub switches_mean: f64,
    /// Half-width of the noise on the predictors' field, m.
    pub field_noise_m: f32,
    /// Half-width of the noise on the plugins' patch, m.
    pub patch_noise_m: f32,
}

/// One rollout of a course.
///
/// # Errors
/// When the robot cannot be set down or the pilot cannot go on.
pub fn roll_out(
    robot: &Arc<RobotModel>,
    config: &CourseConfig,
    selector: &Selector<'_>,
) -> Result<CourseRun, CourseError> {
    let CourseStage { terrain, mut plant } = CourseStage::set(robot, config)?;
    match selector {
        Selector::Vocaloco(runtime) => {
            let mut runtime = runtime()?;
            drive(config, &mut SelectorPilot::new(config, &mut plant, &terrain, &mut runtime))
        }
        Selector::Skill(skill) => {
            let mut instance = skill.instance(None, robot)?;
            let skill = (skill.name.as_str(), &mut instance);
            let pilot: &mut dyn Pilot = &mut SkillPilot::new(config, &mut plant, &terrain, skill);
            drive(config, pilot)
        }
    }
}

/// Rolls a course out `n` times, in parallel on the current rayon pool, and puts it into a row;
/// `progress` is called once for each, from any thread. The row depends on the configuration alone.
///
/// # Errors
/// As [`roll_out`], of the first rollout that cannot be driven.
pub fn success(
    robot: &Arc<RobotModel>,
    config: &CourseConfig,
    n: u64,
    selector: &Selector<'_>,
    progress: &(dyn Fn() + Sync),
) -> Result<SuccessRow, CourseError> {
    let one = |rollout: usize| {
        let config = CourseConfig { rollout: rollout as u64, ..config.clone() };
        let run = roll_out(robot, &config, selector)?;
        progress();
        Ok(run)
    };
    let runs: Vec<CourseRun> =
        (0..n as usize).into_par_iter().with_max_len(1).map(one).collect::<Result<_, CourseError>>()?;
    Ok(summarise(config, selector.id(), &runs))
}

fn summarise(config: &CourseConfig, selector: String, runs: &[CourseRun]) -> SuccessRow {
    let count = |outcome: Outcome| runs.iter().filter(|run| run.outcome == outcome).count();
    let share = |outcome: Outcome| count(outcome) as f64 / runs.len().max(1) as f64;
    let reached = || runs.iter().filter(|run| run.outcome == Outcome::Reached);
    let costs: Vec<f64> = reached().filter_map(|run| run.cot).collect();
    let durations: Vec<f64> = reached().map(|run| run.duration_s).collect();
    let switches: usize = runs.iter().map(|run| run.switches.len()).sum();
    let [reached_low, reached_high] = wilson(count(Outcome::Reached), runs.len());
    let [crashed_low, crashed_high] = wilson(count(Outcome::Crashed), runs.len());
    SuccessRow {
        course: config.kind.id(),
        size_m: config.size_m,
        selector,
        n: runs.len() as u64,
        reached: share(Outcome::Reached),
        reached_low,
        reached_high,
        crashed: share(Outcome::Crashed),
        crashed_low,
        crashed_high,
        stuck: share(Outcome::Stuck),
        stopped: share(Outcome::Stopped),
        cot_mean: mean(&costs),
        cot_std: standard_deviation(&costs),
        duration_mean_s: mean(&durations),
        switches_mean: switches as f64 / runs.len().max(1) as f64,
        field_noise_m: config.field_noise_m,
        patch_noise_m: config.noise.patch_m,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::CourseKind;

    fn run(outcome: Outcome, cot: f64) -> CourseRun {
        CourseRun {
            kind: CourseKind::StairsDown,
            size_m: 0.1,
            steps: 6,
            outcome,
            duration_s: 10.0 * cot,
            distance_m: 5.0,
            cot: Some(cot),
            cot_signed: None,
            switches: Vec::new(),
            nonfoot_contact: false,
            ticks: Vec::new(),
        }
    }

    #[test]
    fn shares_are_of_all_rollouts_and_costs_of_those_that_reached() {
        let config = CourseConfig::evaluation(CourseKind::StairsDown, 0.1, 1, 0);
        let runs = [
            run(Outcome::Reached, 0.2),
            run(Outcome::Reached, 0.4),
            run(Outcome::Crashed, 9.0),
            run(Outcome::Stopped, 9.0),
        ];
        let row = summarise(&config, "vocaloco".to_owned(), &runs);
        assert_eq!((row.n, row.reached, row.crashed, row.stuck, row.stopped), (4, 0.5, 0.25, 0.0, 0.25));
        assert!((row.cot_mean.unwrap() - 0.3).abs() < 1e-9);
        assert!((row.duration_mean_s.unwrap() - 3.0).abs() < 1e-9);
        assert!(row.reached_low < 0.5 && row.reached_high > 0.5);
    }
}
