//! How many rollouts a second collection makes.

use std::{
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::Instant,
};

use rayon::prelude::*;
use serde::Serialize;
use vocaloco_core::robot::RobotModel;

use super::{CollectConfig, CollectError, row::Work};
use crate::{dataset::Kind, rollout::RolledSkill, spawn::Spawner};

/// What the threads of the present pool collect.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CollectionSpeed {
    /// Threads used.
    pub threads: usize,
    /// Rollouts made.
    pub rollouts: u64,
    /// Wall time of all of them, s.
    pub wall_s: f64,
    /// Rollouts a second: tile, settling, field and label of each row included, files not.
    pub rollouts_per_s: f64,
    /// Physics steps a second, those of settling included.
    pub physics_steps_per_s: f64,
    /// Time of one processor for each rollout, all threads together, whatever else the machine does;
    /// `None` where the system does not say.
    pub cpu_ms_per_rollout: Option<f64>,
}

/// Time that processors have spent on this process, s, in hundredths; `None` where there is no `/proc`.
fn processor_s() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The program's name, in brackets, may hold anything. Behind it: state, then 10 fields, then ticks of
    // 10 ms in the program and in the system for it.
    let (_, fields) = stat.rsplit_once(')')?;
    let ticks = fields.split_whitespace().skip(11).take(2).map(str::parse::<u64>);
    Some(ticks.sum::<Result<u64, _>>().ok()? as f64 / 100.0)
}

/// Makes the first `rows` rows of a collection, keeps none, and takes the time.
///
/// # Errors
/// A row cannot be made.
pub fn measure(
    robot: &Arc<RobotModel>,
    skill: &RolledSkill,
    kind: Kind,
    config: &CollectConfig,
    rows: u64,
    progress: &(dyn Fn() + Sync),
) -> Result<CollectionSpeed, CollectError> {
    if config.repeats == 0 {
        return Err(CollectError::NoRepeats);
    }
    let work = Work { robot, skill, kind, config, spawner: Spawner::new(robot, config.spawn) };
    let steps = AtomicU64::new(0);
    #[expect(clippy::disallowed_methods, reason = "this function measures time")]
    let (start, processor_start_s) = (Instant::now(), processor_s());
    (0..rows as usize).into_par_iter().with_max_len(1).try_for_each(|row| {
        let (_, taken) = work.row_and_steps(row as u64)?;
        steps.fetch_add(taken, Ordering::Relaxed);
        progress();
        Ok::<(), CollectError>(())
    })?;
    let wall_s = start.elapsed().as_secs_f64();
    let processor_s = processor_start_s.zip(processor_s()).map(|(start, end)| end - start);
    let rollouts = rows * u64::from(config.repeats);
    Ok(CollectionSpeed {
        threads: rayon::current_num_threads(),
        rollouts,
        wall_s,
        rollouts_per_s: rollouts as f64 / wall_s,
        physics_steps_per_s: steps.into_inner() as f64 / wall_s,
        cpu_ms_per_rollout: processor_s.map(|seconds| 1e3 * seconds / rollouts as f64),
    })
}
