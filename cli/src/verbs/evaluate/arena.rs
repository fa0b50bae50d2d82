//! A deployment, loaded once, and what is measured with it on courses and tiles; every result goes through
//! the store.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::Context;
use serde::Serialize;
use serde::de::DeserializeOwned;
use vocaloco_core::{
    heightfield::Field,
    installation::Installation,
    manifest::Selection,
    predictor::Predictor,
    registry::{LoadedSkill, ModelPolicy, load_deployment, load_skill},
    robot::RobotModel,
    runtime::{CallFault, Predict, Runtime, RuntimeConfig, Skill},
    selector::Prediction,
};
use vocaloco_sim::{
    collected::Collected,
    course::{
        Blame, CourseConfig, CourseError, CourseRun, Crew, Ground, Oracle, Outcome, Runtimes, Selector,
        SuccessRow, Worth, blame, roll_out, roll_out_each, success,
    },
    dataset::SkillId,
    evaluate::Query,
    identity::sha256_hex,
    plant::PlantKind,
    terrain::{Course, TerrainKind},
    threads::with_threads,
};

use super::cells::{Actor, MadeBy, cell, query_of};
use super::store::Store;
use super::who::Who;

/// What an experiment changes about a deployment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(super) struct Variation {
    /// Ticks that must agree before a switch, and before a stop.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) window: Option<usize>,
    /// One threshold for every skill, held to it as well.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) threshold: Option<f32>,
    /// What the oracle knows was collected over this horizon, m, with a time limit in proportion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) horizon_m: Option<f32>,
    /// The most viable skill wins, whatever it costs.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(super) without_cost: bool,
    /// No skill is committed to its target.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(super) without_commitment: bool,
}

/// A skill of the deployment, as results depend on it.
#[derive(Clone, Serialize)]
pub(super) struct Member {
    pub(super) id: SkillId,
    selection: String,
    viability_sha256: String,
    cot_sha256: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    hold_threshold: Option<f32>,
    #[serde(skip)]
    pub(super) threshold: f32,
}

/// What the oracle is made from: how many rollouts, with which seed and noise.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sampling {
    pub(super) samples: u64,
    pub(super) seed: u64,
    pub(super) field_noise_m: f32,
    pub(super) patch_noise_m: f32,
    /// Another horizon than each skill's own, m.
    pub(super) horizon_m: Option<f32>,
}

/// A deployment to measure with.
pub(super) struct Arena {
    installation: Installation,
    /// Name of the deployment.
    pub(super) deployment: String,
    pub(super) robot: Arc<RobotModel>,
    /// Its skills, in its order.
    pub(super) members: Vec<Member>,
    /// Windows and handover, as results depend on them.
    rules: String,
    actors: BTreeMap<String, Actor>,
    /// Viability thresholds in place of the deployment's own.
    raised: BTreeMap<String, f32>,
    store: Store,
    threads: usize,
}

impl Arena {
    /// Loads a deployment, and the skills that run alone beside it.
    pub(super) fn load(
        deployment: &str,
        alone: &[&str],
        (store, threads): (Store, usize),
    ) -> anyhow::Result<Self> {
        let installation = Installation::find()?;
        let loaded = load_deployment(&installation, deployment)
            .with_context(|| format!("deployment `{deployment}`"))?;
        for refusal in &loaded.refused {
            eprintln!("refused: {refusal}");
        }
        let robot = Arc::clone(&loaded.robot);
        let (mut actors, mut members) = (BTreeMap::new(), Vec::new());
        for skill in &loaded.skills {
            let actor = Actor::new(&installation, skill, &robot)?;
            members.push(Member::new(skill, &actor.id)?);
            actors.insert(skill.manifest.name.clone(), actor);
        }
        for name in alone {
            if !actors.contains_key(*name) {
                let skill = load_skill(&installation, name, &robot.description, ModelPolicy::Optional)?;
                actors.insert((*name).to_owned(), Actor::new(&installation, &skill, &robot)?);
            }
        }
        let rules =
            format!("{:?} {:?}", RuntimeConfig::from(&loaded.deployment), loaded.deployment.switching);
        Ok(Self {
            installation,
            deployment: deployment.to_owned(),
            robot,
            members,
            rules,
            actors,
            raised: BTreeMap::new(),
            store,
            threads,
        })
    }

    /// Names of the deployment's skills, in its order.
    pub(super) fn names(&self) -> Vec<&str> {
        self.members.iter().map(|member| member.id.name.as_str()).collect()
    }

    /// Skills with their thresholds, in the deployment's order.
    pub(super) fn thresholds(&self) -> Vec<(String, f32)> {
        self.members.iter().map(|member| (member.id.name.clone(), member.threshold)).collect()
    }

    /// The thresholds in words, with what skills that drive are held to.
    pub(super) fn thresholds_in_words(&self) -> String {
        let words = |member: &Member| {
            let held = member.hold_threshold.map(|hold| format!(" ({hold} while it drives)"));
            format!("{} {}{}", member.id.name, member.threshold, held.unwrap_or_default())
        };
        self.members.iter().map(words).collect::<Vec<_>>().join(", ")
    }

    /// Sets a skill's threshold for all that is driven from now on.
    pub(super) fn set_threshold(&mut self, skill: &str, threshold: f32) {
        self.raised.insert(skill.to_owned(), threshold);
        for member in self.members.iter_mut().filter(|member| member.id.name == skill) {
            member.threshold = threshold;
        }
    }

    /// Runtimes of the deployment under a variation; the oracle's are made for one course and height.
    pub(super) fn runtimes(&self, who: &Who, variation: Variation) -> Runtimes<'_> {
        Runtimes::new(&who.to_string(), move || Ok(self.runtime(variation)?.into()))
    }

    fn runtime(&self, variation: Variation) -> Result<Runtime, CourseError> {
        let (config, switching, skills) = self.parts(variation)?;
        Ok(Runtime::from_skills(config, Arc::clone(&self.robot), skills).with_switching(switching))
    }

    fn parts(
        &self,
        variation: Variation,
    ) -> Result<(RuntimeConfig, vocaloco_core::runtime::Switching, Vec<Skill>), CourseError> {
        let loaded = load_deployment(&self.installation, &self.deployment)?;
        let mut config = RuntimeConfig::from(&loaded.deployment);
        let switching = loaded.deployment.switching;
        if let Some(window) = variation.window {
            config.windows.switch = window;
            config.windows.stop = window;
        }
        let ready = |skill| Skill::of(skill, &self.robot.description);
        let mut skills = loaded.skills.into_iter().map(ready).collect::<Result<Vec<_>, _>>()?;
        for skill in &mut skills {
            let raised = self.raised.get(&skill.rule.name).copied();
            if let Some(threshold) = variation.threshold.or(raised) {
                skill.rule.set_threshold(threshold);
            }
            if let Some(threshold) = variation.threshold {
                skill.rule.hold_threshold = threshold;
            }
            skill.rule.committed &= !variation.without_commitment;
        }
        if variation.without_cost {
            let costless = |skill: Skill| Skill { predictors: Box::new(Costless(skill.predictors)), ..skill };
            skills = skills.into_iter().map(costless).collect();
        }
        Ok((config, switching, skills))
    }

    /// Runtimes that ask an oracle of what was collected on flat ground and on what lies across the course.
    fn oracles(&self, course: Course, sampling: Sampling) -> anyhow::Result<Runtimes<'_>> {
        let across = course.obstacles().into_iter().map(|obstacle| (obstacle.kind, obstacle.size_m));
        let grounds: Vec<_> = std::iter::once((TerrainKind::Flat, 0.0)).chain(across).collect();
        let mut table: BTreeMap<String, Vec<(TerrainKind, Worth)>> = BTreeMap::new();
        for name in self.names() {
            for (terrain, size_m) in grounds.iter().copied() {
                let cell = self.cell(name, terrain, size_m, sampling, &|| ())?;
                table.entry(name.to_owned()).or_default().push((terrain, cell.worth()));
            }
        }
        Ok(Runtimes::new("oracle", move || {
            let (config, switching, skills) = self.parts(Variation::default())?;
            let ground = Arc::new(Ground::default());
            let asking = |skill: Skill| {
                let worth = table.get(&skill.rule.name).map_or(&[][..], Vec::as_slice);
                Skill { predictors: Box::new(Oracle::new(Arc::clone(&ground), worth)), ..skill }
            };
            let skills = skills.into_iter().map(asking).collect();
            let runtime = Runtime::from_skills(config, Arc::clone(&self.robot), skills);
            Ok(Crew { runtime: runtime.with_switching(switching), ground: Some(ground) })
        }))
    }

    /// A row of `evaluate success`, measured unless it stands; `progress` counts its rollouts.
    pub(super) fn row(
        &self,
        config: &CourseConfig,
        n: u64,
        (who, variation): (&Who, Variation),
        samples: u64,
        progress: &(dyn Fn(u64) + Sync),
    ) -> anyhow::Result<SuccessRow> {
        let key = self.row_key(config, n, (who, variation), samples)?;
        let name =
            format!("success-{}-{}-{}", config.kind.id(), who.to_string().replace(':', "-"), config.size_m);
        let measure = || {
            let chosen;
            let selector = match who {
                Who::Skill(name) => Selector::Skill(&self.actor(name)?.rolled),
                Who::Vocaloco => {
                    chosen = self.runtimes(who, variation);
                    Selector::Runtime(&chosen)
                }
                Who::Oracle => {
                    chosen = self.oracles(config.course(), sampling(config, samples, variation))?;
                    Selector::Runtime(&chosen)
                }
            };
            let row = || success(&self.robot, config, n, &selector, &|| progress(1));
            Ok(with_threads(self.threads, row)??)
        };
        self.store.result(&name, &key, || progress(n), measure)
    }

    /// One recorded rollout of a course; of a runtime also its setup, for the decisions log.
    pub(super) fn run(
        &self,
        config: &CourseConfig,
        (who, variation): (&Who, Variation),
        samples: u64,
    ) -> anyhow::Result<(CourseRun, Option<vocaloco_core::decision_log::Setup>)> {
        let runtimes = match who {
            Who::Skill(name) => {
                let selector = Selector::Skill(&self.actor(name)?.rolled);
                return Ok((roll_out(&self.robot, config, &selector)?, None));
            }
            Who::Vocaloco => self.runtimes(who, variation),
            Who::Oracle => self.oracles(config.course(), sampling(config, samples, variation))?,
        };
        let setup = runtimes
            .with(|crew| Ok(vocaloco_core::decision_log::Setup::of(&crew.runtime, &self.deployment)))?;
        Ok((roll_out(&self.robot, config, &Selector::Runtime(&runtimes))?, Some(setup)))
    }

    /// How rollouts of the deployment end, and which skill a crash is laid at; in parallel, in their order.
    pub(super) fn ends(
        &self,
        configs: &[CourseConfig],
        progress: &(dyn Fn() + Sync),
    ) -> anyhow::Result<Vec<(Outcome, Option<Blame>)>> {
        let runtimes = self.runtimes(&Who::Vocaloco, Variation::default());
        let window = load_deployment(&self.installation, &self.deployment)?.deployment.switch_window;
        let is_held = |skill: &str| {
            let member = self.members.iter().find(|member| member.id.name == skill);
            member.is_some_and(|member| member.hold_threshold.is_some())
        };
        let ended = |run: CourseRun| {
            progress();
            (run.outcome, blame(&run, window, |skill| is_held(skill)))
        };
        let all = || roll_out_each(&self.robot, configs, &Selector::Runtime(&runtimes), &ended);
        Ok(with_threads(self.threads, all)??)
    }

    /// A result that rollouts of the deployment under its present thresholds make; measured unless it stands.
    pub(super) fn of_rollouts<T: Serialize + DeserializeOwned>(
        &self,
        experiment: &str,
        configs: &[CourseConfig],
        (standing, measure): (impl FnOnce(), impl FnOnce() -> anyhow::Result<T>),
    ) -> anyhow::Result<T> {
        let key = serde_json::json!({
            "experiment": experiment,
            "made_by": MadeBy::this(&self.robot, PlantKind::Reference),
            "members": self.members,
            "rules": self.rules,
            "thresholds": self.thresholds(),
            "configs": sha256_hex(format!("{configs:?}").as_bytes()),
        });
        self.store.result(experiment, &key, standing, measure)
    }

    /// The same through the store; `drive` makes it.
    pub(super) fn recorded<T: Serialize + DeserializeOwned>(
        &self,
        config: &CourseConfig,
        who: &Who,
        drive: impl FnOnce() -> anyhow::Result<T>,
    ) -> anyhow::Result<T> {
        let mut key = self.row_key(config, 1, (who, Variation::default()), 0)?;
        key["experiment"] = "recorded".into();
        let name =
            format!("run-{}-{}-{}", config.kind.id(), who.to_string().replace(':', "-"), config.size_m);
        self.store.result(&name, &key, || (), drive)
    }

    /// A skill's viability predictor.
    pub(super) fn viability(&self, skill: &str) -> anyhow::Result<Predictor> {
        let description = &self.robot.description;
        let loaded = load_skill(&self.installation, skill, description, ModelPolicy::Required)?;
        loaded.viability.with_context(|| format!("skill {skill}: no viability predictor"))
    }

    /// What a skill and its predictors are worth on one terrain of one size, measured unless it stands.
    pub(super) fn cell(
        &self,
        skill: &str,
        terrain: TerrainKind,
        size_m: f32,
        sampling: Sampling,
        progress: &(dyn Fn() + Sync),
    ) -> anyhow::Result<Collected> {
        let size_m = if terrain == TerrainKind::Flat { 0.0 } else { size_m };
        let query = Query {
            field_noise_m: sampling.field_noise_m,
            patch_noise_m: sampling.patch_noise_m,
            ..Query::new(terrain, size_m, sampling.samples, sampling.seed)
        };
        let actor = self.actor(skill)?;
        let loaded = load_skill(&self.installation, skill, &self.robot.description, ModelPolicy::Required)?;
        let mut query = query_of(&loaded, query);
        if let Some(horizon_m) = sampling.horizon_m.map(f64::from) {
            query.rules.time_limit_s *= horizon_m / query.rules.horizon_m;
            query.rules.horizon_m = horizon_m;
        }
        cell((&self.store, self.threads), &self.installation, &self.robot, actor, &query, progress)
    }

    fn actor(&self, name: &str) -> anyhow::Result<&Actor> {
        self.actors.get(name).with_context(|| format!("skill {name} is not loaded"))
    }

    /// Everything that a row depends on.
    fn row_key(
        &self,
        config: &CourseConfig,
        n: u64,
        (who, variation): (&Who, Variation),
        samples: u64,
    ) -> anyhow::Result<serde_json::Value> {
        let chooser = match who {
            Who::Skill(name) => serde_json::json!({ "skill": self.actor(name)?.id }),
            Who::Vocaloco => {
                serde_json::json!({ "members": self.members, "rules": self.rules, "variation": variation })
            }
            Who::Oracle => {
                let told =
                    |member: &Member| (member.id.clone(), member.selection.clone(), member.hold_threshold);
                let ids: Vec<_> = self.members.iter().map(told).collect();
                serde_json::json!({ "members": ids, "rules": self.rules, "samples": samples, "variation": variation })
            }
        };
        Ok(serde_json::json!({
            "experiment": "success",
            "made_by": MadeBy::this(&self.robot, PlantKind::Reference),
            "who": who,
            "chooser": chooser,
            "n": n,
            // Every field of it, the one spelling that cannot forget any.
            "config": format!("{config:?}"),
        }))
    }
}

fn sampling(config: &CourseConfig, samples: u64, variation: Variation) -> Sampling {
    Sampling {
        samples,
        seed: config.seed,
        field_noise_m: config.field_noise_m,
        patch_noise_m: config.noise.patch_m,
        horizon_m: variation.horizon_m,
    }
}

impl Member {
    fn new(skill: &LoadedSkill, id: &SkillId) -> anyhow::Result<Self> {
        let hash = |predictor: Option<&Predictor>| {
            let predictor = predictor.with_context(|| format!("skill {}: no predictors", id.name))?;
            anyhow::Ok(predictor.sha256().to_owned())
        };
        let selection: &Selection = &skill.manifest.selection;
        Ok(Self {
            id: id.clone(),
            selection: format!("{selection:?} {:?}", skill.manifest.command),
            viability_sha256: hash(skill.viability.as_ref())?,
            cot_sha256: hash(skill.cot.as_ref())?,
            hold_threshold: skill.hold_threshold,
            threshold: selection.viability_threshold,
        })
    }
}

/// Predictors whose cost is the chance of failure: the most viable skill is then the cheapest.
struct Costless(Box<dyn Predict>);

impl Predict for Costless {
    fn predict(&mut self, field: &Field) -> (Prediction, Option<CallFault>) {
        let (prediction, fault) = self.0.predict(field);
        // A cost is positive.
        (Prediction { cot: 1.0 - prediction.viability + 1e-6, ..prediction }, fault)
    }
}
