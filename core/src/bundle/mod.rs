//! A skill as one file: manifest, plugin, models, card, and a lock that names the hash of each.
//!
//! The file is a tar in gzip whose first entry is the lock. Nothing in it is believed: entries are
//! plain files that the lock names, inside the skill's own places, below fixed sizes; all are read and
//! checked in memory, tried as a skill in a staging folder, and only then renamed into the installation.

mod content;
mod install;
mod pack;
mod unpack;

pub use install::{Installed, install, remove};
pub use pack::{Packed, pack};
pub use unpack::{Bundle, unpack};

use crate::installation::Installation;
use crate::manifest::Finding;
use crate::registry::{ModelPolicy, check_skill};
use crate::robot::RobotModel;
use crate::staging::failed;

/// Last part of a bundle's file name.
pub const EXTENSION: &str = "skill";
/// Largest bundle, bytes.
pub(crate) const MAX_BUNDLE_BYTES: u64 = 64 << 20;
/// Largest sum of what a bundle unpacks to, bytes.
pub(crate) const MAX_UNPACKED_BYTES: u64 = 128 << 20;
/// Most files in a bundle.
pub(crate) const MAX_FILES: usize = 32;
/// Name of the lock in a bundle and, installed, in the skill's folder.
pub(crate) const LOCK: &str = "bundle.lock";
/// Name of the lock's signature.
pub(crate) const SIGNATURE: &str = "bundle.lock.sig";

/// The first thing that is wrong with a skill on each robot that `robots` has, if it is so on all.
fn unsound(skill: &Installation, name: &str, robots: &Installation) -> Result<(), Finding> {
    let folder = robots.robots_folder();
    let known = robots.robot_names().map_err(failed(&folder, "robot"))?;
    let mut first = None;
    for robot in known {
        let found = match RobotModel::load(&folder, &robot) {
            Ok(robot) => check_skill(skill, name, &robot.description, ModelPolicy::Required),
            Err(error) => vec![Finding::new(&folder, "robot", error, "a sound robot")],
        };
        match found.into_iter().next() {
            None => return Ok(()),
            Some(finding) => first = first.or(Some(finding)),
        }
    }
    Err(first.unwrap_or_else(|| Finding::new(&folder, "robot", "none", "at least one to check against")))
}
