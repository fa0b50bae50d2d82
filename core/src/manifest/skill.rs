//! `manifests/skills/<name>.toml`: a plugin bound to its models.

use std::path::{Component, Path, PathBuf};

use serde::Deserialize;
use vocaloco_plugin_api::CommandKind;
use vocaloco_plugin_api::contract::Contract;

use super::reader::Source;
use super::{Finding, is_snake_case};

/// A checked skill manifest.
#[derive(Clone, Debug, PartialEq)]
pub struct SkillManifest {
    /// The file it was read from.
    pub file: PathBuf,
    /// Name of the skill, and stem of its file.
    pub name: String,
    /// One line for people.
    pub summary: String,
    /// Name of the plugin, resolved on the plugin path.
    pub plugin: String,
    /// Where the plugin's code runs.
    pub isolation: Isolation,
    /// Its models, relative to the skill's folder.
    pub models: Models,
    /// How the selector treats it.
    pub selection: Selection,
    /// The commands it takes.
    pub command: CommandRange,
    /// What its predictors predict.
    pub rollout: Rollout,
    /// What its policy was trained with; a structured controller has none.
    pub contract: Option<Contract>,
}

/// Where a plugin's code runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Isolation {
    /// In the host's process, the fastest.
    #[default]
    None,
    /// In a process of its own, whose crash is an error like any other.
    Process,
}

/// Files of a skill, relative to `skills/<name>/`; none leads out of that folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Models {
    /// A policy network, for plugins that run one.
    pub policy: Option<PathBuf>,
    /// The parameter text of a structured controller.
    pub parameters: Option<PathBuf>,
    /// The viability predictor.
    pub viability: PathBuf,
    /// The predictor of cost of transport.
    pub cot: PathBuf,
}

impl Models {
    /// Every file that is named.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        let named = [self.policy.as_ref(), self.parameters.as_ref(), Some(&self.viability), Some(&self.cot)];
        named.into_iter().flatten().map(PathBuf::as_path)
    }
}

/// How the selector treats a skill.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Selection {
    /// The least predicted viability at which the skill may be chosen, 0 to 1.
    pub viability_threshold: f32,
    /// Once it wins, another viable skill must be cheaper by more than this share to win instead.
    pub cost_margin: f32,
    /// Once active, it stays until its target, its time limit or a fault.
    pub committed: bool,
}

/// The commands a skill takes; outside them it is not viable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandRange {
    /// Velocity or position target.
    pub kind: CommandKind,
    /// Forward velocity, m/s, least and greatest.
    pub forward_m_per_s: [f64; 2],
    /// How far ahead a position target is set, m.
    pub target_distance_m: Option<f64>,
}

/// What a rollout of the collection protocol asks of a skill.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rollout {
    /// Distance to cover, m.
    pub horizon_m: f64,
    /// Time for it, s.
    pub time_limit_s: f64,
    /// Share of a data set's rows that start where a rollout of the skill's own had the robot, 0 to 1.
    pub own_starts_share: f64,
    /// Share of the rows that begin there in stride: the rollout has come there and goes on, 0 to 1.
    pub in_stride_share: f64,
}

impl Default for Rollout {
    fn default() -> Self {
        Self { horizon_m: 1.5, time_limit_s: 4.0, own_starts_share: 0.0, in_stride_share: 0.0 }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    #[serde(rename = "schema")]
    _schema: u32,
    name: String,
    summary: String,
    plugin: String,
    #[serde(default)]
    isolation: Isolation,
    models: RawModels,
    selection: RawSelection,
    command: RawCommand,
    #[serde(default)]
    rollout: RawRollout,
    contract: Option<Contract>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawModels {
    policy: Option<PathBuf>,
    parameters: Option<PathBuf>,
    viability: PathBuf,
    cot: PathBuf,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawSelection {
    viability_threshold: f64,
    #[serde(default)]
    cost_margin: f64,
    #[serde(default)]
    committed: bool,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum RawKind {
    Velocity,
    PositionTarget,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawCommand {
    kind: RawKind,
    forward_m_per_s: Option<[f64; 2]>,
    target_distance_m: Option<f64>,
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct RawRollout {
    horizon_m: Option<f64>,
    time_limit_s: Option<f64>,
    own_starts_share: Option<f64>,
    in_stride_share: Option<f64>,
}

impl SkillManifest {
    /// Reads and checks one manifest.
    ///
    /// # Errors
    /// The first thing that is not as the schema wants it.
    pub fn read(path: &Path) -> Result<Self, Finding> {
        Self::check(path, &Source::read(path)?)
    }

    /// Checks the text of the manifest `path`, which is only named in findings.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn parse(path: &Path, text: String) -> Result<Self, Finding> {
        Self::check(path, &Source::new(path, text))
    }

    fn check(path: &Path, source: &Source<'_>) -> Result<Self, Finding> {
        let raw: Raw = source.parse()?;
        let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or("");
        if raw.name != stem || !is_snake_case(&raw.name) {
            let wanted = format!("{stem:?}, as the file is called, in snake_case");
            return Err(source.finding("name", format!("{:?}", raw.name), wanted));
        }
        if !is_snake_case(&raw.plugin) {
            let found = format!("{:?}", raw.plugin);
            return Err(source.finding("plugin", found, "a plugin's name in snake_case"));
        }
        let command = command(source, &raw.command)?;
        if raw.selection.committed && command.kind != CommandKind::PositionTarget {
            let wanted = "false, or command.kind = \"position_target\": without a target nothing ends it";
            return Err(source.finding("selection.committed", true, wanted));
        }
        Ok(Self {
            file: path.to_owned(),
            models: models(source, raw.models)?,
            selection: Selection {
                viability_threshold: source.inside(
                    "selection.viability_threshold",
                    raw.selection.viability_threshold,
                    0.0..=1.0,
                )? as f32,
                cost_margin: source.inside("selection.cost_margin", raw.selection.cost_margin, 0.0..=0.5)?
                    as f32,
                committed: raw.selection.committed,
            },
            command,
            rollout: rollout(source, &raw.rollout)?,
            contract: raw.contract,
            name: raw.name,
            summary: raw.summary,
            plugin: raw.plugin,
            isolation: raw.isolation,
        })
    }
}

fn models(source: &Source<'_>, raw: RawModels) -> Result<Models, Finding> {
    let inside = |field: &str, path: &PathBuf| {
        let plain = path.components().all(|part| matches!(part, Component::Normal(_)));
        if plain && path.components().next().is_some() {
            return Ok(());
        }
        Err(source.finding(field, format!("\"{}\"", path.display()), "a path inside the skill's own folder"))
    };
    for (field, path) in [("models.policy", &raw.policy), ("models.parameters", &raw.parameters)] {
        if let Some(path) = path {
            inside(field, path)?;
        }
    }
    inside("models.viability", &raw.viability)?;
    inside("models.cot", &raw.cot)?;
    Ok(Models { policy: raw.policy, parameters: raw.parameters, viability: raw.viability, cot: raw.cot })
}

fn command(source: &Source<'_>, raw: &RawCommand) -> Result<CommandRange, Finding> {
    let kind = match raw.kind {
        RawKind::Velocity => CommandKind::Velocity,
        RawKind::PositionTarget => CommandKind::PositionTarget,
    };
    let forward_m_per_s = match (kind, raw.forward_m_per_s) {
        (_, Some([least, greatest])) => {
            let field = "command.forward_m_per_s";
            source.inside(field, least, -5.0..=5.0)?;
            source.inside(field, greatest, -5.0..=5.0)?;
            if least > greatest {
                let found = format!("[{least}, {greatest}]");
                return Err(source.finding(field, found, "the smaller one first"));
            }
            [least, greatest]
        }
        (CommandKind::Velocity, None) => {
            return Err(source.finding("command.forward_m_per_s", "nothing", "[least, greatest] in m/s"));
        }
        (CommandKind::PositionTarget, None) => [0.0, 0.0],
    };
    let field = "command.target_distance_m";
    match (kind, raw.target_distance_m) {
        (CommandKind::PositionTarget, Some(distance)) => {
            source.inside(field, distance, 0.1..=10.0)?;
        }
        (CommandKind::PositionTarget, None) => {
            return Err(source.finding(field, "nothing", "metres to the target, 0.1 to 10"));
        }
        (CommandKind::Velocity, Some(distance)) => {
            return Err(source.finding(field, distance, "nothing when kind = \"velocity\""));
        }
        (CommandKind::Velocity, None) => {}
    }
    Ok(CommandRange { kind, forward_m_per_s, target_distance_m: raw.target_distance_m })
}

/// The share, if it and those that start midway are no more than all.
fn in_stride(source: &Source<'_>, share: f64, own_starts_share: f64) -> Result<f64, Finding> {
    let field = "rollout.in_stride_share";
    let share = source.inside(field, share, 0.0..=1.0)?;
    // Decimal shares that make one do not quite in binary.
    if share + own_starts_share <= 1.0 + 1e-9 {
        return Ok(share);
    }
    let wanted = format!("no more than own_starts_share = {own_starts_share} leaves of 1");
    Err(source.finding(field, share, wanted))
}

fn rollout(source: &Source<'_>, raw: &RawRollout) -> Result<Rollout, Finding> {
    let default = Rollout::default();
    let horizon_m = raw.horizon_m.unwrap_or(default.horizon_m);
    let time_limit_s = raw.time_limit_s.unwrap_or(default.time_limit_s);
    let own_starts_share = raw.own_starts_share.unwrap_or(default.own_starts_share);
    let in_stride_share = raw.in_stride_share.unwrap_or(default.in_stride_share);
    Ok(Rollout {
        horizon_m: source.inside("rollout.horizon_m", horizon_m, 0.2..=10.0)?,
        time_limit_s: source.inside("rollout.time_limit_s", time_limit_s, 0.5..=60.0)?,
        own_starts_share: source.inside("rollout.own_starts_share", own_starts_share, 0.0..=1.0)?,
        in_stride_share: in_stride(source, in_stride_share, own_starts_share)?,
    })
}
