//! `skills pack`: a skill as one file.

use std::path::PathBuf;

use anyhow::Context as _;
use serde::Serialize;
use vocaloco_core::bundle::{self, EXTENSION};
use vocaloco_core::installation::Installation;
use vocaloco_core::lock::SecretKey;

use crate::exit::Exit;
use crate::output;
use crate::verbs::Shared;

/// Packs a skill into one file: manifest, plugin, models, card, and a lock with the hash of each.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    shared: Shared,
    /// The skill
    #[arg(value_name = "SKILL")]
    skill: String,
    /// Where to write it; by default SKILL.skill here
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Sign it with this secret key (`vocaloco skills key`)
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
}

#[derive(Serialize)]
struct Report {
    command: &'static str,
    seed: u64,
    version: &'static str,
    skill: String,
    bundle: PathBuf,
    bytes: usize,
    files: std::collections::BTreeMap<String, String>,
    /// Who signed it.
    key: Option<String>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    let installation = Installation::find().context("no installation")?;
    let key = args.key.as_deref().map(SecretKey::read).transpose().context("--key")?;
    let out = args.out.clone().unwrap_or_else(|| format!("{}.{EXTENSION}", args.skill).into());
    let packed = match bundle::pack(&installation, &args.skill, &out, key.as_ref()) {
        Ok(packed) => packed,
        Err(finding) => {
            eprintln!("not packed: {finding}");
            return Ok(Exit::Finding);
        }
    };
    let report = Report {
        command: "skills pack",
        seed: args.shared.seed,
        version: env!("CARGO_PKG_VERSION"),
        skill: args.skill.clone(),
        bundle: packed.file,
        bytes: packed.bytes,
        files: packed.files,
        key: key.map(|key| key.public().to_string()),
    };
    if args.shared.json {
        output::json(&report)?;
    } else {
        let signed = report.key.map_or_else(|| "not signed".to_owned(), |key| format!("signed by {key}"));
        let line = format!(
            "{}: {} bytes, {} files, {signed}",
            report.bundle.display(),
            report.bytes,
            report.files.len()
        );
        output::line(&line)?;
    }
    Ok(Exit::Fine)
}
