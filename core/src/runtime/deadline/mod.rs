//! Deadlines: what a call may take, who notices when it takes longer, and what it comes to.
//!
//! In real time plugins and predictors run on threads of their own and the loop waits no longer than
//! their budget; a call that hangs is abandoned with its thread. In simulated time overruns are
//! counted and nothing else, so that a run repeats.

mod overruns;
#[cfg(test)]
mod tests;
mod tick_times;
mod watched;
mod worker;

use std::time::Duration;

pub use tick_times::{TickSummary, TickTimes};

pub(super) use overruns::Overruns;
pub(super) use watched::{WatchedController, WatchedPredictors};

use crate::manifest::Deadlines;

/// Whose time the loop lives in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// A simulator's or a log's: budgets are measured and never acted on.
    Simulated,
    /// The world's: a call over its budget means stand.
    Real,
}

/// How a loop's time is watched.
#[derive(Clone, Copy, Debug)]
pub struct Supervision {
    /// Time since any fixed moment.
    pub clock: fn() -> Duration,
    /// Budgets of calls.
    pub deadlines: Deadlines,
    /// Whether they are acted on.
    pub pace: Pace,
}

impl Supervision {
    pub(super) fn act(&self) -> Duration {
        Duration::from_secs_f64(self.deadlines.act_s)
    }

    pub(super) fn predict(&self) -> Duration {
        Duration::from_secs_f64(self.deadlines.predict_s)
    }
}
