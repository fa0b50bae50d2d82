//! The costs that a search has found, on disk, so that a stopped search resumes where it was.

use std::{
    collections::BTreeMap,
    fs::{File, OpenOptions},
    io::{BufWriter, Write},
    path::Path,
    sync::{Mutex, PoisonError},
};

use anyhow::Context;

/// A point's identity: its generation and the bits of its coordinates.
type Key = (usize, Vec<u64>);

/// Costs by generation and point: read back on resume, appended while searching.
pub(super) struct History {
    known: BTreeMap<Key, f64>,
    file: Mutex<BufWriter<File>>,
}

impl History {
    /// Opens the file, forgetting what it holds unless `resume`.
    pub(super) fn open(path: &Path, resume: bool) -> anyhow::Result<Self> {
        let context = || path.display().to_string();
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).with_context(context)?;
        }
        let mut known = BTreeMap::new();
        if resume && path.exists() {
            let text = std::fs::read_to_string(path).with_context(context)?;
            // A line that a kill cut short does not parse and is found again.
            known.extend(text.lines().filter_map(parse));
        }
        let file = OpenOptions::new()
            .create(true)
            .append(resume)
            .write(true)
            .truncate(!resume)
            .open(path)
            .with_context(context)?;
        Ok(Self { known, file: Mutex::new(BufWriter::new(file)) })
    }

    /// Whether a whole generation is known.
    pub(super) fn has(&self, generation: usize, population: usize) -> bool {
        self.known.range((generation, Vec::new())..(generation + 1, Vec::new())).count() >= population
    }

    /// The cost of a point, known or found now.
    pub(super) fn cost(&self, generation: usize, point: &[f64], find: impl FnOnce() -> f64) -> f64 {
        let key = (generation, point.iter().map(|value| value.to_bits()).collect::<Vec<_>>());
        if let Some(cost) = self.known.get(&key) {
            return *cost;
        }
        let cost = find();
        let bits: Vec<String> = key.1.iter().map(|bits| format!("{bits:x}")).collect();
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        // A line that cannot be written costs a repetition on resume, not the search.
        let _ = writeln!(file, "{generation},{cost},{},end", bits.join(","));
        cost
    }

    /// Hands what was found to the system.
    pub(super) fn flush(&self) -> anyhow::Result<()> {
        self.file.lock().unwrap_or_else(PoisonError::into_inner).flush().context("the search's history")
    }
}

fn parse(line: &str) -> Option<(Key, f64)> {
    let mut fields: Vec<&str> = line.split(',').collect();
    if fields.pop()? != "end" || fields.len() < 3 {
        return None;
    }
    let generation = fields[0].parse().ok()?;
    let cost = fields[1].parse().ok()?;
    let bits = fields[2..].iter().map(|bits| u64::from_str_radix(bits, 16)).collect::<Result<_, _>>().ok()?;
    Some(((generation, bits), cost))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resumed_history_knows_what_was_found_and_forgets_a_torn_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("history.csv");
        let history = History::open(&path, false).unwrap();
        assert!((history.cost(3, &[0.1, 0.2], || 1.5) - 1.5).abs() < f64::EPSILON);
        history.flush().unwrap();
        drop(history);
        std::fs::write(&path, std::fs::read_to_string(&path).unwrap() + "4,2.5,3fb9").unwrap();
        let resumed = History::open(&path, true).unwrap();
        let cost = resumed.cost(3, &[0.1, 0.2], || unreachable!("known already"));
        assert!((cost - 1.5).abs() < f64::EPSILON);
        assert!(resumed.has(3, 1) && !resumed.has(4, 1));
    }
}
