//! What `collect` and `evaluate` share: a robot, a skill to roll out, and the plant's name.

use std::sync::Arc;

use anyhow::Context;
use vocaloco_core::{
    installation::Installation,
    registry::{LoadedSkill, ModelPolicy, load_skill},
    robot::RobotModel,
};
use vocaloco_sim::{plant::PlantKind, rollout::RolledSkill};

/// A skill that can be rolled out, predictors or not.
pub(crate) struct Rolled {
    pub(crate) installation: Installation,
    pub(crate) robot: Arc<RobotModel>,
    pub(crate) loaded: LoadedSkill,
    pub(crate) skill: RolledSkill,
}

impl Rolled {
    pub(crate) fn load(robot: &str, skill: &str) -> anyhow::Result<Self> {
        let installation = Installation::find()?;
        let robot = Arc::new(RobotModel::load(&installation.robots_folder(), robot)?);
        let loaded = load_skill(&installation, skill, &robot.description, ModelPolicy::Optional)?;
        let skill = RolledSkill::from_loaded(&loaded, &robot)?;
        Ok(Self { installation, robot, loaded, skill })
    }

    /// Hash of the plugin's sources, where the installation holds them.
    pub(crate) fn plugin_source_sha256(&self) -> anyhow::Result<Option<String>> {
        let folder = self.installation.root.join("plugins").join(&self.loaded.manifest.plugin);
        vocaloco_sim::identity::source_sha256(&folder)
            .with_context(|| format!("sources of the plugin in {}", folder.display()))
    }
}

/// The plants by name, for `--plant`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Plant {
    /// rapier3d's multibody, which every reported number uses
    Reference,
    /// The plant's own reduced-coordinate dynamics, for searching and training, certified against the
    /// reference (docs/plant.md)
    Fast,
}

impl From<Plant> for PlantKind {
    fn from(plant: Plant) -> Self {
        match plant {
            Plant::Reference => Self::Reference,
            Plant::Fast => Self::Fast,
        }
    }
}
