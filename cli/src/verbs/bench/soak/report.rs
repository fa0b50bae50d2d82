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
/// Share of the ticks in which skills must drive: what nobody drives in proves little.
const DRIVES: f64 = 0.2;
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
    /// Ticks with a target that is no number or outside what its drive may be told.
    pub(super) unsound_targets: u64,
    /// Highest memory after the first fifth over the highest within it, less 1.
    pub(super) rss_growth: f64,
    /// Whether the run is long enough for that, and for who drives, to be judged.
    pub(super) judges_growth: bool,
    /// Whether it is long enough for every kind of fault to come.
    pub(super) judges_kinds: bool,
    /// Those that did not.
    pub(super) missing_kinds: Vec<&'static str>,
    /// Of all that was decided and every target: another run of the same seed has the same.
    pub(super) fingerprint: String,
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
    /// The same of each fifth of the ticks.
    pub(super) driven_share_of_fifths: [f64; 5],
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
    /// The skill that counted as viable though its prediction was spoiled, if any.
    believed: Option<String>,
    forced: Option<Forced>,
    events: Vec<String>,
}

impl Unanswered {
    pub(super) fn of(decision: &Decision, wanted: Option<Forced>, believed: Option<String>) -> Self {
        let Decision { tick, active, forced, events, .. } = decision;
        Self {
            tick: *tick,
            active: active.clone(),
            wanted,
            believed,
            forced: *forced,
            events: events.clone(),
        }
    }
}

impl fmt::Display for Unanswered {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { tick, active, wanted, believed, forced, events } = self;
        let said = |forced: &Option<Forced>| forced.map_or("nothing".to_owned(), |it| format!("{it:?}"));
        let (wanted, forced) = (said(wanted), said(forced));
        let believed = believed.as_ref().map_or(String::new(), |skill| format!(", {skill} was believed"));
        write!(
            formatter,
            "  tick {tick}: {active} drove, forced by {forced}, wanted {wanted}{believed}; {events:?}"
        )
    }
}

impl Report {
    /// The promises that were broken, in words.
    pub(super) fn broken(&self) -> Vec<String> {
        let mut broken = Vec::new();
        for (count, what) in [
            (self.missed, "decisions are missing from the log"),
            (self.replay_differs, "decisions come out otherwise from the log"),
            (self.unanswered, "faults were not answered in the same tick"),
            (self.unsound_targets, "ticks had a target that no drive may be told"),
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
        let idle = self.driven_share_of_fifths.iter().position(|share| !(DRIVES..=1.0).contains(share));
        if let Some(fifth) = idle.filter(|_| self.judges_growth) {
            let [percent, least] = [self.driven_share_of_fifths[fifth], DRIVES].map(|share| 100.0 * share);
            let which = ["first", "second", "third", "fourth", "last"][fifth];
            broken.push(format!(
                "skills drove in {percent:.1} % of the {which} fifth, wanted {least:.0} % or more"
            ));
        }
        if self.judges_kinds && !self.missing_kinds.is_empty() {
            broken.push(format!("{} never came", self.missing_kinds.join(", ")));
        }
        if self.judges_kinds && (self.skills_added == 0 || self.skills_removed == 0) {
            broken.push("no skills came or went".to_owned());
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
        output::line(&format!("fingerprint of all decisions and targets: {}", self.fingerprint))?;
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
            judges_kinds: true,
            missing_kinds: Vec::new(),
            fingerprint: String::new(),
            rss_mib: Vec::new(),
            open_files: [12, 14],
            faults: BTreeMap::new(),
            skills_added: 3,
            skills_removed: 2,
            switches: 0,
            driven_share: 0.5,
            driven_share_of_fifths: [0.5; 5],
            wall_s: 1.0,
            ticks_per_s: 1e5,
            timing: vocaloco_core::runtime::TickTimes::new(50.0).summary(),
        }
    }

    type Break = fn(&mut Report);

    #[test]
    fn every_broken_promise_is_named_and_growth_of_a_short_run_is_none() {
        assert!(sound().broken().is_empty());
        let breaks: [(Break, &str); 11] = [
            (|it| it.missed = 2, "2 decisions are missing"),
            (|it| it.replay_differs = 1, "1 decisions come out otherwise"),
            (|it| it.unanswered = 3, "3 faults were not answered"),
            (|it| it.unsound_targets = 1, "1 ticks had a target"),
            (|it| it.rss_growth = 0.051, "memory grew by 5.1 %"),
            (|it| it.rss_growth = f64::NAN, "memory grew by NaN %"),
            (|it| it.open_files = [12, 40], "40 files were open, 12 in"),
            (|it| it.driven_share_of_fifths[4] = 0.0, "skills drove in 0.0 % of the last fifth"),
            (|it| it.driven_share_of_fifths[0] = f64::NAN, "skills drove in NaN % of the first"),
            (|it| it.missing_kinds = vec!["plugin: error"], "plugin: error never came"),
            (|it| it.skills_added = 0, "no skills came or went"),
        ];
        for (change, wanted) in breaks {
            let mut report = sound();
            change(&mut report);
            let broken = report.broken();
            assert!(broken.len() == 1 && broken[0].starts_with(wanted), "{wanted}: {broken:?}");
        }
        let mut short = sound();
        (short.rss_growth, short.judges_growth) = (0.3, false);
        (short.missing_kinds, short.judges_kinds) = (vec!["plugin: error"], false);
        short.driven_share_of_fifths[2] = 0.0;
        assert!(short.broken().is_empty());
    }
}
