//! `train-policy`: the parameters of a structured controller, found by CMA-ES in the simulator.
//!
//! Every candidate of a generation meets the same episodes, drawn fresh each generation from
//! (seed, generation). A run repeats exactly, so a stopped one resumes by reading back the costs it
//! had already found.

mod config;
mod episode;
mod history;
mod space;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::{
        Arc, PoisonError, RwLock,
        atomic::{AtomicUsize, Ordering},
    },
};

use anyhow::{Context, anyhow};
use cmaes::{CMAESOptions, DVector};
use indicatif::{ProgressBar, ProgressStyle};
use vocaloco_core::{
    installation::Installation, manifest::SkillManifest, plugin::PluginLibrary, robot::RobotModel,
};
use vocaloco_sim::rollout::RolledSkill;

use config::SearchConfig;
use episode::{Arena, Score};
use history::History;
use space::Space;

/// What the command line says.
#[derive(Debug, Clone)]
pub struct Options {
    /// The skill to optimise.
    pub skill: String,
    /// Robot, as named under manifests/robots.
    pub robot: String,
    /// Seed of the search and of its episodes.
    pub seed: u64,
    /// Generations instead of the configured number.
    pub generations: Option<usize>,
    /// First step of the search instead of the configured one.
    pub initial_step: Option<f64>,
    /// Goes on with a stopped run of the same seed.
    pub resume: bool,
    /// Starts from this skill's present parameters instead of the configured start.
    pub start_from: Option<String>,
    /// Judges the present parameter file and writes nothing.
    pub judge: bool,
    /// Prints the result as JSON.
    pub json: bool,
}

/// Runs the verb.
///
/// # Errors
/// What is missing or wrong in the skill, its search configuration or its plugin.
pub fn run(args: &Options) -> anyhow::Result<ExitCode> {
    let installation = Installation::find()?;
    let robot = Arc::new(RobotModel::load(&installation.robots_folder(), &args.robot)?);
    let manifest = read_manifest(&installation, &args.skill)?;
    let library = PluginLibrary::open(&installation.plugin_path, &manifest.plugin)?;
    let folder = installation.skill_folder(&args.skill);
    let path = parameter_file(&installation, &manifest)?;
    let mut config = SearchConfig::read(&folder.join("search.toml"))?;
    if let Some(generations) = args.generations {
        config.generations = generations;
    }
    if let Some(initial_step) = args.initial_step {
        config.initial_step = initial_step;
    }
    config.check()?;
    if let Some(other) = &args.start_from {
        let path = parameter_file(&installation, &read_manifest(&installation, other)?)?;
        config.start = toml::from_str(&read(&path)?).with_context(|| path.display().to_string())?;
    }
    let parameters = library.description().parameters.to_vec();
    let space = Space::new(&parameters, &config.fixed, &config.start)
        .with_context(|| folder.join("search.toml").display().to_string())?;
    let search = Search { args, config, library, robot, space };
    if args.judge {
        let score = search.judge(&read(&path)?)?;
        print_result(args.json, &score, None);
        return Ok(ExitCode::SUCCESS);
    }
    let (text, score) = search.run()?;
    write_result(&path, &search.header(&score), &text)?;
    print_result(args.json, &score, Some(&path));
    Ok(ExitCode::SUCCESS)
}

/// A structured controller with its present parameters but for those in `changed`, as the simulator
/// rolls it out.
///
/// # Errors
/// Its manifest, plugin or parameter file is missing or wrong, or has no parameter of a changed name.
pub(crate) fn load_skill(
    installation: &Installation,
    robot: &RobotModel,
    name: &str,
    changed: &BTreeMap<String, f64>,
) -> anyhow::Result<RolledSkill> {
    let manifest = read_manifest(installation, name)?;
    let library = PluginLibrary::open(&installation.plugin_path, &manifest.plugin)?;
    let path = parameter_file(installation, &manifest)?;
    let text = changed_parameters(&read(&path)?, changed).with_context(|| path.display().to_string())?;
    Ok(RolledSkill::new(name, library, &text, robot)?)
}

/// A parameter text with other values for some of its parameters.
fn changed_parameters(text: &str, changed: &BTreeMap<String, f64>) -> anyhow::Result<String> {
    let mut parameters: toml::Table = toml::from_str(text)?;
    for (parameter, value) in changed {
        let place = parameters.get_mut(parameter).with_context(|| {
            format!(
                "environment.expert_parameters.{parameter}: found no parameter of that name, wanted one of this file"
            )
        })?;
        *place = toml::Value::Float(*value);
    }
    Ok(toml::to_string(&parameters)?)
}

fn read_manifest(installation: &Installation, skill: &str) -> anyhow::Result<SkillManifest> {
    SkillManifest::read(&installation.skill_file(skill)).map_err(|finding| anyhow!("{finding}"))
}

fn parameter_file(installation: &Installation, manifest: &SkillManifest) -> anyhow::Result<PathBuf> {
    let file = manifest.models.parameters.as_ref().ok_or_else(|| {
        anyhow!("{}: models.parameters: found none, wanted the file to optimise", manifest.file.display())
    })?;
    Ok(installation.skill_folder(&manifest.name).join(file))
}

fn read(path: &Path) -> anyhow::Result<String> {
    std::fs::read_to_string(path).with_context(|| path.display().to_string())
}

/// Cost of a parameter set that the plugin refuses.
const WORST_COST: f64 = 10.0;
/// Cost per squared distance outside the parameters' ranges.
const EXCESS_WEIGHT: f64 = 10.0;

struct Search<'a> {
    args: &'a Options,
    config: SearchConfig,
    library: Arc<PluginLibrary>,
    robot: Arc<RobotModel>,
    space: Space,
}

impl Search<'_> {
    /// The best parameter text and its score on fresh episodes.
    fn run(&self) -> anyhow::Result<(String, Score)> {
        let config = &self.config;
        let history = History::open(&self.history_path(), self.args.resume)?;
        let generation = AtomicUsize::new(0);
        let arena = RwLock::new(Arena::empty());
        let objective = |point: &DVector<f64>| {
            let generation = generation.load(Ordering::SeqCst);
            let point = point.as_slice();
            history.cost(generation, point, || {
                let arena = arena.read().unwrap_or_else(PoisonError::into_inner);
                // Inside its ranges a parameter set is accepted; one that is not counts as the worst.
                let cost = self
                    .skill(&self.space.text(point))
                    .map_or(WORST_COST, |skill| arena.score(&self.robot, &skill, config).cost);
                cost + EXCESS_WEIGHT * Space::excess(point)
            })
        };
        let mut state = CMAESOptions::new(self.space.start(), config.initial_step)
            .population_size(config.population)
            .seed(self.args.seed)
            .build(objective)
            .map_err(|error| anyhow!("the optimiser refuses its options: {error:?}"))?;

        let bar = progress(config.generations as u64);
        for index in 0..config.generations {
            generation.store(index, Ordering::SeqCst);
            if !history.has(index, config.population) {
                let fresh = Arena::new(
                    &self.robot,
                    config,
                    self.args.seed,
                    &format!("generation {index}"),
                    config.episodes,
                    episode::SEARCH_PLANT,
                );
                *arena.write().unwrap_or_else(PoisonError::into_inner) = fresh;
            }
            let stopped = state.next_parallel();
            history.flush()?;
            bar.set_position(index as u64 + 1);
            if let Some(best) = state.current_best_individual() {
                bar.set_message(format!("cost {:.3}, step {:.3}", best.value, state.sigma()));
            }
            if stopped.is_some() {
                break;
            }
        }
        bar.finish_and_clear();

        // A single candidate's cost is a lucky one; the mean of the distribution is the estimate.
        let mean = self.space.text(state.mean().as_slice());
        let score = self.judge(&mean)?;
        Ok((mean, score))
    }

    fn judge(&self, text: &str) -> anyhow::Result<Score> {
        let skill = self.skill(text)?;
        let arena = Arena::new(
            &self.robot,
            &self.config,
            self.args.seed,
            "final",
            self.config.final_episodes,
            episode::JUDGE_PLANT,
        );
        Ok(arena.score_in_parallel(&self.robot, &skill, &self.config))
    }

    fn skill(&self, text: &str) -> anyhow::Result<RolledSkill> {
        Ok(RolledSkill::new(&self.args.skill, Arc::clone(&self.library), text, &self.robot)?)
    }

    fn history_path(&self) -> PathBuf {
        PathBuf::from("out/train-policy").join(format!("{}-seed{}.csv", self.args.skill, self.args.seed))
    }

    fn header(&self, score: &Score) -> String {
        let options = [
            ("start-from", self.args.start_from.clone()),
            ("generations", self.args.generations.map(|count| count.to_string())),
            ("initial-step", self.args.initial_step.map(|step| step.to_string())),
        ];
        let options: String = options
            .iter()
            .filter_map(|(name, value)| Some(format!(" --{name} {}", value.as_ref()?)))
            .collect();
        format!(
            "# Found by: vocaloco train-policy --method cma --skill {} --seed {}{options}\n\
             # On {} fresh episodes over {} m ({} plant): {:.1} % reached, {:.1} % base contact, \
             {:.1} % out of time,\n# mean cost of transport {:.3}, mean speed {:.2} m/s.\n",
            self.args.skill,
            self.args.seed,
            score.episodes,
            self.config.horizon_m,
            episode::JUDGE_PLANT.id(),
            100.0 * score.reached,
            100.0 * score.crashed,
            100.0 * (1.0 - score.reached - score.crashed),
            score.cost_of_transport,
            score.speed_m_per_s,
        )
    }
}

fn write_result(path: &Path, header: &str, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, format!("{header}{text}"))
        .with_context(|| format!("{}: cannot be written", path.display()))
}

#[allow(clippy::print_stdout, reason = "the verb's result")]
fn print_result(json: bool, score: &Score, path: Option<&PathBuf>) {
    if json {
        println!("{}", serde_json::json!({ "score": score, "written": path }));
    } else {
        println!("{score}");
        if let Some(path) = path {
            println!("written: {}", path.display());
        }
    }
}

fn progress(generations: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:24} generation {pos}/{len}, {msg}, {eta} left");
    let bar = ProgressBar::new(generations);
    match style {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_expert_takes_other_values_for_parameters_it_has_and_no_others() {
        let text = "hurry = 0.3\nduty = 0.5\n";
        let changed = changed_parameters(text, &BTreeMap::from([("hurry".to_owned(), 0.0)])).unwrap();
        let table: toml::Table = toml::from_str(&changed).unwrap();
        assert_eq!((table["hurry"].as_float(), table["duty"].as_float()), (Some(0.0), Some(0.5)));
        let unknown = changed_parameters(text, &BTreeMap::from([("hury".to_owned(), 0.0)])).unwrap_err();
        assert!(unknown.to_string().contains("hury"), "{unknown}");
    }
}
