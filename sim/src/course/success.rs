//! `evaluate success`: many rollouts of one course with one selector, as a row of shares.

use std::sync::Arc;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use vocaloco_core::robot::RobotModel;

use super::{
    CourseConfig, CourseError, CourseRun, CourseStage, Outcome, Pilot, Runtimes, SelectorPilot, SkillPilot,
    drive,
};
use crate::{
    evaluate::{mean, standard_deviation, wilson},
    occlusion::{Occlusion, Unseen},
    rollout::RolledSkill,
    terrain::CourseKind,
};

/// Who chooses.
#[derive(Clone, Copy)]
pub enum Selector<'a> {
    /// The method, or the method fed by an oracle.
    Runtime(&'a Runtimes<'a>),
    /// One skill alone, whatever lies ahead.
    Skill(&'a RolledSkill),
}

impl Selector<'_> {
    /// The id used on the command line.
    pub fn id(&self) -> String {
        match self {
            Self::Runtime(runtimes) => runtimes.name().to_owned(),
            Self::Skill(skill) => format!("skill:{}", skill.name),
        }
    }
}

/// A row of `evaluate success`. Outcomes are shares of `n`, each with its 95 % interval.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SuccessRow {
    /// Course.
    pub course: CourseKind,
    /// Height of a step, m.
    pub size_m: f32,
    /// Steps of a flight.
    pub steps: usize,
    /// Who chose.
    pub selector: String,
    /// Number of rollouts.
    pub n: u64,
    /// Share that reached the target.
    pub reached: f64,
    /// Lower end.
    pub reached_low: f64,
    /// Upper end.
    pub reached_high: f64,
    /// Share that touched something with the base or left the map.
    pub crashed: f64,
    /// Lower end.
    pub crashed_low: f64,
    /// Upper end.
    pub crashed_high: f64,
    /// Share that ran out of time, or stood because of a fault.
    pub stuck: f64,
    /// Lower end.
    pub stuck_low: f64,
    /// Upper end.
    pub stuck_high: f64,
    /// Share that stopped, faults left out.
    pub stopped: f64,
    /// Lower end.
    pub stopped_low: f64,
    /// Upper end.
    pub stopped_high: f64,
    /// Mean cost of transport of those that reached the target.
    pub cot_mean: Option<f64>,
    /// Its standard deviation.
    pub cot_std: Option<f64>,
    /// Mean duration of those that reached the target, s.
    pub duration_mean_s: Option<f64>,
    /// Mean number of changes of the active skill, the first from the stand included.
    pub switches_mean: f64,
    /// Half-width of the noise on the predictors' field, m.
    pub field_noise_m: f32,
    /// Half-width of the noise on the plugins' patch, m.
    pub patch_noise_m: f32,
    /// What the predictors' field was made from.
    pub occlusion: Occlusion,
    /// What the cameras did not see, over all ticks of all rollouts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unseen: Option<Unseen>,
    /// The rollouts that did not reach the target; `evaluate course --rollout N` drives one again.
    #[serde(default)]
    pub lost: Vec<Lost>,
}

/// A rollout that did not reach the target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lost {
    /// Its number.
    pub rollout: u64,
    /// How it ended.
    pub outcome: Outcome,
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
        Selector::Runtime(runtimes) => runtimes.with(|crew| {
            let pilot = SelectorPilot::new(config, &mut plant, &terrain, &mut crew.runtime);
            drive(config, &mut pilot.over(crew.ground.as_deref()))
        }),
        Selector::Skill(skill) => {
            let mut instance = skill.instance(None, robot)?;
            let skill = (*skill, &mut instance);
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
    let configs: Vec<_> = (0..n).map(|rollout| CourseConfig { rollout, ..config.clone() }).collect();
    let ended = |run| {
        progress();
        run
    };
    let runs = roll_out_each(robot, &configs, selector, &ended)?;
    Ok(summarise(config, selector.id(), &runs))
}

/// Rolls every course out, in parallel on the current rayon pool, and gives what `ended` makes of each, in
/// their order; it is called from any thread.
///
/// # Errors
/// As [`roll_out`], of the first rollout that cannot be driven.
pub fn roll_out_each<R: Send>(
    robot: &Arc<RobotModel>,
    configs: &[CourseConfig],
    selector: &Selector<'_>,
    ended: &(dyn Fn(CourseRun) -> R + Sync),
) -> Result<Vec<R>, CourseError> {
    let one = |config: &CourseConfig| roll_out(robot, config, selector).map(ended);
    configs.par_iter().with_max_len(1).map(one).collect()
}

fn summarise(config: &CourseConfig, selector: String, runs: &[CourseRun]) -> SuccessRow {
    let share = |outcome: Outcome| {
        let count = runs.iter().filter(|run| run.outcome == outcome).count();
        let [low, high] = wilson(count, runs.len());
        [count as f64 / runs.len().max(1) as f64, low, high]
    };
    let [reached, reached_low, reached_high] = share(Outcome::Reached);
    let [crashed, crashed_low, crashed_high] = share(Outcome::Crashed);
    let [stuck, stuck_low, stuck_high] = share(Outcome::Stuck);
    let [stopped, stopped_low, stopped_high] = share(Outcome::Stopped);
    let arrived = || runs.iter().filter(|run| run.outcome == Outcome::Reached);
    let costs: Vec<f64> = arrived().filter_map(|run| run.cot).collect();
    let durations: Vec<f64> = arrived().map(|run| run.duration_s).collect();
    let switches: usize = runs.iter().map(|run| run.switches.len()).sum();
    SuccessRow {
        course: config.kind,
        size_m: config.size_m,
        steps: config.steps,
        selector,
        n: runs.len() as u64,
        reached,
        reached_low,
        reached_high,
        crashed,
        crashed_low,
        crashed_high,
        stuck,
        stuck_low,
        stuck_high,
        stopped,
        stopped_low,
        stopped_high,
        cot_mean: mean(&costs),
        cot_std: standard_deviation(&costs),
        duration_mean_s: mean(&durations),
        switches_mean: switches as f64 / runs.len().max(1) as f64,
        field_noise_m: config.field_noise_m,
        patch_noise_m: config.noise.patch_m,
        occlusion: config.occlusion,
        unseen: unseen(runs),
        lost: (0..)
            .zip(runs)
            .map(|(rollout, run)| Lost { rollout, outcome: run.outcome })
            .filter(|one| one.outcome != Outcome::Reached)
            .collect(),
    }
}

/// Over all ticks of all runs.
fn unseen(runs: &[CourseRun]) -> Option<Unseen> {
    let of_runs: Vec<Unseen> = runs.iter().filter_map(|run| run.unseen).collect();
    let mut total = of_runs.iter().fold(Unseen::default(), |total, one| Unseen {
        ticks: total.ticks + one.ticks,
        cell_share: total.cell_share + one.cell_share * one.ticks as f64,
        drop_ticks: total.drop_ticks + one.drop_ticks,
        deepest_m: total.deepest_m.max(one.deepest_m),
    });
    total.cell_share /= total.ticks.max(1) as f64;
    (!of_runs.is_empty()).then_some(total)
}

#[cfg(test)]
mod tests {
    use super::*;

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
            unseen: None,
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
        let lost: Vec<_> = row.lost.iter().map(|one| (one.rollout, one.outcome)).collect();
        assert_eq!(lost, [(2, Outcome::Crashed), (3, Outcome::Stopped)]);
        assert!(row.stopped_low < 0.25 && row.stopped_high > 0.25 && row.stuck_high > 0.0);
    }

    #[test]
    fn what_cameras_missed_is_counted_by_tick_and_not_by_run() {
        let mut runs = [run(Outcome::Reached, 0.2), run(Outcome::Stopped, 0.2)];
        runs[0].unseen = Some(Unseen { ticks: 300, cell_share: 0.1, drop_ticks: 3, deepest_m: 0.2 });
        runs[1].unseen = Some(Unseen { ticks: 100, cell_share: 0.5, drop_ticks: 1, deepest_m: 0.3 });
        let total = unseen(&runs).unwrap();
        assert_eq!((total.ticks, total.drop_ticks, total.deepest_m), (400, 4, 0.3));
        assert!((total.cell_share - 0.2).abs() < 1e-12);
        assert_eq!(unseen(&runs[..0]), None);
    }
}
