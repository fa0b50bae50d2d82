//! How long ticks take: a histogram that never grows, however long the loop runs.

use std::time::Duration;

use serde::Serialize;

/// Bins to a doubling of time: a quantile is at most 1/64 above the true one.
const BINS_PER_OCTAVE: u64 = 64;
/// Doublings from a nanosecond up: the last bin begins beyond half a minute.
const OCTAVES: u64 = 36;

/// Durations of ticks, counted.
#[derive(Clone, Debug)]
pub struct TickTimes {
    bins: Vec<u64>,
    ticks: u64,
    max: Duration,
    missed: u64,
    overruns: u64,
    period: Duration,
}

/// What [`TickTimes`] come to, µs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TickSummary {
    /// Ticks measured.
    pub ticks: u64,
    /// Half of them took at most this.
    pub p50_us: f64,
    /// All but a hundredth of them took at most this.
    pub p99_us: f64,
    /// The longest.
    pub max_us: f64,
    /// Those that took longer than a period of the loop.
    pub missed: u64,
    /// Calls of plugins and predictors that took longer than their budget.
    pub overruns: u64,
}

impl TickTimes {
    /// None yet, of a loop of this rate.
    pub fn new(rate_hz: f64) -> Self {
        Self {
            bins: vec![0; (BINS_PER_OCTAVE * OCTAVES) as usize],
            ticks: 0,
            max: Duration::ZERO,
            missed: 0,
            overruns: 0,
            period: Duration::from_secs_f64(1.0 / rate_hz),
        }
    }

    /// Counts a tick.
    pub fn add(&mut self, tick: Duration) {
        let bin = bin(tick).min(self.bins.len() - 1);
        self.bins[bin] += 1;
        self.ticks += 1;
        self.max = self.max.max(tick);
        self.missed += u64::from(tick > self.period);
    }

    /// Counts a call over its budget.
    pub(crate) fn add_overrun(&mut self) {
        self.overruns += 1;
    }

    /// The figures so far.
    pub fn summary(&self) -> TickSummary {
        TickSummary {
            ticks: self.ticks,
            p50_us: self.quantile_us(0.5),
            p99_us: self.quantile_us(0.99),
            max_us: 1e6 * self.max.as_secs_f64(),
            missed: self.missed,
            overruns: self.overruns,
        }
    }

    /// The upper end of the bin that holds the quantile, no more than the longest tick; 0 of none.
    fn quantile_us(&self, share: f64) -> f64 {
        let rank = (share * self.ticks as f64).ceil() as u64;
        let mut below = 0;
        let bin = self.bins.iter().position(|count| {
            below += count;
            below >= rank.max(1)
        });
        bin.map_or(0.0, |bin| (1e-3 * end_ns(bin)).min(1e6 * self.max.as_secs_f64()))
    }
}

/// The bin of a duration: its octave, and 64 equal parts of that.
fn bin(tick: Duration) -> usize {
    let ns = u64::try_from(tick.as_nanos()).unwrap_or(u64::MAX).max(1);
    let octave = u64::from(ns.ilog2());
    let part = (u128::from(ns) * u128::from(BINS_PER_OCTAVE)) >> octave;
    (octave * BINS_PER_OCTAVE + part as u64 - BINS_PER_OCTAVE) as usize
}

fn end_ns(bin: usize) -> f64 {
    let (octave, part) = (bin as u64 / BINS_PER_OCTAVE, bin as u64 % BINS_PER_OCTAVE);
    (1_u64 << octave) as f64 * (1.0 + (part + 1) as f64 / BINS_PER_OCTAVE as f64)
}

impl std::fmt::Display for TickSummary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { ticks, p50_us, p99_us, max_us, missed, overruns } = self;
        write!(
            f,
            "{ticks} ticks: p50 {p50_us:.0} µs, p99 {p99_us:.0} µs, max {max_us:.0} µs; {missed} longer than \
             a period, {overruns} calls over their budget"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_within_two_percent_and_the_longest_is_exact() {
        let mut times = TickTimes::new(50.0);
        for us in 1..=1000_u64 {
            times.add(Duration::from_micros(us));
        }
        times.add(Duration::from_millis(21));
        let summary = times.summary();
        assert_eq!((summary.ticks, summary.missed, summary.max_us), (1001, 1, 21_000.0));
        assert!((501.0..=511.0).contains(&summary.p50_us), "{summary:?}");
        assert!((991.0..=1007.0).contains(&summary.p99_us), "{summary:?}");
    }

    #[test]
    fn no_ticks_and_an_hour_long_tick_have_a_summary() {
        let mut times = TickTimes::new(50.0);
        assert_eq!((times.summary().p50_us, times.summary().max_us), (0.0, 0.0));
        times.add(Duration::ZERO);
        times.add(Duration::from_hours(1));
        assert_eq!(times.summary().max_us, 3.6e9);
        assert!(times.summary().p50_us <= 0.002);
    }
}
