//! Which rows stand in which file, and which files are whose.

use std::ops::Range;

/// Rows to a file: about a minute's work, what a killed run loses at most.
pub const ROWS_PER_SHARD: u64 = 128;

/// One of several runs that share a data set: part `index` (from 1) of `count`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    index: u64,
    count: u64,
}

impl Shard {
    /// The one run that makes all.
    pub const ALL: Self = Self { index: 1, count: 1 };

    /// Reads `i/n` with i from 1 to n; `None` for anything else.
    pub fn parse(text: &str) -> Option<Self> {
        let (index, count) = text.split_once('/')?;
        let (index, count) = (index.parse().ok()?, count.parse().ok()?);
        (1..=count).contains(&index).then_some(Self { index, count })
    }

    /// Whether a block of rows is this run's.
    pub fn owns(&self, block: u64) -> bool {
        block % self.count == self.index - 1
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}/{}", self.index, self.count)
    }
}

/// How the rows of a data set are spread over files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Rows of the data set.
    pub rows: u64,
    /// Rows to a file.
    pub rows_per_shard: u64,
}

impl Layout {
    /// Number of blocks, the last one perhaps shorter.
    pub fn blocks(self) -> u64 {
        self.rows.div_ceil(self.rows_per_shard)
    }

    /// Rows of a block.
    pub fn rows_of(self, block: u64) -> Range<u64> {
        let start = block * self.rows_per_shard;
        start..(start + self.rows_per_shard).min(self.rows)
    }
}

/// File name of a block.
pub fn shard_file(block: u64) -> String {
    format!("shard-{block:05}.parquet")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_stands_in_exactly_one_block_of_exactly_one_shard() {
        let layout = Layout { rows: 43, rows_per_shard: 12 };
        let shards = [Shard::parse("1/2").unwrap(), Shard::parse("2/2").unwrap()];
        let mut seen = Vec::new();
        for block in 0..layout.blocks() {
            assert_eq!(shards.iter().filter(|shard| shard.owns(block)).count(), 1, "block {block}");
            seen.extend(layout.rows_of(block));
        }
        assert_eq!(seen, (0..43).collect::<Vec<_>>());
    }

    #[test]
    fn a_shard_out_of_range_is_refused() {
        for text in ["0/2", "3/2", "1", "a/b", "1/0", "-1/2"] {
            assert_eq!(Shard::parse(text), None, "{text}");
        }
    }
}
