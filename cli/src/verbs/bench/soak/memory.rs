//! What this process holds of the machine, over a run: memory and open files.

use anyhow::Context;

/// Pieces of the curve that is kept.
const PIECES: u64 = 50;
const MIB: f64 = (1 << 20) as f64;

/// Highest values before and after the end of the warm-up, and a curve.
#[derive(Debug)]
pub(super) struct Memory {
    ticks: u64,
    /// Bytes, within the warm-up and after it.
    highest: [u64; 2],
    open_files: [usize; 2],
    /// The highest of each piece that was sampled, with its last tick.
    curve: Vec<(u64, u64)>,
}

impl Memory {
    /// Nothing yet, of a run of this many ticks.
    pub(super) fn of(ticks: u64) -> Self {
        Self { ticks, highest: [0; 2], open_files: [0; 2], curve: Vec::new() }
    }

    /// Asks the system after `tick`.
    pub(super) fn sample(&mut self, tick: u64) -> anyhow::Result<()> {
        let status = std::fs::read_to_string("/proc/self/status").context("/proc/self/status")?;
        let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kilobytes = resident.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
        let kilobytes = kilobytes.context("/proc/self/status: found no VmRSS in kB, wanted it")?;
        let open_files = std::fs::read_dir("/proc/self/fd").context("/proc/self/fd")?.count();
        self.add(tick, kilobytes << 10, open_files);
        Ok(())
    }

    fn add(&mut self, tick: u64, bytes: u64, open_files: usize) {
        let is_after = usize::from(5 * tick >= self.ticks);
        self.highest[is_after] = self.highest[is_after].max(bytes);
        self.open_files[is_after] = self.open_files[is_after].max(open_files);
        let piece = |tick: u64| tick * PIECES / self.ticks;
        match self.curve.last_mut() {
            Some(last) if piece(last.0) == piece(tick) => *last = (tick, last.1.max(bytes)),
            _ => self.curve.push((tick, bytes)),
        }
    }

    /// Highest after the first fifth of the ticks over the highest within it, less 1; 0 where either is unknown.
    pub(super) fn growth(&self) -> f64 {
        let [early, late] = self.highest;
        if early == 0 || late == 0 { 0.0 } else { late as f64 / early as f64 - 1.0 }
    }

    /// Most files open in the first fifth, and after it.
    pub(super) fn open_files(&self) -> [usize; 2] {
        let [early, late] = self.open_files;
        [if early == 0 { late } else { early }, late]
    }

    /// Ticks and MiB.
    pub(super) fn curve(&self) -> Vec<(u64, f64)> {
        self.curve.iter().map(|&(tick, bytes)| (tick, (bytes as f64 / MIB * 10.0).round() / 10.0)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn memory(mib: &[u64]) -> Memory {
        let mut memory = Memory::of(100 * mib.len() as u64);
        for (index, mib) in mib.iter().enumerate() {
            memory.add(100 * index as u64 + 99, mib << 20, 10 + index);
        }
        memory
    }

    #[test]
    fn growth_is_of_the_highest_after_the_first_fifth_over_the_highest_within_it() {
        let steady = memory(&[40, 80, 60, 80, 60, 80, 79, 78, 80, 60]);
        assert!((steady.growth() - 0.0).abs() < 1e-12, "{steady:?}");
        let leaks = memory(&[40, 80, 81, 82, 83, 84, 85, 86, 87, 88]);
        assert!((leaks.growth() - 0.1).abs() < 1e-12, "{leaks:?}");
        assert_eq!(leaks.open_files(), [11, 19]);
    }

    #[test]
    fn the_curve_has_the_highest_of_each_piece() {
        let mib: Vec<u64> = (0..100).map(|sample| if sample == 40 { 300 } else { 50 }).collect();
        let curve = memory(&mib).curve();
        assert_eq!(curve.len(), 50);
        assert_eq!((curve[20], curve[21]), ((4199, 300.0), (4399, 50.0)));
    }

    #[test]
    fn this_process_holds_some_memory_and_some_files() {
        let mut memory = Memory::of(1);
        memory.sample(0).unwrap();
        assert!(memory.highest[0] > 1 << 20 && memory.open_files[0] > 2, "{memory:?}");
    }
}
