//! `evaluate switches`: how hard the joints are shaken while one skill takes over from another, against
//! how hard they are within skills.

use std::sync::Arc;

use rayon::prelude::*;
use serde::Serialize;
use vocaloco_core::{robot::RobotModel, runtime::Switching};

use super::{CourseConfig, CourseError, CourseRun, CourseStage, Outcome, Runtimes, SelectorPilot, drive};
use crate::{
    driver::{DECIMATION, TICK_S},
    plant::Measurement,
};

/// Length of the stretches that are compared, s: the longest window, and a third of a stride.
const STRETCH_S: f64 = 0.2;
/// A stretch is within a skill when the last switch is this long ago, s.
const SETTLED_S: f64 = 0.6;

/// Largest over the joints in one physics step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Peak {
    acceleration_rad_per_s2: f32,
    torque_nm: f32,
}

impl Peak {
    fn max(self, other: Self) -> Self {
        Self {
            acceleration_rad_per_s2: self.acceleration_rad_per_s2.max(other.acceleration_rad_per_s2),
            torque_nm: self.torque_nm.max(other.torque_nm),
        }
    }
}

/// Peaks of many stretches.
#[derive(Clone, Debug, Serialize)]
pub struct Peaks {
    /// Number of stretches.
    pub n: usize,
    /// Median.
    pub p50: f32,
    /// 95th percentile.
    pub p95: f32,
    /// Largest.
    pub max: f32,
}

/// One way of switching on one course.
#[derive(Clone, Debug, Serialize)]
pub struct SwitchesRow {
    /// Course.
    pub course: &'static str,
    /// Height of a step, m.
    pub size_m: f32,
    /// Length of the window, s.
    pub ramp_s: f64,
    /// Whether the outgoing skill goes on acting within it.
    pub mixing: bool,
    /// Number of rollouts.
    pub n: usize,
    /// Share that reached the target.
    pub reached: f64,
    /// Share that touched something with the base or left the map.
    pub crashed: f64,
    /// Peak joint acceleration in the stretch after a switch between skills, rad/s².
    pub acceleration_at_switches: Option<Peaks>,
    /// The same in the stretch before that switch.
    pub acceleration_before: Option<Peaks>,
    /// The same within skills.
    pub acceleration_within: Option<Peaks>,
    /// The same after a skill takes over from the stand.
    pub acceleration_at_starts: Option<Peaks>,
    /// The same after the stand takes over from a skill, at a stop or a fault.
    pub acceleration_at_stops: Option<Peaks>,
    /// Peak joint torque in the stretch after a switch between skills, N·m.
    pub torque_at_switches: Option<Peaks>,
    /// The same in the stretch before that switch.
    pub torque_before: Option<Peaks>,
    /// The same within skills.
    pub torque_within: Option<Peaks>,
    /// The same after a skill takes over from the stand.
    pub torque_at_starts: Option<Peaks>,
    /// The same after the stand takes over from a skill.
    pub torque_at_stops: Option<Peaks>,
}

/// Rolls a course out `n` times with runtimes that switch in one way, in parallel on the current rayon pool.
///
/// Acceleration is the change of a joint's velocity over a physics step. A stretch is 0.2 s long; one
/// is at a switch when it begins with the tick in which a skill takes over from another skill, before it
/// when it ends with that tick and one skill drives throughout, and within a skill when it ends before the
/// next switch and begins 0.6 s or more after the last. Before and after are the same place of the course,
/// which within is not.
///
/// # Errors
/// The first rollout that cannot be driven.
pub fn switches(
    robot: &Arc<RobotModel>,
    config: &CourseConfig,
    n: u64,
    (switching, runtimes): (Switching, &Runtimes<'_>),
    progress: &(dyn Fn() + Sync),
) -> Result<SwitchesRow, CourseError> {
    let one = |rollout: usize| {
        let config = CourseConfig { rollout: rollout as u64, recorded: false, ..config.clone() };
        let CourseStage { terrain, mut plant } = CourseStage::set(robot, &config)?;
        let mut watch = Watch::new(plant.measure());
        let run = runtimes.with(|crew| {
            let mut see = |measured: &Measurement| watch.see(measured);
            let pilot = SelectorPilot::new(&config, &mut plant, &terrain, &mut crew.runtime);
            drive(&config, &mut pilot.watched(&mut see))
        })?;
        progress();
        Ok((run, watch.peaks))
    };
    let runs: Vec<(CourseRun, Vec<Peak>)> =
        (0..n as usize).into_par_iter().with_max_len(1).map(one).collect::<Result<_, CourseError>>()?;
    let share = |outcome: Outcome| {
        runs.iter().filter(|(run, _)| run.outcome == outcome).count() as f64 / runs.len().max(1) as f64
    };
    let mut all = Stretches::default();
    for (run, peaks) in &runs {
        all.add(run, peaks);
    }
    let Stretches { at, before, within, starts, stops } = all;
    let acceleration =
        |peaks: &[Peak]| summary(peaks.iter().map(|peak| peak.acceleration_rad_per_s2).collect());
    let torque = |peaks: &[Peak]| summary(peaks.iter().map(|peak| peak.torque_nm).collect());
    Ok(SwitchesRow {
        course: config.kind.id(),
        size_m: config.size_m,
        ramp_s: switching.ramp_s,
        mixing: switching.mixing,
        n: runs.len(),
        reached: share(Outcome::Reached),
        crashed: share(Outcome::Crashed),
        acceleration_at_switches: acceleration(&at),
        acceleration_before: acceleration(&before),
        acceleration_within: acceleration(&within),
        acceleration_at_starts: acceleration(&starts),
        acceleration_at_stops: acceleration(&stops),
        torque_at_switches: torque(&at),
        torque_before: torque(&before),
        torque_within: torque(&within),
        torque_at_starts: torque(&starts),
        torque_at_stops: torque(&stops),
    })
}

/// Keeps the peak of every physics step.
struct Watch {
    step_s: f32,
    velocity_rad_per_s: Vec<f32>,
    peaks: Vec<Peak>,
}

impl Watch {
    fn new(measured: &Measurement) -> Self {
        let step_s = (TICK_S / DECIMATION as f64) as f32;
        Self { step_s, velocity_rad_per_s: measured.joint_velocity_rad_per_s.clone(), peaks: Vec::new() }
    }

    fn see(&mut self, measured: &Measurement) {
        let mut peak = Peak::default();
        let joints = measured.joint_velocity_rad_per_s.iter().zip(&self.velocity_rad_per_s);
        for ((now, before), torque_nm) in joints.zip(&measured.joint_torque_nm) {
            peak = peak.max(Peak {
                acceleration_rad_per_s2: ((now - before) / self.step_s).abs(),
                torque_nm: torque_nm.abs(),
            });
        }
        self.velocity_rad_per_s.copy_from_slice(&measured.joint_velocity_rad_per_s);
        self.peaks.push(peak);
    }
}

/// The peak of every stretch after a switch between skills, before one, within a skill, and after the stand hands over or
/// takes over.
#[derive(Debug, Default, PartialEq)]
struct Stretches {
    at: Vec<Peak>,
    before: Vec<Peak>,
    within: Vec<Peak>,
    starts: Vec<Peak>,
    stops: Vec<Peak>,
}

impl Stretches {
    fn add(&mut self, run: &CourseRun, peaks: &[Peak]) {
        let step = |t_s: f64| (t_s / TICK_S).round() as usize * DECIMATION;
        let (length, settled) = (step(STRETCH_S), step(SETTLED_S));
        let peak = |from: usize| {
            let stretch = peaks.get(from..from + length)?;
            Some(stretch.iter().fold(Peak::default(), |most, peak| most.max(*peak)))
        };
        let taken: Vec<usize> = run.switches.iter().map(|switch| step(switch.t_s)).collect();
        for (index, switch) in run.switches.iter().enumerate() {
            let (at, is_between) = match (switch.from.as_str(), switch.to.as_str()) {
                ("stand", _) => (&mut self.starts, false),
                (_, "stand") => (&mut self.stops, false),
                _ => (&mut self.at, true),
            };
            at.extend(peak(taken[index]));
            if is_between {
                let began = index.checked_sub(1).map_or(0, |last| taken[last]);
                let before = taken[index].checked_sub(length).filter(|&from| from >= began);
                self.before.extend(before.and_then(peak));
            }
            if switch.to != "stand" {
                let end = taken.get(index + 1).copied().unwrap_or(peaks.len());
                let from = (taken[index] + settled..).step_by(length).take_while(|from| from + length <= end);
                self.within.extend(from.filter_map(peak));
            }
        }
    }
}

fn summary(mut values: Vec<f32>) -> Option<Peaks> {
    values.sort_by(f32::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
    (!values.is_empty()).then(|| Peaks { n: values.len(), p50: at(0.5), p95: at(0.95), max: at(1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{course::Switch, terrain::CourseKind};

    fn run(switches: &[(f64, &str, &str)]) -> CourseRun {
        let switch = |&(t_s, from, to): &(f64, &str, &str)| Switch { t_s, from: from.into(), to: to.into() };
        CourseRun {
            kind: CourseKind::StairsUp,
            size_m: 0.1,
            steps: 6,
            outcome: Outcome::Reached,
            duration_s: 4.0,
            distance_m: 2.0,
            cot: None,
            cot_signed: None,
            switches: switches.iter().map(switch).collect(),
            nonfoot_contact: false,
            unseen: None,
            ticks: Vec::new(),
        }
    }

    #[test]
    fn a_peak_counts_where_it_happens() {
        let run = run(&[(0.2, "stand", "walk"), (2.0, "walk", "ascend"), (3.6, "ascend", "stand")]);
        let mut peaks = vec![Peak { acceleration_rad_per_s2: 1.0, torque_nm: 2.0 }; 800];
        peaks[405].torque_nm = 70.0; // 25 ms after the switch between skills.
        peaks[445].torque_nm = 90.0; // 225 ms after it: neither at the switch nor settled.
        peaks[250].acceleration_rad_per_s2 = 50.0; // Within walk.
        peaks[720].torque_nm = 99.0; // While it stands.
        peaks[370].acceleration_rad_per_s2 = 30.0; // 150 ms before the switch.
        peaks[725].acceleration_rad_per_s2 = 40.0; // 25 ms after the stop.
        let Stretches { at, before, within, starts, stops } = stretches(&run, &peaks);
        assert_eq!(starts, [Peak { acceleration_rad_per_s2: 1.0, torque_nm: 2.0 }]);
        assert_eq!(stops, [Peak { acceleration_rad_per_s2: 40.0, torque_nm: 99.0 }]);
        assert_eq!(before, [Peak { acceleration_rad_per_s2: 30.0, torque_nm: 2.0 }]);
        assert_eq!(at, [Peak { acceleration_rad_per_s2: 1.0, torque_nm: 70.0 }]);
        assert_eq!(within.len(), 6 + 5, "0.8 to 2.0 s and 2.6 to 3.6 s");
        let most = within.iter().fold(Peak::default(), |most, peak| most.max(*peak));
        assert_eq!(most, Peak { acceleration_rad_per_s2: 50.0, torque_nm: 2.0 });
    }

    fn stretches(run: &CourseRun, peaks: &[Peak]) -> Stretches {
        let mut all = Stretches::default();
        all.add(run, peaks);
        all
    }

    #[test]
    fn a_stretch_cut_short_by_the_end_or_by_another_switch_is_left_out() {
        let peaks = [Peak::default(); 200];
        let lengths = |switches: &[(f64, &str, &str)]| {
            let Stretches { at, before, within, .. } = stretches(&run(switches), &peaks);
            [at.len(), before.len(), within.len()]
        };
        assert_eq!(lengths(&[(0.0, "stand", "walk"), (0.9, "walk", "ascend")]), [0, 1, 1]);
        assert_eq!(lengths(&[(0.4, "stand", "walk"), (0.5, "walk", "ascend")]), [1, 0, 0]);
    }

    #[test]
    fn percentiles_are_of_the_sorted_values() {
        let peaks = summary((0..=100).rev().map(|value| value as f32).collect()).unwrap();
        assert_eq!((peaks.n, peaks.p50, peaks.p95, peaks.max), (101, 50.0, 95.0, 100.0));
        assert!(summary(Vec::new()).is_none());
    }
}
