//! `train-policy`: a skill's policy, by whichever method its folder configures.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::bail;
use clap::ValueEnum;
use vocaloco_core::installation::Installation;
use vocaloco_sim::threads::with_threads;

use crate::policy_learning::run::{self as learning, Parts};
use crate::policy_search;

/// Train a skill's policy in the simulator.
///
/// With skills/NAME/training.toml: a network, by imitation of structured controllers and PPO, written
/// to skills/NAME/policy.onnx. With skills/NAME/search.toml: a structured controller's parameters, by
/// CMA-ES, judged on fresh episodes and written to the file that the skill's manifest names.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The skill to train.
    #[arg(long)]
    skill: String,
    /// Robot, as named under manifests/robots.
    #[arg(long, default_value = "anymal_d")]
    robot: String,
    /// Seed of all that is drawn.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// How; by default imitation and PPO where there is a training.toml, else CMA-ES.
    #[arg(long, value_enum)]
    method: Option<Method>,
    /// Continue a stopped run with the same seed and configuration.
    #[arg(long)]
    resume: bool,
    /// Threads; all cores by default. Their number changes no bit.
    #[arg(long)]
    threads: Option<usize>,
    /// Print one JSON object on stdout, and progress as JSON lines on stderr.
    #[arg(long)]
    json: bool,
    /// Iterations of PPO instead of the configured number.
    #[arg(long, help_heading = "Networks")]
    iterations: Option<u64>,
    /// Stop at the first checkpoint after this time; --resume goes on.
    #[arg(long, help_heading = "Networks")]
    minutes: Option<f64>,
    /// Start PPO from the networks of a checkpoint instead of an imitation.
    #[arg(long, value_name = "FILE", help_heading = "Networks")]
    from_checkpoint: Option<PathBuf>,
    /// Folder of checkpoint and curves instead of `out/train-policy/NAME-seedN`.
    #[arg(long, value_name = "FOLDER", help_heading = "Networks")]
    out: Option<PathBuf>,
    /// Stop after this many generations instead of the configured number.
    #[arg(long, help_heading = "CMA-ES")]
    generations: Option<usize>,
    /// First step of the search instead of the configured one: smaller to refine what was found.
    #[arg(long, value_name = "SHARE", help_heading = "CMA-ES")]
    initial_step: Option<f64>,
    /// Start from this skill's present parameters (its own, or another's of the same plugin) instead
    /// of search.toml's start.
    #[arg(long, value_name = "SKILL", help_heading = "CMA-ES")]
    start_from: Option<String>,
    /// Judge the present parameter file on the final episodes and write nothing.
    #[arg(long, help_heading = "CMA-ES")]
    judge: bool,
}

/// How a policy is trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Method {
    /// Search of a structured controller's parameters.
    Cma,
    /// Imitation of the configured experts alone.
    Dagger,
    /// Reinforcement learning alone.
    Ppo,
}

/// Runs the verb.
///
/// # Errors
/// What is missing or wrong in the skill, its configuration or its plugin.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let folder = Installation::find()?.skill_folder(&args.skill);
    let is_there = |name: &str| folder.join(name).is_file();
    let parts = match args.method {
        Some(Method::Cma) => None,
        Some(Method::Dagger) => Some(Parts::Imitation),
        Some(Method::Ppo) => Some(Parts::Reinforcement),
        None if is_there("training.toml") => Some(Parts::Both),
        None if is_there("search.toml") => None,
        None => bail!("{}: found neither training.toml nor search.toml, wanted one", folder.display()),
    };
    with_threads(args.threads.unwrap_or(0), || match parts {
        Some(parts) => learning::run(&args.learning(parts)),
        None => policy_search::run(&args.search()),
    })?
}

impl Args {
    fn learning(&self, parts: Parts) -> learning::Options {
        learning::Options {
            skill: self.skill.clone(),
            robot: self.robot.clone(),
            seed: self.seed,
            parts,
            resume: self.resume,
            from_checkpoint: self.from_checkpoint.clone(),
            iterations: self.iterations,
            minutes: self.minutes,
            out: self.out.clone(),
            json: self.json,
        }
    }

    fn search(&self) -> policy_search::Options {
        policy_search::Options {
            skill: self.skill.clone(),
            robot: self.robot.clone(),
            seed: self.seed,
            generations: self.generations,
            initial_step: self.initial_step,
            resume: self.resume,
            start_from: self.start_from.clone(),
            judge: self.judge,
            json: self.json,
        }
    }
}
