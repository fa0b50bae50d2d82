//! What a soak came to, and which of its promises were broken.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;
use vocaloco_core::decision::{Decision, Forced};
use vocaloco_core::runtime::TickSummary;

use super::record::Difference;
use crate::output;

/// Growth of memory that is none.
const FLAT: f64 = 0.05;
/// Files that may be open beyond those of the warm-up: the isolated skill's, and what a look at files opens.
const SPARE_FILES: usize = 8;

/// What `--json` prints.
#[derive(Serialize)]
pub(super) struct Report {
    pub(super) command: String,
    pub(super) seed: u64,
    pub(super) version: &'static str,
    pub(super) deployment: String,
    pub(super) ticks: u64,
    /// Ticks whose decision is not in the log where it belongs.
    pub(super) missed: u64,
    /// Ticks that come to another choice or another driver when decided again.
    pub(super) replay_differs: u64,
    /// The first of them.
    pub(super) differences: Vec<Difference>,
    /// Faults that must end in the stand in the same tick and did not.
    pub(super) unanswered: u64,
    /// The first of them.
    pub(super) first_unanswered: Vec<Unanswered>,
    /// Ticks with a target that is no number.
    pub(super) unsound_targets: u64,
    /// Highest memory after the first fifth over the highest within it, less 1.
    pub(super) rss_growth: f64,
    /// Whether the run is long enough for that to be judged.
    pub(super) judges_growth: bool,
    /// Tick and highest memory since the one before, MiB.
    pub(super) rss_mib: Vec<(u64, f64)>,
    /// Most files open in the first fifth, and after it.
    pub(super) open_files: [usize; 2],
    /// How often each kind of fault came.
    pub(super) faults: BTreeMap<String, u64>,
    pub(super) skills_added: u64,
    pub(super) skills_removed: u64,
    /// Changes of who drives.
    pub(super) switches: u64,
    pub(super) driven_share: f64,
    pub(super) wall_s: f64,
    pub(super) ticks_per_s: f64,
    /// What ticks took, isolated plugins' hangs included.
    pub(super) timing: TickSummary,
}

/// A fault that was not answered as it must be.
#[derive(Debug, Serialize)]
pub(super) struct Unanswered {
    tick: u64,
    active: String,
    /// What had to overrule the window for what was put in, if anything.
    wanted: Option<Forced>,
    forced: Option<Forced>,
    events: Vec<String>,
}

impl Unanswered {
    pub(super) fn of(decision: &Decision, wanted: Option<Forced>) -> Self {
        let Decision { tick, active, forced, events, .. } = decision;
        Self { tick: *tick, active: active.clone(), wanted, forced: *forced, events: events.clone() }
    }
}

impl fmt::Display for Unanswered {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { tick, active, wanted, forced, events } = self;
        let said = |forced: &Option<Forced>| forced.map_or("nothing".to_owned(), |it| format!("{it:?}"));
        let (wanted, forced) = (said(wanted), said(forced));
        write!(formatter, "  tick {tick}: {active} drove, forced by {forced}, wanted {wanted}; {events:?}")
    }
}

impl Report {
    /// The promises that were broken, in words.
    pub(super) fn broken(&self) -> Vec<String> {
        let mut broken = Vec::new();
        for (count, what) in [
            (self.missed, "decisions are missing from the log"),
            (self.replay_differs, "decisions come out otherwise from the log"),
            (self.unanswered, "faults were not answered by the stand in the same tick"),
            (self.unsound_targets, "ticks had a target that is no number"),
        ] {
            if count > 0 {
                broken.push(format!("{count} {what}"));
            }
        }
        // Phrased as "is inside", so that NaN is broken too.
        if self.judges_growth && !(-1.0..=FLAT).contains(&self.rss_growth) {
            let (percent, most) = (100.0 * self.rss_growth, 100.0 * FLAT);
            broken.push(format!("memory grew by {percent:.1} %, wanted at most {most:.0} %"));
        }
        let [early, late] = self.open_files;
        if late > early + SPARE_FILES {
            broken.push(format!("{late} files were open, {early} in the first fifth"));
        }
        broken
    }

    /// For people.
    pub(super) fn say(&self) -> anyhow::Result<()> {
        let judged = if self.judges_growth { "at most 5 % wanted" } else { "too short to judge" };
        output::line(&format!(
            "{} ticks in {:.0} s, {:.0} a second: {} missed, {} decided otherwise from the log, {} faults unanswered, \
             memory {:+.1} % after the first fifth ({judged})",
            self.ticks,
            self.wall_s,
            self.ticks_per_s,
            self.missed,
            self.replay_differs,
            self.unanswered,
            100.0 * self.rss_growth,
        ))?;
        output::line(&format!(
            "skills came {} times and went {} times, the driver changed {} times, a skill drove in {:.0} % of the ticks",
            self.skills_added,
            self.skills_removed,
            self.switches,
            100.0 * self.driven_share
        ))?;
        for (fault, count) in &self.faults {
            output::line(&format!("  {count:7}  {fault}"))?;
        }
        for difference in &self.differences {
            output::line(&difference.to_string())?;
        }
        for unanswered in &self.first_unanswered {
            output::line(&unanswered.to_string())?;
        }
        output::line(&self.timing.to_string())?;
        output::line(&self.command)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sound() -> Report {
        Report {
            command: String::new(),
            seed: 1,
            version: "",
            deployment: String::new(),
            ticks: 100_000,
            missed: 0,
            replay_differs: 0,
            differences: Vec::new(),
            unanswered: 0,
            first_unanswered: Vec::new(),
            unsound_targets: 0,
            rss_growth: 0.05,
            judges_growth: true,
            rss_mib: Vec::new(),
            open_files: [12, 14],
            faults: BTreeMap::new(),
            skills_added: 0,
            skills_removed: 0,
            switches: 0,
            driven_share: 0.5,
            wall_s: 1.0,
            ticks_per_s: 1e5,
            timing: vocaloco_core::runtime::TickTimes::new(50.0).summary(),
        }
    }

    type Break = fn(&mut Report);

    #[test]
    fn every_broken_promise_is_named_and_growth_of_a_short_run_is_none() {
        assert!(sound().broken().is_empty());
        let breaks: [(Break, &str); 7] = [
            (|it| it.missed = 2, "2 decisions are missing"),
            (|it| it.replay_differs = 1, "1 decisions come out otherwise"),
            (|it| it.unanswered = 3, "3 faults were not answered"),
            (|it| it.unsound_targets = 1, "1 ticks had a target"),
            (|it| it.rss_growth = 0.051, "memory grew by 5.1 %"),
            (|it| it.rss_growth = f64::NAN, "memory grew by NaN %"),
            (|it| it.open_files = [12, 40], "40 files were open, 12 in"),
        ];
        for (change, wanted) in breaks {
            let mut report = sound();
            change(&mut report);
            let broken = report.broken();
            assert!(broken.len() == 1 && broken[0].starts_with(wanted), "{wanted}: {broken:?}");
        }
        let mut short = sound();
        (short.rss_growth, short.judges_growth) = (0.3, false);
        assert!(short.broken().is_empty());
    }
}
