//! `bench`: how fast this machine does what costs time, and how long it lasts. One file a measurement, below.

mod approach;
mod hot_add;
mod policy;
#[cfg(feature = "sim")]
mod rollouts;
#[cfg(feature = "sim")]
mod soak;
mod tick;
mod tick_parts;
mod tick_peer;
mod train;

use crate::exit::Exit;

/// Measure speed: of the loop that a robot runs, of collection, of training; and how the loop lasts.
///
/// Figures are of this machine and this moment: other work on it makes them worse, so repeat before
/// comparing. Where another program does the same job and is installed, `peer` is its figure from the
/// same run; otherwise it is null.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    Tick(tick::Args),
    HotAdd(hot_add::Args),
    #[cfg(feature = "sim")]
    Rollouts(rollouts::Args),
    Policy(policy::Args),
    #[cfg(feature = "sim")]
    Soak(soak::Args),
    Train(train::Args),
}

pub(crate) fn run(args: Args) -> anyhow::Result<Exit> {
    match args.what {
        What::Tick(args) => tick::run(&args),
        What::HotAdd(args) => hot_add::run(&args),
        #[cfg(feature = "sim")]
        What::Rollouts(args) => rollouts::run(&args),
        #[cfg(feature = "sim")]
        What::Soak(args) => soak::run(&args),
        What::Policy(_) => policy::run(),
        What::Train(_) => train::run(),
    }
}
