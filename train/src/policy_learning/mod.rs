//! Learning of network policies: imitation of an expert in shadow, then proximal policy optimisation.
//!
//! Physics is behind one trait ([`task::Task`]). The same seed gives the same bytes on any number of
//! threads, and a run that was stopped and resumed equals one that never was.

pub mod adam;
pub mod advantage;
pub mod batch_pass;
pub mod checkpoint;
pub mod config;
pub mod descent;
mod elu;
pub mod gaussian;
pub mod imitation;
pub mod learner;
pub mod network;
pub mod normaliser;
pub mod ppo;
mod product;
mod shuffle;
pub mod single_pass;
pub mod task;
#[cfg(test)]
mod tests;
pub mod track;
pub mod trainer;
