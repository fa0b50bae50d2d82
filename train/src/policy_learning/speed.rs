//! `bench-policy`: policy steps a second in training, and where their time goes.

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, ensure};
use clap::ValueEnum;
use serde::Serialize;
use vocaloco_core::{installation::Installation, robot::RobotModel};
use vocaloco_sim::environment::speed::{self, Actor};
use vocaloco_sim::environment::{Environment, EnvironmentConfig, TrainingGround};
use vocaloco_sim::plant::PlantKind;
use vocaloco_sim::rollout::RolledSkill;
use vocaloco_sim::threads::with_threads;

use super::config::TrainingConfig;
use super::learner::Learner;
use super::run::{load_experts, read_config};
use super::task::Task;
use super::trainer::{Trainer, make_tasks, now, widths};

/// Policy steps a second in training: physics alone, the environment, the whole loop of PPO.
///
/// A policy step is 20 ms: four physics steps. `physics` steps the environments' plants under held
/// targets; `environment` adds sensors, terrain, rewards, falls and new episodes, with actions of zero
/// or the experts'; `learning` is the loop that `train-policy` spends its time in: an untrained network
/// drives every environment for the configured steps, then is updated. `learning_with_expert` is the
/// same while the expert answers in shadow; null where training.toml asks for no pull towards one.
/// `learn_share` is the share of `learning`'s time that goes into the update.
///
/// Networks, steps, epochs, terrain and plant are those of skills/NAME/training.toml.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The skill whose training.toml is measured.
    #[arg(long, default_value = "walk_network")]
    skill: String,
    /// Environments instead of the configured number.
    #[arg(long, value_name = "N")]
    environments: Option<usize>,
    /// Threads; 0 for as many as there are processors.
    #[arg(long, default_value_t = 0, value_name = "N")]
    threads: usize,
    /// Iterations of PPO to time, after one that is not.
    #[arg(long, default_value_t = 4, value_name = "N")]
    iterations: u64,
    /// Who acts while the environment alone is timed.
    #[arg(long, value_enum, default_value_t = ActorArg::Zero)]
    actor: ActorArg,
    /// Robot, as named under manifests/robots.
    #[arg(long, default_value = "anymal_d")]
    robot: String,
    /// Seed of all that is drawn.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ActorArg {
    /// Actions of zero: the contract's default position.
    Zero,
    /// The configured experts; their own time counts.
    Expert,
}

type Config = TrainingConfig<EnvironmentConfig>;

/// What is measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Measured {
    plant: PlantKind,
    environments: usize,
    threads: usize,
    actor: Actor,
    policy_steps_per_s: PolicySteps,
    learn_share: f64,
}

/// Policy steps a second.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct PolicySteps {
    physics: f64,
    environment: f64,
    learning: f64,
    learning_with_expert: Option<f64>,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    command: String,
    seed: u64,
    version: &'static str,
    skill: String,
    #[serde(flatten)]
    measured: Measured,
}

/// Runs the verb.
///
/// # Errors
/// What is missing or wrong in the skill, its configuration or its experts.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    ensure!(args.iterations > 0, "--iterations: found 0, wanted 1 or more");
    let installation = Installation::find()?;
    let robot = Arc::new(RobotModel::load(&installation.robots_folder(), &args.robot)?);
    let (file, mut config) = read_config(&installation, &args.skill)?;
    config.environments = args.environments.unwrap_or(config.environments);
    config.check().with_context(|| format!("{} with --environments", file.display()))?;
    let experts = load_experts(&installation, &robot, &config)?;
    let measured = with_threads(args.threads, || args.measure(&config, &robot, &experts))??;
    let report = Report {
        command: args.command(&measured),
        seed: args.seed,
        version: env!("CARGO_PKG_VERSION"),
        skill: args.skill.clone(),
        measured,
    };
    print_report(args.json, &report)?;
    Ok(ExitCode::SUCCESS)
}

impl Args {
    fn measure(
        &self,
        config: &Config,
        robot: &Arc<RobotModel>,
        experts: &BTreeMap<String, RolledSkill>,
    ) -> anyhow::Result<Measured> {
        let actor = match self.actor {
            ActorArg::Zero => Actor::Zero,
            ActorArg::Expert => Actor::Expert,
        };
        eprintln!("{}: tiles and poses", self.skill);
        let ground = TrainingGround::new(config.environment.clone(), robot, experts, self.seed)
            .with_context(|| format!("skills/{}/training.toml", self.skill))?;
        let ground = Arc::new(ground);
        eprintln!("{}: {} environments, alone", self.skill, config.environments);
        let alone = speed::measure(&ground, config.environments as u32, self.iterations as usize, actor);
        eprintln!("{}: with PPO, {} iterations", self.skill, self.iterations + 1);
        let learning = self.learn(config, &ground, 0.0)?;
        let with_expert = if config.ppo.imitation > 0.0 {
            eprintln!("{}: with PPO and the expert in shadow", self.skill);
            Some(self.learn(config, &ground, config.ppo.imitation)?)
        } else {
            None
        };
        Ok(Measured {
            plant: config.environment.plant,
            environments: config.environments,
            threads: alone.threads,
            actor,
            policy_steps_per_s: PolicySteps {
                physics: alone.physics_steps_per_s,
                environment: alone.steps_per_s,
                learning: learning.steps_per_s,
                learning_with_expert: with_expert.map(|timed| timed.steps_per_s),
            },
            learn_share: learning.learn_share,
        })
    }

    /// Iterations of a fresh learner under a pull towards the expert.
    fn learn(&self, config: &Config, ground: &Arc<TrainingGround>, pull: f32) -> anyhow::Result<Timed> {
        let mut plan = config.plan();
        plan.segment_iterations = self.iterations + 1;
        plan.ppo.imitation = pull;
        // Iterations that fit the critic alone are cheaper than those that follow.
        plan.ppo.critic_iterations = 0;
        let tasks = make_tasks(&plan, |number| Ok(Environment::new(ground, number)))?;
        let levels = tasks.iter().map(Task::level).collect();
        let learner = Learner { levels, ..Learner::new(&plan, widths(&tasks[0]), self.seed) };
        let mut trainer = Trainer::new(plan, self.seed, tasks, learner);
        let mut ends: Vec<(Instant, u64)> = Vec::new();
        trainer.segment(|record| {
            ends.push((now(), record.steps));
            Ok(())
        })?;
        let [(began, before), .., (ended, after)] = ends[..] else {
            unreachable!("a segment is two iterations or more");
        };
        let spent = trainer.spent();
        Ok(Timed {
            steps_per_s: (after - before) as f64 / (ended - began).as_secs_f64(),
            learn_share: spent.learn_s / (spent.drive_s + spent.learn_s),
        })
    }

    fn command(&self, measured: &Measured) -> String {
        let actor = match self.actor {
            ActorArg::Zero => "zero",
            ActorArg::Expert => "expert",
        };
        format!(
            "vocaloco bench policy --skill {} --environments {} --threads {} --iterations {} --actor {actor} \
             --robot {} --seed {}",
            self.skill, measured.environments, measured.threads, self.iterations, self.robot, self.seed
        )
    }
}

struct Timed {
    steps_per_s: f64,
    learn_share: f64,
}

#[expect(clippy::print_stdout, reason = "the verb's result")]
fn print_report(json: bool, report: &Report) -> anyhow::Result<()> {
    if json {
        println!("{}", serde_json::to_string_pretty(report)?);
        return Ok(());
    }
    let Report { skill, measured, command, .. } = report;
    let steps = &measured.policy_steps_per_s;
    println!(
        "{skill}, {} environments on the {} plant, {} threads: policy steps/s",
        measured.environments,
        measured.plant.id(),
        measured.threads
    );
    println!("  physics alone         {:>8.0}", steps.physics);
    println!("  environment           {:>8.0}", steps.environment);
    println!(
        "  PPO                   {:>8.0}  ({:.0} % of the time in the update)",
        steps.learning,
        100.0 * measured.learn_share
    );
    if let Some(with_expert) = steps.learning_with_expert {
        println!("  PPO and the expert    {with_expert:>8.0}");
    }
    println!("{command}");
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        args: Args,
    }

    #[test]
    fn every_figure_of_a_small_run_is_a_positive_number() {
        let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        let robot = Arc::new(RobotModel::load(&robots, "anymal_d").unwrap());
        let config = Config::parse(
            r#"
            schema = 1
            environments = 3
            [network]
            actor = [16]
            critic = [16]
            [environment]
            levels = 1
            variants = 1
            poses = 1
            initial_level = 0
            experts = {}
            terrain = [{ kind = "flat", share = 1.0, size_m = [0.0, 0.0] }]
            "#,
        )
        .unwrap();
        let args = Cli::parse_from(["", "--iterations", "2"]).args;
        let measured = with_threads(2, || args.measure(&config, &robot, &BTreeMap::new())).unwrap().unwrap();
        let steps = &measured.policy_steps_per_s;
        for (name, figure) in [
            ("physics", steps.physics),
            ("environment", steps.environment),
            ("learning", steps.learning),
            ("learn_share", measured.learn_share),
        ] {
            assert!(figure.is_finite() && figure > 0.0, "{name}: {figure}");
        }
        assert_eq!(steps.learning_with_expert, None, "no pull is configured");
        assert_eq!((measured.environments, measured.threads), (3, 2));
        assert_eq!(
            args.command(&measured),
            "vocaloco bench policy --skill walk_network --environments 3 --threads 2 --iterations 2 \
             --actor zero --robot anymal_d --seed 1"
        );
    }
}
