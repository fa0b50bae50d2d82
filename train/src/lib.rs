//! Learning for VOCALoco: the two predictors of a skill, and the optimiser of structured
//! controllers. Sees data sets and environments, never the robot's runtime loop.

pub mod policy_search;
pub mod predictor;
