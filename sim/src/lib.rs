//! The rapier3d harness of VOCALoco: robot, terrain, rollouts, collection and evaluation. Loads
//! skills through `vocaloco-core`, as the robot does, and knows no particular one.

mod angle;
pub mod calibration;
pub mod collect;
pub mod collected;
pub mod course;
pub mod dataset;
pub mod driver;
pub mod environment;
pub mod evaluate;
pub mod handover;
pub mod identity;
pub mod kinematics;
pub mod latency;
pub mod occlusion;
pub mod physics;
pub mod plant;
pub mod plant_agreement;
pub mod promise;
pub mod rollout;
pub mod scene;
pub mod scores;
pub mod sensing;
pub mod spawn;
pub mod stream;
pub mod terrain;
pub mod threads;
pub mod transfer;
pub mod watched;
