//! The two predictors of a skill: from a data set to `viability.onnx`, `cot.onnx` and a card.
//!
//! The network's shape is fixed by the method, so forward and backward pass are our own kernel
//! ([`kernel`]) instead of a learning library, and the same seed gives the same bytes whatever the
//! number of threads.

pub mod bench;
pub mod data;
pub mod export;
pub mod fit;
pub mod kernel;
pub mod known;
pub mod network;
pub mod novelty;
pub mod samples;
pub mod sgd;
pub mod training;
