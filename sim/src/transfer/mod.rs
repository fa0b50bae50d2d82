//! Transfer: the same plugin, from the same poses, with the same draws, in a second simulator.
//!
//! Noise, terrain patch, commands, drives and outcome rules are the rollout's own, in Rust, for both;
//! MuJoCo is asked for nothing but the motion under given torques. It runs as a Python process, one to
//! a thread, so that nothing here links it and only who asks for this needs it.

mod agreement;
mod error;
mod ground;
mod link;
mod mujoco;
mod paired;
mod speed;

pub use agreement::{Agreement, agreement};
pub use error::TransferError;
pub use mujoco::{Interpreter, MujocoPlant, SUBSTEPS};
pub use paired::{Pair, Peers, STAND_S, sample_pairs};
pub use speed::{PeerSpeed, time_peer};

#[cfg(test)]
mod tests;
