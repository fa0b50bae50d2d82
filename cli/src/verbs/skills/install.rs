//! `skills install` and `skills remove`: bundles into an installation and out of it.

use std::path::PathBuf;

use anyhow::Context as _;
use serde::Serialize;
use vocaloco_core::bundle;
use vocaloco_core::installation::Installation;
use vocaloco_core::lock::PublicKey;
use vocaloco_core::registry::read_deployment;

use crate::exit::Exit;
use crate::output;
use crate::verbs::Shared;

/// Installs a packed skill, whole or not at all; exit code 1 when it is refused.
#[derive(clap::Args)]
pub(crate) struct InstallArgs {
    #[command(flatten)]
    shared: Shared,
    /// The bundle that `skills pack` wrote
    #[arg(value_name = "FILE")]
    bundle: PathBuf,
    /// Take it only when this public key has signed it; may be given more than once
    #[arg(long, value_name = "KEY")]
    trust: Vec<PublicKey>,
}

/// Removes a skill that a bundle has brought; exit code 1 when it is refused.
#[derive(clap::Args)]
pub(crate) struct RemoveArgs {
    #[command(flatten)]
    shared: Shared,
    /// The skill
    #[arg(value_name = "SKILL")]
    skill: String,
}

#[derive(Serialize)]
struct Report {
    command: &'static str,
    seed: u64,
    version: &'static str,
    skill: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    files: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    signed: Option<bool>,
}

pub(crate) fn install(args: &InstallArgs) -> anyhow::Result<Exit> {
    let installation = Installation::find().context("no installation")?;
    let installed = match bundle::install(&installation, &args.bundle, &args.trust) {
        Ok(installed) => installed,
        Err(finding) => {
            eprintln!("not installed: {finding}");
            return Ok(Exit::Finding);
        }
    };
    let line =
        format!("{}: {} files installed; a deployment may name it now", installed.skill, installed.files);
    say(
        args.shared,
        &Report {
            command: "skills install",
            seed: args.shared.seed,
            version: env!("CARGO_PKG_VERSION"),
            skill: installed.skill,
            files: Some(installed.files),
            signed: Some(installed.signed),
        },
        &line,
    )
}

pub(crate) fn remove(args: &RemoveArgs) -> anyhow::Result<Exit> {
    let installation = Installation::find().context("no installation")?;
    if let Err(finding) = bundle::remove(&installation, &args.skill) {
        eprintln!("not removed: {finding}");
        return Ok(Exit::Finding);
    }
    for name in installation.deployment_names()? {
        if read_deployment(&installation, &name)
            .is_ok_and(|deployment| deployment.skills.contains(&args.skill))
        {
            eprintln!("deployment {name} still names {}", args.skill);
        }
    }
    let line = format!("{}: removed", args.skill);
    say(
        args.shared,
        &Report {
            command: "skills remove",
            seed: args.shared.seed,
            version: env!("CARGO_PKG_VERSION"),
            skill: args.skill.clone(),
            files: None,
            signed: None,
        },
        &line,
    )
}

fn say(shared: Shared, report: &Report, line: &str) -> anyhow::Result<Exit> {
    if shared.json {
        output::json(report)?;
    } else {
        output::line(line)?;
    }
    Ok(Exit::Fine)
}
