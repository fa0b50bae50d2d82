//! Who made a result: robot, skill, plugin source and physics engine by name and hash.

use std::{collections::BTreeMap, path::Path};

use sha2::{Digest, Sha256};
use vocaloco_core::robot::RobotModel;

use crate::{
    dataset::{RobotId, SimulatorId, SkillId},
    plant::PlantKind,
    rollout::RolledSkill,
};

/// Version of the physics engine, as `Cargo.toml` pins it.
pub const RAPIER_VERSION: &str = "0.36.1";
/// Version of the fast plant's dynamics, raised whenever the same row comes out otherwise.
pub const REDUCED_VERSION: &str = "1";

/// SHA-256 in lowercase hex.
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(Sha256::digest(bytes).as_slice())
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |text, byte| format!("{text}{byte:02x}"))
}

/// Name and files of a robot.
pub fn robot(robot: &RobotModel) -> RobotId {
    RobotId { name: robot.name.clone(), files_sha256: robot.file_hashes.iter().cloned().collect() }
}

/// Name, plugin and parameters of a skill.
pub fn skill(skill: &RolledSkill, plugin_source_sha256: Option<String>) -> SkillId {
    SkillId {
        name: skill.name.clone(),
        plugin: skill.description().name.to_string(),
        plugin_version: skill.description().version.to_string(),
        plugin_source_sha256,
        parameters_sha256: sha256_hex(skill.parameters().as_bytes()),
        policy_sha256: skill.policy().map(|policy| policy.sha256().to_owned()),
        target_distance_m: skill.target().map(|target| target.distance_m),
    }
}

/// What steps a plant.
pub fn simulator(plant: PlantKind) -> SimulatorId {
    let (name, version) = match plant {
        PlantKind::Reference => ("rapier3d", RAPIER_VERSION),
        PlantKind::Fast => ("reduced", REDUCED_VERSION),
    };
    SimulatorId { name: name.to_owned(), version: version.to_owned() }
}

/// SHA-256 over the manifest and sources of a plugin's folder: each file's path, length and bytes,
/// in the order of their paths. `None` where there is no such folder.
///
/// # Errors
/// A file cannot be read.
pub fn source_sha256(plugin_folder: &Path) -> std::io::Result<Option<String>> {
    if !plugin_folder.join("Cargo.toml").is_file() {
        return Ok(None);
    }
    let mut files = BTreeMap::new();
    files.insert("Cargo.toml".to_owned(), plugin_folder.join("Cargo.toml"));
    let mut folders = vec![("src".to_owned(), plugin_folder.join("src"))];
    while let Some((name, folder)) = folders.pop() {
        for entry in std::fs::read_dir(folder)? {
            let entry = entry?;
            let name = format!("{name}/{}", entry.file_name().to_string_lossy());
            if entry.file_type()?.is_dir() {
                folders.push((name, entry.path()));
            } else {
                files.insert(name, entry.path());
            }
        }
    }
    let mut hash = Sha256::new();
    for (name, path) in files {
        let bytes = std::fs::read(path)?;
        for part in [name.as_bytes(), &bytes] {
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
    }
    Ok(Some(hex(hash.finalize().as_slice())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pinned_version_of_the_engine_is_the_one_named() {
        let manifest = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../Cargo.toml"));
        let pinned = format!("rapier3d = {{ version = \"={RAPIER_VERSION}\"");
        assert!(manifest.unwrap().contains(&pinned), "wanted {pinned}");
    }

    #[test]
    fn rows_of_one_plant_do_not_pass_for_those_of_the_other() {
        assert_eq!(simulator(PlantKind::Reference).name, "rapier3d");
        assert_ne!(simulator(PlantKind::Reference), simulator(PlantKind::Fast));
    }

    #[test]
    fn a_changed_moved_or_added_source_file_changes_the_hash() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        assert_eq!(source_sha256(folder.path()).unwrap(), None);
        write("Cargo.toml", "[package]");
        write("src/lib.rs", "mod a;");
        let mut seen = vec![source_sha256(folder.path()).unwrap().unwrap()];
        for (name, text) in [("src/lib.rs", "mod b;"), ("src/deep/c.rs", ""), ("src/d.rs", "x")] {
            write(name, text);
            let hash = source_sha256(folder.path()).unwrap().unwrap();
            assert!(!seen.contains(&hash), "{name}");
            seen.push(hash);
        }
        write("README.md", "not source");
        assert_eq!(source_sha256(folder.path()).unwrap().as_ref(), seen.last());
    }
}
