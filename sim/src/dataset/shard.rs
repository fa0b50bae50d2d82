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

/// Number of blocks of `rows` rows.
pub fn blocks(rows: u64) -> u64 {
    rows.div_ceil(ROWS_PER_SHARD)
}

/// Rows of a block in a data set of `rows` rows.
pub fn shard_rows(block: u64, rows: u64) -> Range<u64> {
    let start = block * ROWS_PER_SHARD;
    start..(start + ROWS_PER_SHARD).min(rows)
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
        let rows = 3 * ROWS_PER_SHARD + 5;
        let shards = [Shard::parse("1/2").unwrap(), Shard::parse("2/2").unwrap()];
        let mut seen = Vec::new();
        for block in 0..blocks(rows) {
            assert_eq!(shards.iter().filter(|shard| shard.owns(block)).count(), 1, "block {block}");
            seen.extend(shard_rows(block, rows));
        }
        assert_eq!(seen, (0..rows).collect::<Vec<_>>());
    }

    #[test]
    fn a_shard_out_of_range_is_refused() {
        for text in ["0/2", "3/2", "1", "a/b", "1/0", "-1/2"] {
            assert_eq!(Shard::parse(text), None, "{text}");
        }
    }
}
