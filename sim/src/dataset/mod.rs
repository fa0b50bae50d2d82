//! Data sets on disk: `shard-*.parquet` with `meta.json` beside them, in `<folder>/<skill>/<kind>/`.
//!
//! Shards are written whole or not at all. Nothing here knows physics or learning.

mod error;
mod meta;
mod read;
mod shard;
mod write;

use serde::{Deserialize, Serialize};
use vocaloco_core::heightfield::CELLS;

use crate::{rollout::Outcome, terrain::TerrainKind};

pub use error::DatasetError;
pub use meta::{META_FILE, Meta, RobotId, SCHEMA, SimulatorId, SkillId};
pub(crate) use read::is_complete;
pub use read::{Dataset, Stored, columns, merge, read, read_incomplete, sha256, stored};
pub use shard::{Layout, ROWS_PER_SHARD, Shard, shard_file};
pub use write::{write_atomically, write_shard};

/// What a row's label is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Share of rollouts that reached the horizon.
    Viability,
    /// Cost of transport of one rollout, positive work.
    Cot,
}

impl Kind {
    /// The id used on the command line and as the folder's name.
    pub const fn id(self) -> &'static str {
        match self {
            Self::Viability => "viability",
            Self::Cot => "cot",
        }
    }

    /// The kind with this id, if there is one.
    pub fn from_id(id: &str) -> Option<Self> {
        [Self::Viability, Self::Cot].into_iter().find(|kind| kind.id() == id)
    }
}

/// One row: a pose, what it sees, and what rollouts from it gave.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Number of the row in its data set.
    pub row: u64,
    /// Seed from which everything in the row is drawn.
    pub seed: u64,
    /// Terrain.
    pub terrain: TerrainKind,
    /// Its size, m.
    pub size_m: f32,
    /// Its difficulty, 0 to 1.
    pub difficulty: f32,
    /// Settled base: x, y, z in metres, yaw in radians.
    pub spawn: [f32; 4],
    /// Poses drawn until one was valid.
    pub spawn_attempts: u32,
    /// True heights around the base, relative to it, before noise; NaN outside the map.
    pub heightfield_m: [f32; CELLS],
    /// The field as networks see it: filled, clipped, with noise, centred.
    pub field_m: [f32; CELLS],
    /// Viability: successes / rollouts. Cost of transport: of positive work, NaN without distance.
    pub label: f32,
    /// Whether the row is for training; time-outs without a crash have a cost that is not.
    pub trainable: bool,
    /// Number of rollouts.
    pub rollouts: u32,
    /// Of those, how many reached the horizon.
    pub successes: u32,
    /// Of those, how many ended by a contact of the base.
    pub base_collisions: u32,
    /// In data sets of cost: how the rollout ended and what it cost.
    pub cost: Option<Cost>,
}

/// What a row of a cost data set holds besides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// How the rollout ended; never by a base collision.
    pub outcome: Outcome,
    /// Cost of transport, work as signed; NaN without distance.
    pub signed: f32,
}
