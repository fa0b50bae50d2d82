//! Learning for VOCALoco: the two predictors of a skill, the optimiser of structured controllers, and
//! network policies. Sees data sets and environments, never the robot's runtime loop.

pub mod card;
mod files;
pub mod onnx;
pub mod policy_learning;
pub mod policy_search;
pub mod predictor;
pub mod train_policy;
