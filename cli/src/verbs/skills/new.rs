//! `skills new NAME`: the start of a skill, from an exported network or as a plugin. Nothing that exists is
//! overwritten.

mod manifest_text;
mod plugin_crate;
mod policy;

use std::path::PathBuf;

use anyhow::ensure;
use serde::Serialize;
use vocaloco_core::installation::Installation;
use vocaloco_core::manifest::is_snake_case;

use crate::exit::Exit;
use crate::output;
use crate::verbs::Shared;

/// Start a skill: from an exported policy network, or as a plugin in Rust.
///
/// With `--from policy.onnx` there is no code to write. What the network was trained with (joints,
/// observation, action, gains) becomes the manifest's `[contract]`: read from the file's metadata as Isaac
/// Lab, mjlab and this project's trainer write it, completed by `--contract`. It is held against the
/// network's inputs and outputs and against the robot, and driven for a moment. A network that is refused
/// leaves nothing behind; the exit code is then 1, and what is missing is shown as it could be written.
///
/// Without `--from` it writes a plugin crate with its own test from the template, a manifest and a
/// parameter file, and makes the crate a member of the workspace.
///
/// docs/add-a-skill.md leads from here to a running robot.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    shared: Shared,
    /// Name of the skill, and of its plugin where it brings one: lower case, digits and underscores
    #[arg(value_name = "NAME")]
    name: String,
    /// The policy network to run, an ONNX file of one observation in, the actions out
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// TOML with a `[contract]`, such as another skill's manifest: its fields stand in place of the metadata's
    #[arg(long, value_name = "FILE", requires = "from")]
    contract: Option<PathBuf>,
    /// Robot that the policy is for
    #[arg(long, default_value = "anymal_d", value_name = "NAME", requires = "from")]
    robot: String,
    /// One line for people
    #[arg(long, default_value = "Runs a policy network", value_name = "TEXT", requires = "from")]
    summary: String,
    /// Forward velocities that the policy was trained for, m/s
    #[arg(
        long,
        default_value = "0,0.7",
        value_delimiter = ',',
        allow_hyphen_values = true,
        value_name = "LEAST,GREATEST",
        requires = "from"
    )]
    forward_m_per_s: Vec<f64>,
    /// How far ahead targets are set for a policy that observes `position_target`, m
    #[arg(long, default_value_t = 1.5, value_name = "M", requires = "from")]
    target_distance_m: f64,
    /// Folder of plugin crates, relative to the installation
    #[arg(long, default_value = "plugins", value_name = "DIR", conflicts_with = "from")]
    dir: PathBuf,
}

/// What was written, and what comes next.
#[derive(Serialize)]
struct Report<'a> {
    command: &'static str,
    seed: u64,
    version: &'static str,
    name: &'a str,
    written: Vec<String>,
    next: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none", flatten)]
    policy: Option<policy::Facts>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    let name = args.name.as_str();
    ensure!(is_snake_case(name), "NAME: found {name:?}, wanted snake_case, such as `side_step`");
    let installation = Installation::find()?;
    match &args.from {
        Some(file) => policy::make(args, &installation, file),
        None => plugin_crate::make(args, &installation.root),
    }
}

impl Args {
    fn report(
        &self,
        written: Vec<String>,
        next: Vec<String>,
        policy: Option<policy::Facts>,
    ) -> anyhow::Result<Exit> {
        let report = Report {
            command: "skills new",
            seed: self.shared.seed,
            version: env!("CARGO_PKG_VERSION"),
            name: &self.name,
            written,
            next,
            policy,
        };
        if self.shared.json {
            output::json(&report)?;
            return Ok(Exit::Fine);
        }
        output::line(&format!("wrote\n  {}", report.written.join("\n  ")))?;
        if let Some(facts) = &report.policy {
            output::line(&format!("contract\n  {}", facts.lines().join("\n  ")))?;
        }
        output::line(&format!("next\n  {}", report.next.join("\n  ")))?;
        Ok(Exit::Fine)
    }
}
