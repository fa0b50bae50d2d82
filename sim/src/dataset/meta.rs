//! `meta.json`: what a data set was made of. Equal metas mean equal rows, so nothing in it depends
//! on threads, shards, the command line or a library's bytes; those stand in `runs.jsonl`.

use std::{collections::BTreeMap, path::Path};

use serde::{Deserialize, Serialize};

use super::{DatasetError, Kind, Layout, write_atomically};
use crate::collect::CollectConfig;

/// Version of the layout.
pub const SCHEMA: u32 = 1;
/// Name of the file.
pub const META_FILE: &str = "meta.json";

/// What a data set was made of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Meta {
    /// Version of the layout: [`SCHEMA`].
    pub schema: u32,
    /// What the labels are.
    pub kind: Kind,
    /// Number of rows drawn; a cost data set stores fewer, since base crashes are left out.
    pub rows: u64,
    /// Rows to a shard.
    pub rows_per_shard: u64,
    /// The robot.
    pub robot: RobotId,
    /// The skill.
    pub skill: SkillId,
    /// The physics engine.
    pub simulator: SimulatorId,
    /// Everything else that rows depend on.
    pub config: CollectConfig,
}

/// A robot by name and the hashes of its files.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotId {
    /// Name.
    pub name: String,
    /// SHA-256 by file name.
    pub files_sha256: BTreeMap<String, String>,
}

/// A skill by name, plugin and the hashes of what makes it behave as it does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkillId {
    /// Name.
    pub name: String,
    /// Name of its plugin.
    pub plugin: String,
    /// The plugin's version.
    pub plugin_version: String,
    /// SHA-256 over the plugin's source files, where they are at hand.
    pub plugin_source_sha256: Option<String>,
    /// SHA-256 of the parameter text, or of the policy's contract.
    pub parameters_sha256: String,
    /// SHA-256 of the policy network, where it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policy_sha256: Option<String>,
    /// How far ahead its position targets are set, m, where it takes any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_distance_m: Option<f32>,
}

/// A physics engine.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulatorId {
    /// Name.
    pub name: String,
    /// Version.
    pub version: String,
}

impl Meta {
    /// How its rows are spread over files.
    pub fn layout(&self) -> Layout {
        Layout { rows: self.rows, rows_per_shard: self.rows_per_shard }
    }

    /// Reads `meta.json` of a data set's folder.
    ///
    /// # Errors
    /// The file is missing, is not JSON of this layout, or of another version of it.
    pub fn read(folder: &Path) -> Result<Self, DatasetError> {
        let path = folder.join(META_FILE);
        let text = std::fs::read_to_string(&path).map_err(DatasetError::io(&path))?;
        let meta: Self = serde_json::from_str(&text)
            .map_err(|error| DatasetError::content(&path, "meta", error, "the layout of schema 1"))?;
        if meta.schema != SCHEMA {
            return Err(DatasetError::content(&path, "schema", meta.schema, SCHEMA));
        }
        if meta.rows_per_shard == 0 {
            return Err(DatasetError::content(&path, "rows_per_shard", 0, "1 or more"));
        }
        Ok(meta)
    }

    /// Writes `meta.json` into a data set's folder, whole or not at all.
    ///
    /// # Errors
    /// The file system would not.
    pub fn write(&self, folder: &Path) -> Result<(), DatasetError> {
        let mut text = serde_json::to_string_pretty(self)
            .map_err(|error| DatasetError::content(folder, META_FILE, error, "a meta that serialises"))?;
        text.push('\n');
        write_atomically(&folder.join(META_FILE), text.as_bytes())
    }

    /// Checks that `self` can continue a data set made under `other`: the same in all but the number
    /// of rows.
    ///
    /// # Errors
    /// Names the first part that differs.
    pub fn check_same(&self, other: &Self, folder: &Path) -> Result<(), DatasetError> {
        let parts = |meta: &Self| {
            // By way of text, which keeps 0.1 from becoming the double nearest to the float 0.1.
            let text = serde_json::to_string(meta).unwrap_or_default();
            let mut value: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
            if let Some(object) = value.as_object_mut() {
                object.remove("rows");
            }
            let mut parts = BTreeMap::new();
            flatten("", &value, &mut parts);
            parts
        };
        let (mine, theirs) = (parts(self), parts(other));
        let keys: std::collections::BTreeSet<_> = mine.keys().chain(theirs.keys()).collect();
        for key in keys {
            let text = |parts: &BTreeMap<String, String>| {
                parts.get(key).cloned().unwrap_or_else(|| "nothing".into())
            };
            if mine.get(key) != theirs.get(key) {
                let path = folder.join(META_FILE);
                return Err(DatasetError::content(&path, key, text(&theirs), text(&mine)));
            }
        }
        Ok(())
    }
}

fn flatten(prefix: &str, value: &serde_json::Value, parts: &mut BTreeMap<String, String>) {
    match value {
        serde_json::Value::Object(fields) => {
            for (name, field) in fields {
                let key = if prefix.is_empty() { name.clone() } else { format!("{prefix}.{name}") };
                flatten(&key, field, parts);
            }
        }
        other => {
            parts.insert(prefix.to_owned(), other.to_string());
        }
    }
}
