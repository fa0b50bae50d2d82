//! The decisions of a run that is too long for one log: written, read back and decided again piece by piece.

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;
use vocaloco_core::decision::Decision;
use vocaloco_core::decision_log::{DecisionLog, LogWriter, Setup};
use vocaloco_core::replay::Replayer;
use vocaloco_core::runtime::Runtime;

use super::bundles::DEPLOYMENT;

/// Of what should not be, as many are shown.
pub(super) const SHOWN: usize = 20;

/// A tick that came to something else the second time.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Difference {
    tick: u64,
    /// Choice and driver.
    recorded: [String; 2],
    replayed: [String; 2],
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([choice, active], [choice_now, active_now]) = (&self.recorded, &self.replayed);
        write!(f, "  tick {}: chose {choice}, {active} drove; now {choice_now}, {active_now}", self.tick)
    }
}

/// The log that is being written, and what came of those before it.
pub(super) struct Record {
    file: PathBuf,
    log: Option<LogWriter>,
    replay: Again,
}

impl Record {
    /// Begins with the runtime's first tick.
    pub(super) fn start(file: &Path, runtime: &Runtime) -> anyhow::Result<Self> {
        let setup = Setup::of(runtime, DEPLOYMENT);
        let log = Some(LogWriter::create(file, &setup)?);
        Ok(Self { file: file.to_owned(), log, replay: Again::of(&setup) })
    }

    /// Appends a tick.
    pub(super) fn write(&mut self, decision: &Decision) -> anyhow::Result<()> {
        self.log.iter_mut().try_for_each(|log| log.write(decision))?;
        Ok(())
    }

    /// Reads the log back, decides it again and begins another in its place.
    pub(super) fn turn_over(&mut self, runtime: &Runtime) -> anyhow::Result<()> {
        self.log.take().map_or(Ok(()), LogWriter::finish)?;
        for decision in DecisionLog::read(&self.file)?.decisions {
            self.replay.decide(&decision);
        }
        self.log = Some(LogWriter::create(&self.file, &Setup::of(runtime, DEPLOYMENT))?);
        Ok(())
    }

    /// Ticks that were read back, each where it belongs.
    pub(super) fn read(&self) -> u64 {
        self.replay.read
    }

    /// Ticks that came to something else.
    pub(super) fn differing(&self) -> u64 {
        self.replay.differing
    }

    /// The first of them.
    pub(super) fn into_differences(self) -> Vec<Difference> {
        self.replay.differences
    }
}

/// The whole run, decided again.
struct Again {
    replayer: Replayer,
    next_tick: u64,
    read: u64,
    differing: u64,
    differences: Vec<Difference>,
}

impl Again {
    fn of(setup: &Setup) -> Self {
        let replayer = Replayer::new(setup.rules(), setup.windows());
        Self { replayer, next_tick: 0, read: 0, differing: 0, differences: Vec::new() }
    }

    fn decide(&mut self, decision: &Decision) {
        self.read += u64::from(decision.tick == self.next_tick);
        self.next_tick = decision.tick + 1;
        let again = self.replayer.as_recorded(decision);
        if again.agrees_with(decision) {
            return;
        }
        self.differing += 1;
        if self.differences.len() < SHOWN {
            let recorded = [decision.choice.clone(), decision.active.clone()];
            let replayed = [again.choice, again.active];
            self.differences.push(Difference { tick: decision.tick, recorded, replayed });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_core::decision::{STAND, STOP};

    fn again() -> Again {
        Again::of(&Setup {
            schema: 1,
            version: String::new(),
            deployment: DEPLOYMENT.into(),
            robot: "anymal_d".into(),
            backend: String::new(),
            rate_hz: 50.0,
            switch_window: 10,
            stop_window: 10,
            resume_window: 25,
            skills: Vec::new(),
        })
    }

    fn standing(tick: u64) -> Decision {
        Decision { tick, choice: STOP.into(), active: STAND.into(), ..Decision::default() }
    }

    #[test]
    fn a_decision_that_is_missing_or_out_of_place_is_not_counted_as_read() {
        for (ticks, read) in [(&[0, 1, 2, 3][..], 4), (&[0, 1, 3], 2), (&[1, 2, 3], 2), (&[0, 1, 1, 2], 3)] {
            let mut again = again();
            for &tick in ticks {
                again.decide(&standing(tick));
            }
            assert_eq!((again.read, again.differing), (read, 0), "{ticks:?}");
        }
    }

    #[test]
    fn a_decision_that_comes_out_otherwise_is_shown() {
        let mut again = again();
        again.decide(&Decision { active: "walk".into(), ..standing(0) });
        assert_eq!((again.read, again.differing), (1, 1));
        assert_eq!(again.differences[0].to_string(), "  tick 0: chose stop, walk drove; now stop, stand");
    }
}
