//! `skills key`: a key pair for signing bundles and locks.

use std::io::Write as _;
use std::path::PathBuf;

use anyhow::Context as _;
use serde::Serialize;
use vocaloco_core::lock::SecretKey;

use crate::exit::Exit;
use crate::output;
use crate::verbs::Shared;

/// Makes a secret key for `skills pack --key` and `lock --key`, and prints the public one, for
/// `skills install --trust` and a deployment's `trusted_keys`. The one verb that does not repeat.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    shared: Shared,
    /// New file for the secret key; readable by its owner alone
    #[arg(value_name = "FILE")]
    file: PathBuf,
}

#[derive(Serialize)]
struct Report {
    command: &'static str,
    seed: u64,
    version: &'static str,
    key: String,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    let key = SecretKey::generate().context("a new key")?;
    let mut options = std::fs::OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let write = |mut file: std::fs::File| file.write_all(key.to_text().as_bytes());
    options.open(&args.file).and_then(write).with_context(|| args.file.display().to_string())?;
    let key = key.public().to_string();
    if args.shared.json {
        let (command, seed) = ("skills key", args.shared.seed);
        output::json(&Report { command, seed, version: env!("CARGO_PKG_VERSION"), key })?;
    } else {
        output::line(&key)?;
    }
    Ok(Exit::Fine)
}
