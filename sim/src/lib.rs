//! The rapier3d harness of VOCALoco: robot, terrain, rollouts, collection and evaluation. Loads
//! skills through `vocaloco-core`, as the robot does, and knows no particular one.

mod angle;
pub mod kinematics;
pub mod plant;
pub mod scores;
pub mod spawn;
pub mod stream;
pub mod terrain;
