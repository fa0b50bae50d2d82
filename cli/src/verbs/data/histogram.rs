//! How often each label occurs, by terrain.

use std::fmt::Write;

use serde::Serialize;
use vocaloco_sim::{
    dataset::{Dataset, Kind},
    terrain::TerrainKind,
};

/// Bins of a histogram.
const BINS: usize = 10;

/// Labels of the rows for training.
#[derive(Serialize)]
pub(super) struct Histogram {
    /// `None` is all terrains together.
    terrain: Option<TerrainKind>,
    /// Width of a bin; the first begins at 0, the last holds whatever lies beyond.
    bin: f32,
    counts: [u64; BINS],
}

impl Histogram {
    /// All terrains together, then those that occur.
    pub(super) fn by_terrain(data: &Dataset) -> Vec<Self> {
        let bin = bin(data.meta.kind);
        let of = |terrain: Option<TerrainKind>| {
            let mut counts = [0; BINS];
            for row in (0..data.len()).filter(|row| data.trainable[*row]) {
                if terrain.is_none_or(|terrain| terrain == data.terrain[row]) {
                    counts[((data.labels[row] / bin) as usize).min(BINS - 1)] += 1;
                }
            }
            Self { terrain, bin, counts }
        };
        let terrains = TerrainKind::ALL.into_iter().map(Some);
        let occurring = terrains.map(of).filter(|histogram| histogram.counts.iter().any(|count| *count > 0));
        std::iter::once(of(None)).chain(occurring).collect()
    }
}

/// Viability ends at 1; a cost of 2 is twice what any skill here needs where it is viable.
fn bin(kind: Kind) -> f32 {
    match kind {
        Kind::Viability => 0.1,
        Kind::Cot => 0.2,
    }
}

/// A line a terrain; a column holds labels from its number on.
pub(super) fn table(kind: Kind, histograms: &[Histogram]) -> String {
    let mut table = format!("{} from ", kind.id());
    let _ = write!(table, "{:<1$}", "", 14_usize.saturating_sub(table.len()));
    for edge in 0..BINS {
        let _ = write!(table, "{:>7.1}", edge as f32 * bin(kind));
    }
    for histogram in histograms {
        let _ = write!(table, "\n{:<14}", histogram.terrain.map_or("all", TerrainKind::id));
        for count in histogram.counts {
            let _ = write!(table, "{count:>7}");
        }
    }
    table
}
