//! A collected data set as the fit needs it: what is trained on, what is left out, where it came from.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::bail;
use vocaloco_sim::dataset::{self, Dataset, Kind, META_FILE, SkillId};

use super::samples::Sample;
use super::sgd::Head;

/// One data set of one skill.
#[derive(Debug)]
pub struct DataSet {
    /// The folder it was read from.
    pub folder: PathBuf,
    /// The robot it was collected on.
    pub robot: String,
    /// SHA-256 over meta.json and the shards, in order.
    pub sha256: String,
    /// The rows to train on and to hold out.
    pub samples: Vec<Sample>,
    /// Rows in the files that are not fitted.
    pub left_out: usize,
    /// Most rollouts of a row.
    pub repeats: u32,
    /// Seed of its rows.
    pub seed: u64,
    /// The skill as it was rolled out: plugin, parameters, policy.
    pub skill: SkillId,
    /// How it was collected, as one line of Markdown.
    pub collected_by: String,
    terrain: BTreeMap<&'static str, Range>,
}

#[derive(Debug, Clone, Copy)]
struct Range {
    rows: usize,
    low_m: f32,
    high_m: f32,
}

impl DataSet {
    /// Reads `data/skill/kind`.
    ///
    /// # Errors
    /// It is missing, unsound, incomplete, or of another skill or kind.
    pub fn read(data: &Path, skill: &str, head: Head) -> anyhow::Result<Self> {
        let kind = match head {
            Head::Sigmoid => Kind::Viability,
            Head::Linear => Kind::Cot,
        };
        let folder = data.join(skill).join(kind.id());
        if !folder.join(META_FILE).exists() {
            bail!(
                "{}: found no data set; `vocaloco collect --skill {skill} --kind {}` makes one",
                folder.display(),
                kind.id()
            );
        }
        let set = dataset::read(&folder)?;
        let meta_file = folder.join(META_FILE);
        if set.meta.kind != kind {
            bail!("{}: kind: found {}, wanted {}", meta_file.display(), set.meta.kind.id(), kind.id());
        }
        if set.meta.skill.name != skill {
            bail!("{}: skill.name: found {}, wanted {skill}", meta_file.display(), set.meta.skill.name);
        }
        let sha256 = dataset::sha256(&folder)?;
        Ok(Self {
            robot: set.meta.robot.name.clone(),
            repeats: set.rollouts.iter().copied().max().unwrap_or(0),
            seed: set.meta.config.seed,
            skill: set.meta.skill.clone(),
            collected_by: collected_by(&set)?,
            samples: samples(&set),
            left_out: set.trainable.iter().filter(|trainable| !**trainable).count(),
            terrain: terrain(&set),
            folder,
            sha256,
        })
    }

    /// The labels that are fitted.
    pub fn labels(&self) -> impl Iterator<Item = f32> {
        self.samples.iter().map(|sample| sample.label)
    }

    /// Terrain kinds with their sizes and numbers of rows, as one line.
    pub fn terrain_ranges(&self) -> String {
        let kinds = self.terrain.iter().map(|(kind, range)| {
            format!("{kind} {:.2} to {:.2} ({} rows)", range.low_m, range.high_m, range.rows)
        });
        kinds.collect::<Vec<_>>().join(", ")
    }

    /// What was not fitted, and why.
    pub fn left_out_because(&self, head: Head) -> String {
        match head {
            Head::Sigmoid => format!("{} rows", self.left_out),
            Head::Linear => {
                format!("{} rows that ran out of time; base crashes are not stored at all", self.left_out)
            }
        }
    }
}

fn samples(set: &Dataset) -> Vec<Sample> {
    let rows = set.rows.iter().zip(&set.fields).zip(&set.labels).zip(&set.trainable);
    rows.filter(|(_, trainable)| **trainable)
        .map(|(((row, field), label), _)| Sample { row: *row, field: *field, label: *label })
        .collect()
}

fn terrain(set: &Dataset) -> BTreeMap<&'static str, Range> {
    let mut kinds = BTreeMap::new();
    for ((kind, size_m), _) in set.terrain.iter().zip(&set.size_m).zip(&set.trainable).filter(|(_, t)| **t) {
        let range = kinds.entry(kind.id()).or_insert(Range { rows: 0, low_m: *size_m, high_m: *size_m });
        range.rows += 1;
        range.low_m = range.low_m.min(*size_m);
        range.high_m = range.high_m.max(*size_m);
    }
    kinds
}

fn collected_by(set: &Dataset) -> anyhow::Result<String> {
    let meta = &set.meta;
    let rollouts: u64 = set.rollouts.iter().map(|n| u64::from(*n)).sum();
    let source = meta.skill.plugin_source_sha256.as_ref();
    let source = source.map_or("not at hand".to_owned(), |sha256| format!("sha256 `{sha256}`"));
    let policy = meta.skill.policy_sha256.as_ref();
    let policy = policy.map_or(String::new(), |sha256| format!(", policy sha256 `{sha256}`"));
    Ok(format!(
        "`vocaloco collect`, {} rows drawn, {} stored, {rollouts} rollouts; robot {}, plugin {} {}, its \
         source {}, parameters sha256 `{}`{policy}, {} {}, config `{}`",
        meta.rows,
        set.len(),
        meta.robot.name,
        meta.skill.plugin,
        meta.skill.plugin_version,
        source,
        meta.skill.parameters_sha256,
        meta.simulator.name,
        meta.simulator.version,
        serde_json::to_string(&meta.config)?,
    ))
}
