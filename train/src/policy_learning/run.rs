//! `train-policy` of a network: a skill's `training.toml` → `policy.onnx`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context, anyhow, ensure};
use serde_json::json;
use vocaloco_core::{
    installation::Installation, manifest::SkillManifest, registry, robot::RobotModel, target::TargetRule,
};
use vocaloco_sim::environment::{Environment, EnvironmentConfig, TargetRules, TrainingGround};
use vocaloco_sim::identity::sha256_hex;
use vocaloco_sim::rollout::RolledSkill;

use super::checkpoint::Run;
use super::config::TrainingConfig;
use super::curves::Curves;
use super::folder::{RunFolder, read_checkpoint};
use super::learner::Learner;
use super::narration::{Narration, Pace};
use super::policy_file::{metadata, onnx};
use super::task::Task;
use super::trainer::{Trainer, make_tasks, now, widths};
use crate::card;
use crate::files::write_whole;
use crate::policy_search::load_skill;

/// Which parts of the training are done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parts {
    /// Imitation where the configuration has one, then reinforcement.
    Both,
    /// Imitation alone.
    Imitation,
    /// Reinforcement alone.
    Reinforcement,
}

/// What the command line says.
#[derive(Clone, Debug)]
pub struct Options {
    /// The skill.
    pub skill: String,
    /// The robot.
    pub robot: String,
    /// The run's seed.
    pub seed: u64,
    /// Parts of the training.
    pub parts: Parts,
    /// Goes on from the run's checkpoint.
    pub resume: bool,
    /// Starts from the networks of this checkpoint.
    pub from_checkpoint: Option<PathBuf>,
    /// Iterations instead of the configured number.
    pub iterations: Option<u64>,
    /// Stops at the first checkpoint after this time.
    pub minutes: Option<f64>,
    /// The run's folder instead of the usual one.
    pub out: Option<PathBuf>,
    /// JSON instead of text.
    pub json: bool,
}

type Config = TrainingConfig<EnvironmentConfig>;

/// Trains and writes the policy, on the threads of the pool it is called in.
///
/// # Errors
/// What is missing or wrong in the skill, its configuration, its experts or a checkpoint.
pub fn run(options: &Options) -> anyhow::Result<ExitCode> {
    let installation = Installation::find()?;
    let robot = Arc::new(RobotModel::load(&installation.robots_folder(), &options.robot)?);
    let (file, mut config) = read_config(&installation, &options.skill)?;
    options.apply_to(&mut config).with_context(|| file.display().to_string())?;
    let experts = load_experts(&installation, &robot, &config)?;
    let policy = installation.skill_folder(&options.skill).join("policy.onnx");
    Training::start(options, config, &robot, &experts)?.run(&policy)
}

/// A skill's `training.toml`, and what it says; a contract that it leaves out is that of the skill's manifest,
/// and so are then the targets.
///
/// # Errors
/// Either file is wrong.
pub(super) fn read_config(installation: &Installation, skill: &str) -> anyhow::Result<(PathBuf, Config)> {
    let file = installation.skill_folder(skill).join("training.toml");
    let mut config = Config::read(&file)?;
    let manifest = installation.skill_file(skill);
    if config.environment.contract.is_none() && manifest.is_file() {
        let manifest = SkillManifest::read(&manifest).map_err(|finding| anyhow!("{finding}"))?;
        let targets = TargetRule::of(&manifest).map(TargetRules::always);
        config.environment.target = config.environment.target.or(targets);
        config.environment.contract = manifest.contract;
    }
    Ok((file, config))
}

/// The skills that a configuration names, as experts or to lead, by name.
///
/// # Errors
/// The first that cannot be rolled out.
pub(super) fn load_experts(
    installation: &Installation,
    robot: &RobotModel,
    config: &Config,
) -> anyhow::Result<BTreeMap<String, RolledSkill>> {
    let names: BTreeSet<&str> = config.environment.skills().map(|(_, name)| name).collect();
    let changed = &config.environment.expert_parameters;
    let load = |name: &str| Ok((name.to_owned(), load_expert(installation, robot, name, changed)?));
    names.into_iter().map(load).collect::<anyhow::Result<_>>()
}

/// A skill as an expert: a structured controller with other values for the parameters in `changed`, a
/// network as it is.
///
/// # Errors
/// It cannot be rolled out, or has no parameter of a changed name.
pub fn load_expert(
    installation: &Installation,
    robot: &RobotModel,
    name: &str,
    changed: &BTreeMap<String, f64>,
) -> anyhow::Result<RolledSkill> {
    let manifest =
        SkillManifest::read(&installation.skill_file(name)).map_err(|finding| anyhow!("{finding}"))?;
    if manifest.models.parameters.is_some() {
        return load_skill(installation, robot, name, changed);
    }
    let loaded =
        registry::load_skill(installation, name, &robot.description, registry::ModelPolicy::Optional)?;
    Ok(RolledSkill::from_loaded(&loaded, robot)?)
}

impl Options {
    fn apply_to(&self, config: &mut Config) -> anyhow::Result<()> {
        if let Some(iterations) = self.iterations {
            config.ppo.iterations = iterations;
        }
        match self.parts {
            Parts::Both => {}
            Parts::Imitation => {
                ensure!(config.imitation.is_some(), "imitation: found none, wanted the table [imitation]");
                config.ppo.iterations = 0;
            }
            Parts::Reinforcement => config.imitation = None,
        }
        ensure!(
            self.from_checkpoint.is_none() || self.parts == Parts::Reinforcement,
            "--from-checkpoint: found another method, wanted --method ppo: the checkpoint stands for the imitation"
        );
        config.check()
    }
}

/// The configuration as a checkpoint keeps it: a longer run goes on from a shorter one.
fn identity(config: &Config) -> anyhow::Result<String> {
    let mut config = config.clone();
    config.ppo.iterations = 0;
    Ok(serde_json::to_string_pretty(&config)?)
}

struct Training<'a> {
    options: &'a Options,
    config: Config,
    ground: Arc<TrainingGround>,
    trainer: Trainer<Environment>,
    run: Run,
    folder: RunFolder,
    curves: Curves,
    narration: Narration,
}

impl<'a> Training<'a> {
    fn start(
        options: &'a Options,
        config: Config,
        robot: &Arc<RobotModel>,
        experts: &BTreeMap<String, RolledSkill>,
    ) -> anyhow::Result<Self> {
        let plan = config.plan();
        let ground = TrainingGround::new(config.environment.clone(), robot, experts, options.seed)
            .with_context(|| format!("skills/{}/training.toml", options.skill))?;
        let ground = Arc::new(ground);
        let tasks = make_tasks(&plan, |number| Ok(Environment::new(&ground, number)))?;
        let widths = widths(&tasks[0]);
        let folder = RunFolder::new(options.out.clone().unwrap_or_else(|| {
            PathBuf::from("out/train-policy").join(format!("{}-seed{}", options.skill, options.seed))
        }));
        let run = Run { seed: options.seed, config: identity(&config)? };
        let levels = tasks.iter().map(Task::level).collect();
        let (learner, curves) = if options.resume {
            folder.resume(&run, &plan, widths)?
        } else if let Some(path) = &options.from_checkpoint {
            let (learner, _) = read_checkpoint(path, &plan, widths)?;
            (Learner { levels, ..learner.restarted(&plan) }, Curves::default())
        } else {
            (Learner { levels, ..Learner::new(&plan, widths, options.seed) }, Curves::default())
        };
        let rounds = plan.imitation.as_ref().map_or(0, |imitation| imitation.rounds);
        let narration = Narration::new(rounds + plan.ppo.iterations, options.json);
        let trainer = Trainer::new(plan, options.seed, tasks, learner);
        Ok(Self { options, config, ground, trainer, run, folder, curves, narration })
    }

    fn run(mut self, policy: &Path) -> anyhow::Result<ExitCode> {
        self.folder.write_run(&json!({
            "command": std::env::args().collect::<Vec<_>>().join(" "),
            "version": env!("CARGO_PKG_VERSION"),
            "seed": self.options.seed,
            "config": self.config,
            "contract": self.ground.contract(),
        }))?;
        let started = now();
        let steps_before = self.trainer.learner.steps;
        if self.trainer.imitates() {
            self.imitate()?;
        }
        let mut stopped = false;
        while !self.trainer.is_done() && !stopped {
            self.segment()?;
            let minutes = started.elapsed().as_secs_f64() / 60.0;
            stopped = self.options.minutes.is_some_and(|most| minutes >= most);
        }
        self.narration.end();
        let finished = self.trainer.is_done();
        if finished {
            let bytes = self.policy()?;
            write_whole(policy, &bytes)?;
            self.write_card(policy, &bytes)?;
        }
        let wall_s = started.elapsed().as_secs_f64();
        let spent = self.trainer.spent();
        let learner = &self.trainer.learner;
        let written = if finished { policy.to_path_buf() } else { self.folder.policy() };
        let result = json!({
            "command": std::env::args().collect::<Vec<_>>().join(" "),
            "seed": self.options.seed,
            "version": env!("CARGO_PKG_VERSION"),
            "skill": self.options.skill,
            "finished": finished,
            "rounds": learner.rounds,
            "iterations": learner.iteration,
            "steps": learner.steps,
            "wall_s": wall_s,
            "steps_per_s": (learner.steps - steps_before) as f64 / wall_s,
            "drive_s": spent.drive_s,
            "learn_s": spent.learn_s,
            "folder": self.folder.path(),
            "written": written,
        });
        print_result(self.options.json, &result);
        Ok(ExitCode::SUCCESS)
    }

    fn policy(&self) -> anyhow::Result<Vec<u8>> {
        let metadata = metadata(self.ground.contract(), &self.options.skill, self.options.seed)?;
        Ok(onnx(&self.trainer.learner, metadata))
    }

    /// Where the policy came from, for the card beside it; what was measured of it is not known here.
    fn write_card(&self, policy: &Path, bytes: &[u8]) -> anyhow::Result<()> {
        let learner = &self.trainer.learner;
        let start = match &self.options.from_checkpoint {
            Some(path) => format!("the networks of `{}`", path.display()),
            None if self.options.resume => "the run's own checkpoint".to_owned(),
            None => "random weights".to_owned(),
        };
        let experts: Vec<String> = self
            .config
            .environment
            .experts
            .iter()
            .map(|(terrain, skill)| format!("{terrain}: {skill}"))
            .collect();
        let hidden = &self.config.network.actor;
        let last = |column: &str| {
            let value = self.curves.column(column).last().map(|(_, value)| *value);
            value.map_or_else(|| "none".to_owned(), |value| format!("{value:.4}"))
        };
        let facts = card::facts(&[
            ("file", format!("sha256 `{}`", sha256_hex(bytes))),
            ("made by", format!("`vocaloco {}`", std::env::args().skip(1).collect::<Vec<_>>().join(" "))),
            ("seed", self.options.seed.to_string()),
            ("network", format!("{} observations, {hidden:?} units, ELU", learner.actor.inputs())),
            ("started from", start),
            ("experts", experts.join(", ")),
            ("imitation", format!("{} rounds", learner.rounds)),
            ("reinforcement", format!("{} iterations of PPO", learner.iteration)),
            ("steps", learner.steps.to_string()),
            ("last mean reward of a step", last("reward")),
            ("last mean level", format!("{} of {}", last("level"), self.config.environment.levels - 1)),
        ]);
        let folder = policy.parent().unwrap_or(Path::new("."));
        card::write_section(folder, &self.options.skill, "policy.onnx", &facts)
    }

    fn imitate(&mut self) -> anyhow::Result<()> {
        let rounds = self.config.imitation.as_ref().map_or(0, |imitation| imitation.rounds);
        let (mut since, mut steps) = (now(), self.trainer.learner.steps);
        let (curves, narration) = (&mut self.curves, &self.narration);
        self.trainer.imitate(|record| {
            curves.add_round(record);
            narration.round(record);
            let steps_per_s = (record.steps - steps) as f64 / since.elapsed().as_secs_f64();
            let pace = Pace { done: [record.round, rounds], steps_per_s, minutes_left: f64::NAN };
            narration.round_line(record, pace);
            (since, steps) = (now(), record.steps);
            Ok(())
        })?;
        self.save()
    }

    fn segment(&mut self) -> anyhow::Result<()> {
        let (since, before) = (now(), self.trainer.learner.steps);
        let (curves, narration) = (&mut self.curves, &self.narration);
        let mut last = None;
        self.trainer.segment(|record| {
            curves.add_iteration(record);
            narration.iteration(record);
            last = Some(record.clone());
            Ok(())
        })?;
        self.save()?;
        let elapsed_s = since.elapsed().as_secs_f64();
        if let Some(record) = last {
            let wanted = self.config.ppo.iterations;
            let left = wanted.saturating_sub(record.iteration) as f64;
            let pace = Pace {
                done: [record.iteration, wanted],
                steps_per_s: (record.steps - before) as f64 / elapsed_s,
                minutes_left: left * elapsed_s / self.config.segment_iterations as f64 / 60.0,
            };
            self.narration.segment_line(&record, pace);
        }
        Ok(())
    }

    fn save(&self) -> anyhow::Result<()> {
        let title = format!("{}, seed {}", self.options.skill, self.options.seed);
        self.folder.write(&self.trainer.learner, &self.run, &self.curves, &self.policy()?, &title)
    }
}

#[expect(clippy::print_stdout, reason = "the verb's result")]
fn print_result(json: bool, result: &serde_json::Value) {
    if json {
        println!("{result}");
        return;
    }
    println!(
        "{}: {} rounds of imitation, {} iterations, {} steps in {:.0} s ({:.0} steps/s)",
        result["skill"].as_str().unwrap_or_default(),
        result["rounds"],
        result["iterations"],
        result["steps"],
        result["wall_s"].as_f64().unwrap_or_default(),
        result["steps_per_s"].as_f64().unwrap_or_default(),
    );
    if result["finished"] == false {
        println!("stopped; --resume goes on");
    }
    println!("written: {}", result["written"].as_str().unwrap_or_default());
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(parts: Parts) -> Options {
        Options {
            skill: "walk_network".to_owned(),
            robot: "anymal_d".to_owned(),
            seed: 1,
            parts,
            resume: false,
            from_checkpoint: None,
            iterations: None,
            minutes: None,
            out: None,
            json: false,
        }
    }

    fn shipped() -> Vec<(PathBuf, Config)> {
        let skills = Path::new(env!("CARGO_MANIFEST_DIR")).join("../skills");
        let files =
            std::fs::read_dir(skills).unwrap().map(|entry| entry.unwrap().path().join("training.toml"));
        files.filter(|file| file.is_file()).map(|file| (file.clone(), Config::read(&file).unwrap())).collect()
    }

    #[test]
    fn every_shipped_training_configuration_is_sound() {
        let shipped = shipped();
        assert!(!shipped.is_empty());
        for (file, config) in shipped {
            assert!(
                config.environment.check().is_ok(),
                "{}: {:?}",
                file.display(),
                config.environment.check()
            );
        }
    }

    #[test]
    fn a_method_leaves_out_what_it_does_not_do() {
        let (_, config) = shipped().remove(0);
        let mut imitation = config.clone();
        options(Parts::Imitation).apply_to(&mut imitation).unwrap();
        assert_eq!((imitation.ppo.iterations, imitation.imitation.is_some()), (0, true));
        let mut reinforcement = config.clone();
        options(Parts::Reinforcement).apply_to(&mut reinforcement).unwrap();
        assert!(reinforcement.imitation.is_none() && reinforcement.ppo == config.ppo);
        let without = options(Parts::Imitation).apply_to(&mut reinforcement).unwrap_err().to_string();
        assert!(without.contains("[imitation]"), "{without}");
    }

    #[test]
    fn a_checkpoint_to_start_from_stands_for_the_imitation() {
        let (_, mut config) = shipped().remove(0);
        let options = Options { from_checkpoint: Some("a".into()), ..options(Parts::Both) };
        let error = options.apply_to(&mut config).unwrap_err().to_string();
        assert!(error.contains("--method ppo"), "{error}");
    }

    #[test]
    fn a_longer_run_goes_on_from_a_shorter_one() {
        let (_, config) = shipped().remove(0);
        let mut longer = config.clone();
        longer.ppo.iterations *= 2;
        assert_eq!(identity(&config).unwrap(), identity(&longer).unwrap());
        longer.ppo.clip *= 2.0;
        assert_ne!(identity(&config).unwrap(), identity(&longer).unwrap());
    }
}
