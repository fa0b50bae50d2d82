//! `bench`: how fast this machine does what costs time, and how long it lasts. One file a measurement, below.

mod approach;
mod hot_add;
#[cfg(feature = "sim")]
mod rollouts;
#[cfg(feature = "sim")]
mod soak;
mod tick;
mod tick_parts;
mod tick_peer;

use super::learning;
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
    /// Policy steps a second in training: physics alone, the environment, the whole loop of PPO
    Policy(learning::Args),
    #[cfg(feature = "sim")]
    Soak(soak::Args),
    /// Samples a second in which a predictor is fitted, beside PyTorch on the same data and start
    Train(learning::Args),
}

pub(crate) fn run(args: Args) -> anyhow::Result<Exit> {
    match args.what {
        What::Tick(args) => tick::run(&args),
        What::HotAdd(args) => hot_add::run(&args),
        #[cfg(feature = "sim")]
        What::Rollouts(args) => rollouts::run(&args),
        #[cfg(feature = "sim")]
        What::Soak(args) => soak::run(&args),
        What::Policy(_) => learning::hand_over("policy", "bench-policy"),
        What::Train(_) => learning::hand_over("train", "bench-train"),
    }
}
