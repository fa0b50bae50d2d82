//! Observation terms: what is measured, in which frame and order, with which scale, clip and history.
//!
//! Defined once, for the plugin that runs a policy and for the environment that trained it.

mod heights;
mod observer;
mod term;

pub use heights::{HeightOrder, HeightPatch};
pub use observer::{HistoryLayout, OBSERVATION_CLIP, Observer};
pub use term::{ObservationTerm, Term};

#[cfg(test)]
mod tests;
