//! `plugin-host`: the other end of `isolation = "process"`; started by this program, never by people.

use super::Shared;
use crate::exit::Exit;

/// Runs one plugin for the process that started this one, over a socket that is its stdin and memory that is its stdout.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    _shared: Shared,
}

#[cfg(target_os = "linux")]
pub(crate) fn run(_: &Args) -> anyhow::Result<Exit> {
    vocaloco_core::plugin::serve()?;
    Ok(Exit::Fine)
}

#[cfg(not(target_os = "linux"))]
pub(crate) fn run(_: &Args) -> anyhow::Result<Exit> {
    anyhow::bail!("plugin-host: found another system, wanted Linux")
}
