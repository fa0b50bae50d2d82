//! What a skill and its predictors are worth on one terrain of one size, measured unless it stands: calibration,
//! the oracle and the paper's figures read the same cells.

use std::path::Path;
use std::sync::Arc;

use anyhow::Context;
use serde::Serialize;
use vocaloco_core::{
    installation::Installation,
    predictor::{Predictor, backend},
    registry::{LoadedSkill, ModelPolicy, load_skill},
    robot::RobotModel,
};
use vocaloco_sim::{
    calibration::Predictors,
    collect::CollectConfig,
    collected::{Collected, collect},
    dataset::{Kind, RobotId, SimulatorId, SkillId},
    evaluate::Query,
    identity,
    plant::PlantKind,
    rollout::RolledSkill,
    threads::with_threads,
};

use super::store::Store;

/// What every result depends on besides its configuration and its skills.
#[derive(Serialize)]
pub(super) struct MadeBy {
    version: &'static str,
    backend: String,
    simulator: SimulatorId,
    robot: RobotId,
}

impl MadeBy {
    pub(super) fn this(robot: &RobotModel, plant: PlantKind) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION"),
            backend: backend().name.to_owned(),
            simulator: identity::simulator(plant),
            robot: identity::robot(robot),
        }
    }
}

/// A skill that can be rolled out, with what its behaviour depends on.
pub(super) struct Actor {
    pub(super) rolled: RolledSkill,
    pub(super) id: SkillId,
}

impl Actor {
    pub(super) fn new(
        installation: &Installation,
        skill: &LoadedSkill,
        robot: &RobotModel,
    ) -> anyhow::Result<Self> {
        let rolled = RolledSkill::from_loaded(skill, robot)?;
        let folder: &Path = &installation.root.join("plugins").join(&skill.manifest.plugin);
        let source = identity::source_sha256(folder)
            .with_context(|| format!("sources of the plugin in {}", folder.display()))?;
        let id = identity::skill(&rolled, source);
        Ok(Self { rolled, id })
    }
}

/// What is asked of this skill's rollouts, on one terrain of one size: its own horizon and time limit.
pub(super) fn query_of(skill: &LoadedSkill, query: Query) -> Query {
    Query {
        rules: CollectConfig::new(Kind::Viability, 0).for_skill(&skill.manifest.rollout).rollout,
        ..query
    }
}

/// One cell; `progress` counts its rollouts.
pub(super) fn cell(
    (store, threads): (&Store, usize),
    installation: &Installation,
    robot: &Arc<RobotModel>,
    actor: &Actor,
    query: &Query,
    progress: &(dyn Fn() + Sync),
) -> anyhow::Result<Collected> {
    let name = &actor.id.name;
    let loaded = load_skill(installation, name, &robot.description, ModelPolicy::Optional)?;
    let mut predictors = Predictors {
        viability: loaded.viability.with_context(|| missing(name, "viability"))?,
        cot: loaded.cot.with_context(|| missing(name, "cot"))?,
    };
    let sha256 = |predictor: &Predictor| predictor.sha256().to_owned();
    let key = serde_json::json!({
        "experiment": "collected",
        "made_by": MadeBy::this(robot, query.plant),
        "skill": actor.id,
        "predictors": [sha256(&predictors.viability), sha256(&predictors.cot)],
        // Every field of it, the one spelling that cannot forget any.
        "query": format!("{query:?}"),
    });
    let measure = || {
        let work = || collect(robot, &actor.rolled, &mut predictors, query, progress);
        with_threads(threads, work)?
            .with_context(|| format!("skill {name} on {} of {} m", query.terrain, query.size_m))
    };
    let standing = || (0..query.samples).for_each(|_| progress());
    store.result(&format!("collected-{name}-{}-{}", query.terrain, query.size_m), &key, standing, measure)
}

/// What to say of a skill without this predictor.
pub(super) fn missing(skill: &str, kind: &str) -> String {
    format!(
        "skill {skill}: found no {kind}.onnx, wanted both predictors; `vocaloco train --skill {skill}` makes them"
    )
}
