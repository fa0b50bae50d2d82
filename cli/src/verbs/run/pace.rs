//! Whose time a run lives in, and what its ticks took.

use std::sync::LazyLock;
use std::time::{Duration, Instant};

use vocaloco_core::manifest::Deadlines;
#[cfg(feature = "sim")]
use vocaloco_core::runtime::TickSummary;
use vocaloco_core::runtime::{Pace, Supervision};

use super::Args;
#[cfg(feature = "sim")]
use crate::output;

/// Time since this program first asked.
pub(crate) fn clock() -> Duration {
    #[expect(clippy::disallowed_methods, reason = "measures ticks; in real time, budgets are of this clock")]
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    START.elapsed()
}

impl Args {
    /// How the loop's time is watched.
    pub(super) fn supervision(&self, deadlines: Deadlines) -> Supervision {
        let pace = if self.real_time { Pace::Real } else { Pace::Simulated };
        Supervision { clock, deadlines, pace }
    }

    /// The words of the command line that these arguments add.
    #[cfg(feature = "sim")]
    pub(super) fn real_time_flag(&self) -> &'static str {
        if self.real_time { " --real-time" } else { "" }
    }
}

/// The last line of narration of every run; with `--json` an object.
#[cfg(feature = "sim")]
pub(super) fn narrate(times: &TickSummary, as_json: bool) {
    if as_json {
        output::narrate(serde_json::json!({ "timing": times }));
    } else {
        output::narrate(times);
    }
}

/// Holds a loop to a rate: ticks begin a period apart by the clock, or at once when they are late.
#[cfg(feature = "sim")]
pub(super) struct Metronome {
    period: Duration,
    next: Duration,
}

#[cfg(feature = "sim")]
impl Metronome {
    pub(super) fn new(rate_hz: f64) -> Self {
        Self { period: Duration::from_secs_f64(1.0 / rate_hz), next: clock() }
    }

    /// Waits for the next beat.
    pub(super) fn wait(&mut self) {
        std::thread::sleep(self.next.saturating_sub(clock()));
        // Beats that were missed are not made up for.
        self.next = (self.next + self.period).max(clock());
    }
}
