//! The verbs, one file each: its `Args` and its `run`. To add one: a file here with its summary, a line in
//! [`Verb`], a line in [`Verb::run`].

#![allow(clippy::needless_pass_by_value, reason = "every verb has the one signature")]

mod bench;
#[cfg(feature = "sim")]
mod collect;
#[cfg(feature = "sim")]
mod data;
#[cfg(feature = "sim")]
mod demo;
#[cfg(feature = "sim")]
mod evaluate;
mod explain;
mod learning;
mod lock;
#[cfg(feature = "sim")]
mod look;
#[cfg(feature = "sim")]
mod noise;
mod plugin_host;
#[cfg(feature = "sim")]
mod rolled;
mod run;
mod skills;

use clap::Subcommand;

use crate::exit::Exit;
use crate::output;

/// What every verb takes: `#[command(flatten)] shared: Shared`.
#[derive(clap::Args, Clone, Copy, Debug)]
pub(crate) struct Shared {
    /// Print one JSON object on stdout and nothing else there
    #[arg(long)]
    pub(crate) json: bool,
    /// Seed of every random stream; the same seed gives the same result
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub(crate) seed: u64,
}

/// Where a verb's `Args` say more than a line, they say it all: a line here would hide them from `--help`.
#[derive(Subcommand)]
pub(crate) enum Verb {
    #[cfg(feature = "sim")]
    Demo(demo::Args),
    /// The registry: list, check, start new skills, pack, install and remove them
    Skills(skills::Args),
    /// Roll a skill out in the simulator and write a data set
    #[cfg(feature = "sim")]
    Collect(collect::Args),
    /// Merge and show data sets
    #[cfg(feature = "sim")]
    Data(data::Args),
    /// Fit a skill's two predictors to its data set
    Train(learning::Args),
    /// Train a skill's policy in the simulator: imitation and PPO, or CMA-ES
    TrainPolicy(learning::Args),
    /// Measure a skill or the selector by the protocol
    #[cfg(feature = "sim")]
    Evaluate(evaluate::Args),
    Bench(bench::Args),
    /// Roll a skill out once and draw its gait
    #[cfg(feature = "sim")]
    Look(look::Args),
    Run(run::Args),
    Lock(lock::Args),
    Explain(explain::Args),
    /// Run one plugin for another process of this program
    #[command(hide = true)]
    PluginHost(plugin_host::Args),
}

impl Verb {
    pub(crate) fn run(self) -> anyhow::Result<Exit> {
        // The stdout of that verb is no place for results.
        if !matches!(self, Self::PluginHost(_)) {
            output::keep_for_results()?;
        }
        match self {
            #[cfg(feature = "sim")]
            Self::Demo(args) => demo::run(args),
            Self::Skills(args) => skills::run(args),
            #[cfg(feature = "sim")]
            Self::Collect(args) => collect::run(args),
            #[cfg(feature = "sim")]
            Self::Data(args) => data::run(args),
            Self::Train(_) => learning::hand_over("train", "train"),
            Self::TrainPolicy(_) => learning::hand_over("train-policy", "train-policy"),
            #[cfg(feature = "sim")]
            Self::Evaluate(args) => evaluate::run(args),
            Self::Bench(args) => bench::run(args),
            #[cfg(feature = "sim")]
            Self::Look(args) => look::run(&args),
            Self::Run(args) => run::run(args),
            Self::Lock(args) => lock::run(&args),
            Self::Explain(args) => explain::run(args),
            Self::PluginHost(args) => plugin_host::run(&args),
        }
    }
}
