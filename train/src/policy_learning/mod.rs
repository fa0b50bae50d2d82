//! Learning of network policies: imitation of an expert in shadow, then proximal policy optimisation.
//!
//! Physics is behind one trait ([`task::Task`]). The same seed gives the same bytes on any number of
//! threads, and a run that was stopped and resumed equals one that never was.

pub mod adam;
pub mod advantage;
pub mod batch_pass;
pub mod checkpoint;
pub mod config;
pub mod curves;
pub mod descent;
mod elu;
pub mod event_file;
pub mod folder;
pub mod gaussian;
pub mod imitation;
pub mod learner;
mod legged;
mod narration;
pub mod network;
pub mod normaliser;
pub mod picture;
pub mod policy_file;
pub mod ppo;
mod product;
pub mod run;
mod shuffle;
pub mod single_pass;
pub mod speed;
pub mod task;
#[cfg(test)]
mod tests;
pub mod track;
pub mod trainer;
