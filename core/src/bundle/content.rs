//! The lock of a bundle: what is in it, and for which host.

use std::collections::BTreeMap;
use std::path::{Component, Path};

use serde::{Deserialize, Serialize};
use vocaloco_plugin_api::INTERFACE_VERSION;

use super::MAX_FILES;
use crate::manifest::{Finding, is_snake_case};

/// What the file `bundle.lock` holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Content {
    pub(super) schema: u32,
    pub(super) skill: String,
    /// What the plugin was built for, such as `x86_64-linux`.
    pub(super) platform: String,
    /// The skill interface that the plugin speaks.
    pub(super) interface: u32,
    /// Hashes by path below an installation's root.
    pub(super) files: BTreeMap<String, String>,
}

pub(super) fn platform() -> String {
    format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS)
}

impl Content {
    /// Reads and checks the lock of the bundle `file`.
    pub(super) fn parse(file: &Path, text: &str) -> Result<Self, Finding> {
        let content: Self = toml::from_str(text).map_err(|error| {
            Finding::new(file, "bundle.lock", error.message(), "a lock as `skills pack` writes it")
        })?;
        let finding =
            |field: &str, found: String, wanted: String| Err(Finding::new(file, field, found, wanted));
        if content.schema != 1 {
            return finding("schema", content.schema.to_string(), "1".into());
        }
        if !is_snake_case(&content.skill) {
            return finding("skill", format!("{:?}", content.skill), "a skill's name in snake_case".into());
        }
        if content.files.len() > MAX_FILES {
            return finding("files", content.files.len().to_string(), format!("at most {MAX_FILES}"));
        }
        for path in content.files.keys() {
            content.place(file, path)?;
        }
        let manifest = content.manifest();
        if !content.files.contains_key(&manifest) {
            return finding("files", format!("no {manifest}"), "the skill's manifest".into());
        }
        Ok(content)
    }

    /// Whether this host can load the plugin.
    pub(super) fn check_host(&self, file: &Path) -> Result<(), Finding> {
        if self.platform != platform() {
            let (found, wanted) = (format!("{:?}", self.platform), format!("{:?}", platform()));
            return Err(Finding::new(file, "platform", found, wanted));
        }
        if self.interface != INTERFACE_VERSION {
            return Err(Finding::new(file, "interface", self.interface, INTERFACE_VERSION));
        }
        Ok(())
    }

    /// Path of the manifest below a root.
    pub(super) fn manifest(&self) -> String {
        format!("manifests/skills/{}.toml", self.skill)
    }

    /// Whether `path` is one that this skill may have: its manifest, or a file in its own folder.
    pub(super) fn place(&self, file: &Path, path: &str) -> Result<(), Finding> {
        let plain = |part: &str| {
            !part.starts_with('.') && part.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c))
        };
        let parts: Vec<&str> = path.split('/').collect();
        let is_plain = parts.iter().all(|part| !part.is_empty() && plain(part))
            && Path::new(path).components().all(|part| matches!(part, Component::Normal(_)));
        let is_own = match parts.as_slice() {
            ["skills", skill, rest @ ..] => *skill == self.skill && (1..=4).contains(&rest.len()),
            _ => path == self.manifest(),
        };
        // The lock itself is put there, and nothing may pose as it.
        let is_free = !path.to_ascii_lowercase().contains(super::LOCK);
        if is_plain && is_own && is_free && path.len() <= 240 {
            return Ok(());
        }
        let wanted = format!("{} or a plain path inside skills/{}/", self.manifest(), self.skill);
        Err(Finding::new(file, "entry", format!("{:?}", shortened(path)), wanted))
    }
}

/// A name from a hostile file may be a megabyte long.
pub(super) fn shortened(text: &str) -> String {
    text.chars().take(80).collect()
}
