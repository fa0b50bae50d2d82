//! `vocaloco-train`: the learning verbs, apart from `vocaloco` so that nobody who only runs skills
//! compiles them. `vocaloco train …`, `train-policy …`, `bench train …` and `bench policy …` run this binary.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use vocaloco_train::policy_learning::speed;
use vocaloco_train::predictor::{bench, novelty, training};
use vocaloco_train::train_policy;

#[derive(Parser)]
#[command(name = "vocaloco-train", version, about = "Learning for VOCALoco")]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Fit a skill's two predictors to its data set
    Train(training::Args),
    /// Train a skill's policy in the simulator: imitation and PPO, or CMA-ES
    TrainPolicy(train_policy::Args),
    /// Count what the check of terrain never seen flags
    Novelty(novelty::Args),
    /// Measure samples a second in fitting a predictor
    BenchTrain(bench::Args),
    /// Measure policy steps a second in training
    BenchPolicy(speed::Args),
}

fn main() -> ExitCode {
    let ended = match Cli::parse().verb {
        Verb::Train(args) => training::run(&args),
        Verb::TrainPolicy(args) => train_policy::run(&args),
        Verb::Novelty(args) => novelty::run(&args),
        Verb::BenchTrain(args) => bench::run(&args),
        Verb::BenchPolicy(args) => speed::run(&args),
    };
    ended.unwrap_or_else(|error| {
        // `{:#}` is the whole chain in one line: what failed, then why.
        eprintln!("error: {error:#}");
        ExitCode::from(2)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
