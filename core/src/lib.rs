//! Everything of VOCALoco that runs on the robot: from an elevation map to the joint targets of the
//! chosen skill. Knows no physics engine, no training and no particular skill.

pub mod bundle;
pub mod danger;
pub mod decision;
pub mod decision_log;
pub mod elevation;
pub mod heightfield;
pub mod installation;
pub mod lock;
pub mod manifest;
mod moves;
pub mod observation;
pub mod plugin;
pub mod policy;
pub mod predictor;
pub mod registry;
pub mod replay;
pub mod robot;
pub mod runtime;
pub mod selector;
pub mod simd;
pub mod staging;
pub mod stand;
pub mod stdio;
pub mod switch;
pub mod target;
