//! `plugin-host`: the other end of `isolation = "process"`; started by this program, never by people.

use std::path::PathBuf;

use super::Shared;
use crate::exit::Exit;

/// Runs one plugin for the process that started this one, over its stdin and shared memory.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    _shared: Shared,
    /// The memory
    #[arg(long, value_name = "FILE")]
    #[cfg_attr(not(target_os = "linux"), allow(dead_code, reason = "plugins are isolated on Linux"))]
    memory: PathBuf,
}

#[cfg(target_os = "linux")]
pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    vocaloco_core::plugin::serve(&args.memory)?;
    Ok(Exit::Fine)
}

#[cfg(not(target_os = "linux"))]
pub(crate) fn run(_: &Args) -> anyhow::Result<Exit> {
    anyhow::bail!("plugin-host: found another system, wanted Linux")
}
