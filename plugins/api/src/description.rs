//! What a plugin says of itself before any instance exists.

use abi_stable::{
    StableAbi,
    std_types::{ROption, RString, RVec},
};

/// Which command a skill follows.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandKind {
    /// Forward, sideways and yaw velocity.
    Velocity,
    /// A target pose ahead and the time left to reach it.
    PositionTarget,
}

impl CommandKind {
    /// Its id in manifests.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Velocity => "velocity",
            Self::PositionTarget => "position_target",
        }
    }
}

/// A closed interval.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Smallest value, included.
    pub min: f64,
    /// Largest value, included.
    pub max: f64,
}

/// A rectangle of terrain heights that a plugin asks for each tick, yaw-aligned with the base.
///
/// Rows run from `back_m` behind the base to `front_m` ahead, columns from `half_width_m` left (+y)
/// to the same distance right; see [`RobotState::terrain_m`](crate::RobotState::terrain_m).
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq)]
pub struct TerrainPatch {
    /// Distance behind the base, m.
    pub back_m: f64,
    /// Distance ahead of the base, m.
    pub front_m: f64,
    /// Half the width, m.
    pub half_width_m: f64,
    /// Spacing of the points in both directions, m.
    pub resolution_m: f64,
}

impl TerrainPatch {
    /// Number of rows, back to front.
    pub fn rows(&self) -> usize {
        ((self.back_m + self.front_m) / self.resolution_m).round() as usize + 1
    }

    /// Number of columns, left to right.
    pub fn columns(&self) -> usize {
        (2.0 * self.half_width_m / self.resolution_m).round() as usize + 1
    }
}

/// What a plugin needs from its host.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq)]
pub struct Needs {
    /// A policy network, which the host runs; see [`Host`](crate::Host).
    pub policy: bool,
    /// Terrain heights, if any.
    pub terrain: ROption<TerrainPatch>,
    /// Foot contacts, in the order of [`RobotDescription::feet`](crate::RobotDescription).
    pub foot_contacts: bool,
    /// Measured or estimated joint torques.
    pub joint_torques: bool,
}

/// How an optimiser should search a parameter.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Evenly between min and max.
    Linear,
    /// Evenly in the logarithm; min must be positive.
    Log,
}

/// A tunable number of a plugin.
#[repr(C)]
#[derive(StableAbi, Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Its key in the parameter text.
    pub name: RString,
    /// SI unit, `1` for a pure number.
    pub unit: RString,
    /// Value used when the text leaves it out.
    pub default: f64,
    /// The interval that an optimiser may search and the plugin accepts.
    pub range: Range,
    /// How to search it.
    pub scale: Scale,
}

/// What a plugin is, what it needs and what can be tuned.
#[repr(C)]
#[derive(StableAbi, Clone, Debug, PartialEq)]
pub struct Description {
    /// Name of the plugin, `snake_case`.
    pub name: RString,
    /// Version of the plugin's own code.
    pub version: RString,
    /// One sentence.
    pub summary: RString,
    /// Joints that the plugin drives, by name; empty when it takes whatever the robot has.
    pub joints: RVec<RString>,
    /// Rate at which `act` must be called, Hz.
    pub rate_hz: f64,
    /// The command it follows.
    pub command: CommandKind,
    /// Forward velocity that it can follow, m/s (velocity commands).
    pub forward_m_per_s: Range,
    /// What it reads each tick, unless an instance says otherwise; see [`Skill::needs`](crate::Skill).
    pub needs: Needs,
    /// Its tunable numbers.
    pub parameters: RVec<Parameter>,
}
