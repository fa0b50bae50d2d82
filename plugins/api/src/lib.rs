//! The stable interface between VOCALoco and a locomotion skill's plugin.
//!
//! A plugin implements [`Skill`] and exports it with [`export_skill!`]; the host loads the library,
//! checks its layout and calls it through [`abi`]. Nothing here knows a simulator, a model runtime
//! or a manifest. Units are SI, frames REP-103 (x forward, y left, z up), joints in the order of
//! [`RobotDescription::joints`].

pub mod abi;
pub mod action;
pub mod contract;
mod description;
mod error;
mod host;
pub mod observation;
mod robot;
mod skill;
mod state;

pub use description::{CommandKind, Description, Needs, Parameter, Range, Scale, TerrainPatch};
pub use error::{ErrorCode, SkillError};
pub use host::{Host, Policy};
pub use robot::{FootDescription, JointDescription, RobotDescription};
pub use skill::Skill;
pub use state::{Command, JointTarget, RobotState};

/// Version of this interface; a plugin built against another one is refused at load.
pub const INTERFACE_VERSION: u32 = 2;
