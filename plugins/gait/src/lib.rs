//! A structured perceptive gait: a trot whose feet land where the terrain ahead allows, whose legs
//! carry a balance wrench, and whose numbers an optimiser finds.
//!
//! It refuses to know which skill it is: walk, ascend and descend are parameter files. Its one
//! decision: standing legs are moved relative to where they are measured, not to a plan, so that a
//! late or slipping foot never winds up an error.

mod balance;
mod body;
mod foothold;
mod gait;
mod ground;
mod kinematics;
mod parameters;
mod swing;
#[cfg(test)]
mod test_robot;

pub use gait::Gait;

vocaloco_plugin_api::export_skill!(Gait);
