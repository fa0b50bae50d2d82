//! The robot's kinematic tree, by name, as a plugin sees it.

use abi_stable::{
    StableAbi,
    std_types::{RString, RVec},
};

/// A revolute joint and the link behind it. At zero position all link frames are parallel to the
/// base frame.
#[repr(C)]
#[derive(StableAbi, Clone, Debug, PartialEq)]
pub struct JointDescription {
    /// Name, such as `LF_HAA`.
    pub name: RString,
    /// Index of the parent joint, or −1 when the parent link is the base.
    pub parent: i32,
    /// Origin of this joint in the parent link's frame, m. The child link's frame has its origin here.
    pub origin_in_parent_m: [f64; 3],
    /// Axis in the joint's frame, unit length.
    pub axis: [f64; 3],
    /// Working range, rad.
    pub lower_rad: f64,
    /// Working range, rad.
    pub upper_rad: f64,
    /// Largest torque, N·m.
    pub effort_nm: f64,
    /// Speed at which the drive has no torque left, rad/s.
    pub velocity_limit_rad_per_s: f64,
    /// Position in the robot's stand, rad.
    pub stand_rad: f64,
    /// Mass of the link behind this joint, kg.
    pub mass_kg: f64,
    /// Centre of mass of that link in its own frame, m.
    pub com_in_link_m: [f64; 3],
}

/// A spherical foot.
#[repr(C)]
#[derive(StableAbi, Clone, Debug, PartialEq)]
pub struct FootDescription {
    /// Name, such as `LF_FOOT`.
    pub name: RString,
    /// Index of the joint whose link carries the foot.
    pub joint: u32,
    /// Centre of the foot's sphere in that link's frame, m.
    pub centre_in_link_m: [f64; 3],
    /// Radius, m.
    pub radius_m: f64,
}

/// The robot that a plugin is created for. The order of `joints` is the order of every joint array.
#[repr(C)]
#[derive(StableAbi, Clone, Debug, PartialEq)]
pub struct RobotDescription {
    /// Name, such as `anymal_d`.
    pub name: RString,
    /// Total mass, kg.
    pub mass_kg: f64,
    /// Mass of the base link alone, kg.
    pub base_mass_kg: f64,
    /// Height of the base origin above flat ground in the stand, m.
    pub stand_height_m: f64,
    /// Joints, parents before children.
    pub joints: RVec<JointDescription>,
    /// Feet, one to a leg.
    pub feet: RVec<FootDescription>,
}
