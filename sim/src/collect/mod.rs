//! Collection (docs/method.md): rows of rollouts, in shards on disk. A row depends on the
//! configuration and its own number alone, so threads, shards and kills change no byte.

mod config;
mod midway;
mod mixture;
mod row;
mod run_log;
pub mod speed;

use std::{ops::Range, path::Path, sync::Arc};

use rayon::prelude::*;
use thiserror::Error;
use vocaloco_core::{heightfield::HeightfieldError, robot::RobotModel};

pub use config::CollectConfig;
pub use mixture::Mixture;
pub use row::field_noise;
pub(crate) use row::noisy_field;
pub use run_log::RunLog;

use crate::{
    dataset::{
        DatasetError, Kind, Layout, META_FILE, Meta, Row, SCHEMA, Shard, is_complete, shard_file, write_shard,
    },
    identity,
    rollout::RolledSkill,
    spawn::{NoValidPose, Spawner},
    threads::{NoThreads, with_threads},
};
use row::Work;

/// What to collect, where, and how much of it is this run's.
#[derive(Clone, Debug)]
pub struct Collection<'a> {
    /// The robot.
    pub robot: &'a Arc<RobotModel>,
    /// The skill.
    pub skill: &'a RolledSkill,
    /// What the labels are.
    pub kind: Kind,
    /// What rows depend on.
    pub config: &'a CollectConfig,
    /// Rows of the whole data set, and of a file. A cost data set leaves out rows that crash.
    pub layout: Layout,
    /// This run's part.
    pub shard: Shard,
    /// Threads; 0 for as many as there are processors.
    pub threads: usize,
    /// Whether to go on with what is there.
    pub resume: bool,
    /// Hash of the plugin's source files, where they are at hand.
    pub plugin_source_sha256: Option<String>,
}

/// A collection that could not go on. What was written stays and can be resumed.
#[derive(Debug, Error)]
pub enum CollectError {
    /// A file.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// Shards are there and `resume` was not asked for.
    #[error("{}: shard {found} is there already; --resume goes on with it", path)]
    Present {
        /// The folder.
        path: String,
        /// The first shard found.
        found: String,
    },
    /// No pose.
    #[error("row {row}: {source}")]
    Pose {
        /// The row.
        row: u64,
        /// What was tried.
        source: NoValidPose,
    },
    /// A field that networks cannot take.
    #[error("row {row}: {source}")]
    Field {
        /// The row.
        row: u64,
        /// What is wrong with it.
        source: HeightfieldError,
    },
    /// No repeats.
    #[error("repeats: found 0, wanted 1 or more")]
    NoRepeats,
    /// Threads could not be started.
    #[error(transparent)]
    Threads(#[from] NoThreads),
}

/// What a run did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Collected {
    /// Shards written by this run.
    pub shards_written: u64,
    /// Shards that were there already.
    pub shards_kept: u64,
    /// Rows drawn by this run.
    pub rows_drawn: u64,
    /// Of those, rows stored.
    pub rows_stored: u64,
}

impl Collection<'_> {
    /// What this data set is made of.
    pub fn meta(&self) -> Meta {
        Meta {
            schema: SCHEMA,
            kind: self.kind,
            rows: self.layout.rows,
            rows_per_shard: self.layout.rows_per_shard,
            robot: identity::robot(self.robot),
            skill: identity::skill(self.skill, self.plugin_source_sha256.clone()),
            simulator: identity::simulator(self.config.plant),
            config: self.config.clone(),
        }
    }

    /// Number of rows in this run's part, what is there already included.
    pub fn rows_of_shard(&self) -> u64 {
        self.blocks().map(|block| self.layout.rows_of(block)).map(|rows| rows.end - rows.start).sum()
    }

    /// Collects into `folder`; `progress` is told the number of rows done, from any thread.
    ///
    /// Each block of rows becomes one file, written whole or not at all. Killed at
    /// any moment and run again with `resume`, the folder ends with the same bytes.
    ///
    /// # Errors
    /// As [`CollectError`] says; what was written until then is sound.
    pub fn run(&self, folder: &Path, progress: &(dyn Fn(u64) + Sync)) -> Result<Collected, CollectError> {
        if self.config.repeats == 0 {
            return Err(CollectError::NoRepeats);
        }
        std::fs::create_dir_all(folder).map_err(DatasetError::io(folder))?;
        self.agree_on_meta(folder)?;
        with_threads(self.threads, || self.collect(folder, progress))?
    }

    fn collect(&self, folder: &Path, progress: &(dyn Fn(u64) + Sync)) -> Result<Collected, CollectError> {
        let work = Work {
            robot: self.robot,
            skill: self.skill,
            kind: self.kind,
            config: self.config,
            spawner: Spawner::new(self.robot, self.config.spawn),
        };
        let mut done = Collected::default();
        for block in self.blocks() {
            let rows = self.layout.rows_of(block);
            let count = rows.end - rows.start;
            let path = folder.join(shard_file(block));
            if is_complete(&path, &rows) {
                done.shards_kept += 1;
                progress(count);
                continue;
            }
            let stored = collect_block(&work, rows.clone(), progress)?;
            write_shard(&path, self.kind, &rows, &stored)?;
            done.shards_written += 1;
            done.rows_drawn += count;
            done.rows_stored += stored.len() as u64;
        }
        Ok(done)
    }

    fn blocks(&self) -> impl Iterator<Item = u64> + '_ {
        (0..self.layout.blocks()).filter(|block| self.shard.owns(*block))
    }

    /// Writes `meta.json`, or checks that what is there was made of the same; more rows than before
    /// are fine.
    fn agree_on_meta(&self, folder: &Path) -> Result<(), CollectError> {
        let meta = self.meta();
        if !folder.join(META_FILE).exists() {
            return Ok(meta.write(folder)?);
        }
        let present = Meta::read(folder)?;
        meta.check_same(&present, folder)?;
        let mine = self.blocks().map(shard_file).find(|file| folder.join(file).exists());
        match mine {
            Some(found) if !self.resume => {
                return Err(CollectError::Present { path: folder.display().to_string(), found });
            }
            _ => {}
        }
        if meta.rows < present.rows {
            let wanted = format!("at most {}, what this run was asked for", meta.rows);
            return Err(DatasetError::content(&folder.join(META_FILE), "rows", present.rows, wanted).into());
        }
        if meta.rows > present.rows { Ok(meta.write(folder)?) } else { Ok(()) }
    }
}

fn collect_block(
    work: &Work<'_>,
    rows: Range<u64>,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Vec<Row>, CollectError> {
    let rows: Vec<Option<Row>> = (rows.start as usize..rows.end as usize)
        .into_par_iter()
        .with_max_len(1)
        .map(|row| {
            let result = work.row(row as u64);
            progress(1);
            result
        })
        .collect::<Result<_, _>>()?;
    Ok(rows.into_iter().flatten().collect())
}
