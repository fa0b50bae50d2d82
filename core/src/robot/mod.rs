//! The robot, described once in MJCF and a TOML file beside it, as everything else sees it.
//!
//! Joints keep the MJCF's depth-first order, and link `i + 1` hangs behind joint `i`; names are
//! resolved here, at the door. Nothing here knows a physics engine. Only primitive shapes, hinge
//! joints at the link's origin and explicit inertias are taken; anything else is refused by name.

mod drive;
mod error;
mod mjcf;
mod nesting;
mod settings;
mod shape;
mod tree;

use std::path::Path;

use vocaloco_plugin_api::RobotDescription;

pub use drive::Drive;
pub use error::RobotError;
pub use settings::StandParameters;
pub use shape::{Role, Shape, ShapeKind};

use crate::manifest::{MAX_BYTES, bytes_of};

/// How the bytes of a robot's file are got.
pub type ReadFile<'a> = &'a dyn Fn(&Path) -> Result<Vec<u8>, RobotError>;

/// A robot: what plugins see of it, and what a physics engine needs besides.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotModel {
    /// Name, and the stem of its files.
    pub name: String,
    /// What a plugin is given: joints, ranges, masses, feet.
    pub description: RobotDescription,
    /// Links: the base first, then link `i + 1` behind joint `i`.
    pub links: Vec<Link>,
    /// Torque and speed limits of every drive.
    pub drive: Drive,
    /// How the robot stands and how it gets there.
    pub stand: StandParameters,
    /// SHA-256 of each file read, as `(file name, lowercase hex)`.
    pub file_hashes: Vec<(String, String)>,
}

/// A rigid link. Its frame has its origin at the joint that carries it; the base's at its centre
/// of mass. At zero position all link frames are parallel to the base's.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// Name of the MJCF body.
    pub name: String,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass in the link's frame, m.
    pub com_in_link_m: [f64; 3],
    /// Inertia about the centre of mass, rows and columns along the link's axes, kg·m².
    pub inertia_kg_m2: [[f64; 3]; 3],
    /// Reflected rotor inertia of the joint that carries this link, kg·m²; 0 for the base.
    pub armature_kg_m2: f64,
    /// Collision shapes.
    pub shapes: Vec<Shape>,
}

impl RobotModel {
    /// Reads `<name>.xml` and `<name>.toml` from `robots_dir`.
    ///
    /// # Errors
    /// A file is missing, does not parse, holds what this project does not model, or the two
    /// disagree: each names file, field, what was found and what would be right.
    pub fn load(robots_dir: &Path, name: &str) -> Result<Self, RobotError> {
        Self::load_by(robots_dir, name, &|path| {
            let wanted = || format!("a readable file of at most {MAX_BYTES} bytes");
            let unreadable = |found| RobotError::field(path, "file", found, wanted());
            bytes_of(path, MAX_BYTES).map_err(unreadable)
        })
    }

    /// As [`load`](Self::load), with `read` to read each file, once.
    ///
    /// # Errors
    /// As [`load`](Self::load), and those of `read`.
    pub fn load_by(robots_dir: &Path, name: &str, read: ReadFile<'_>) -> Result<Self, RobotError> {
        let settings = settings::File::read(&robots_dir.join(format!("{name}.toml")), read)?;
        let tree = mjcf::File::read(&robots_dir.join(format!("{name}.xml")), read)?;
        tree::assemble(name, &settings, &tree)
    }

    /// Number of joints.
    pub fn joint_count(&self) -> usize {
        self.description.joints.len()
    }

    /// Stand position of every joint, rad.
    pub fn stand_position_rad(&self) -> Vec<f32> {
        self.description.joints.iter().map(|joint| joint.stand_rad as f32).collect()
    }
}

#[cfg(test)]
mod tests;
