//! `evaluate`: placeholder until its owner fills it.

use super::Shared;
use crate::exit::Exit;

#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    shared: Shared,
}

pub(crate) fn run(args: Args) -> anyhow::Result<Exit> {
    anyhow::bail!("`evaluate` is not built yet (json {}, seed {})", args.shared.json, args.shared.seed)
}
