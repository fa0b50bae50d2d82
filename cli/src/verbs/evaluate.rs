//! `evaluate`: measures skills by the protocol. One file an experiment, below.

mod viability;

use crate::exit::Exit;

#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    experiment: Experiment,
}

#[derive(clap::Subcommand)]
enum Experiment {
    /// One skill by the collection protocol, one rollout per fresh pose
    Viability(viability::Args),
}

pub(crate) fn run(args: Args) -> anyhow::Result<Exit> {
    match args.experiment {
        Experiment::Viability(args) => viability::run(&args),
    }
}
