//! `lock`: the hashes of everything a deployment loads, for `run --locked`.

use std::path::PathBuf;

use anyhow::Context as _;
use serde::Serialize;
use vocaloco_core::installation::Installation;
use vocaloco_core::lock::SecretKey;
use vocaloco_core::registry::{LoadError, lock_deployment};

use super::Shared;
use crate::exit::Exit;
use crate::output;

/// Writes a deployment's lock beside it: the SHA-256 of every manifest, plugin and model in use.
///
/// `run --locked` then takes no other bytes. A lock belongs to its installation: a library's bytes
/// differ from build to build. Exit code 1 when a skill is not sound; nothing is written then.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    shared: Shared,
    /// Deployment to lock
    #[arg(long, default_value = "anymal_stairs", value_name = "NAME")]
    deployment: String,
    /// Sign the lock with this secret key (`vocaloco skills key`)
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
}

#[derive(Serialize)]
struct Report {
    command: &'static str,
    seed: u64,
    version: &'static str,
    deployment: String,
    lock: PathBuf,
    files: usize,
    plugins: usize,
    /// Who signed it.
    key: Option<String>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    let installation = Installation::find().context("no installation")?;
    let key = args.key.as_deref().map(SecretKey::read).transpose().context("--key")?;
    let lock = match lock_deployment(&installation, &args.deployment) {
        Err(LoadError::Unsound(refusal)) => {
            eprintln!("not locked: {refusal}");
            return Ok(Exit::Finding);
        }
        lock => lock.with_context(|| format!("deployment `{}`", args.deployment))?,
    };
    let file = lock.file().strip_prefix(&installation.root).unwrap_or(lock.file());
    lock.write(key.as_ref()).with_context(|| lock.file().display().to_string())?;
    let report = Report {
        command: "lock",
        seed: args.shared.seed,
        version: env!("CARGO_PKG_VERSION"),
        deployment: args.deployment.clone(),
        lock: file.to_owned(),
        files: lock.files().len(),
        plugins: lock.plugins().len(),
        key: key.map(|key| key.public().to_string()),
    };
    if args.shared.json {
        output::json(&report)?;
    } else {
        let signed = report.key.map_or_else(|| "not signed".to_owned(), |key| format!("signed by {key}"));
        output::line(&format!(
            "{}: {} files and the plugins of {} skills, {signed}",
            report.lock.display(),
            report.files,
            report.plugins
        ))?;
    }
    Ok(Exit::Fine)
}
