//! A skill as rollouts use it: its plugin and parameters, with no predictor.

use std::sync::Arc;

use thiserror::Error;
use vocaloco_core::{
    plugin::{PluginError, PluginInstance, PluginLibrary},
    policy::PolicyNetwork,
    registry::LoadedSkill,
    robot::RobotModel,
    target::TargetRule,
};
use vocaloco_plugin_api::{CommandKind, Description};

/// The parameter by which a plugin lets its gait start anywhere in its cycle, 0 to 1.
const PHASE: &str = "initial_phase";

/// A plugin with parameters, ready to make an instance for each rollout.
#[derive(Clone, Debug)]
pub struct RolledSkill {
    /// Name of the skill.
    pub name: String,
    library: Arc<PluginLibrary>,
    parameters: String,
    policy: Option<PolicyNetwork>,
    target: Option<TargetRule>,
    /// The parameters, parsed, where the plugin offers a phase.
    table: Option<toml::Table>,
}

/// A skill that cannot be rolled out.
#[derive(Debug, Error)]
pub enum SkillRefused {
    /// Its parameters are not TOML.
    #[error("skill {skill}: parameters do not parse: {source}")]
    Parameters {
        /// Name of the skill.
        skill: String,
        /// What the parser says.
        source: Box<toml::de::Error>,
    },
    /// It takes position targets, and nothing says how far ahead.
    #[error(
        "skill {skill}: found a plugin that takes position_target, wanted one that takes velocity: without a \
         manifest nothing says how far ahead targets are"
    )]
    Command {
        /// Name of the skill.
        skill: String,
    },
    /// The plugin does not take its parameters or the robot.
    #[error("skill {skill}: {source}")]
    Plugin {
        /// Name of the skill.
        skill: String,
        /// What the plugin says.
        source: PluginError,
    },
}

impl RolledSkill {
    /// Checks that the plugin takes the parameter text and the robot.
    ///
    /// # Errors
    /// As [`SkillRefused`] says.
    pub fn new(
        name: &str,
        library: Arc<PluginLibrary>,
        parameters: &str,
        robot: &RobotModel,
    ) -> Result<Self, SkillRefused> {
        Self::with_policy(name, library, parameters, None, robot)
    }

    /// The same with a policy network, whose contract is the parameter text.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_policy(
        name: &str,
        library: Arc<PluginLibrary>,
        parameters: &str,
        policy: Option<PolicyNetwork>,
        robot: &RobotModel,
    ) -> Result<Self, SkillRefused> {
        if library.description().command != CommandKind::Velocity {
            return Err(SkillRefused::Command { skill: name.to_owned() });
        }
        Self::checked(name, library, parameters, policy, robot)
    }

    fn checked(
        name: &str,
        library: Arc<PluginLibrary>,
        parameters: &str,
        policy: Option<PolicyNetwork>,
        robot: &RobotModel,
    ) -> Result<Self, SkillRefused> {
        let takes_phase = library.description().parameters.iter().any(|one| one.name == PHASE);
        let table = takes_phase.then(|| toml::from_str(parameters)).transpose();
        let table = table.map_err(|source| SkillRefused::Parameters {
            skill: name.to_owned(),
            source: Box::new(source),
        })?;
        let (name, parameters) = (name.to_owned(), parameters.to_owned());
        let skill = Self { name: name.clone(), library, parameters, policy, target: None, table };
        let plugin_error = |source| SkillRefused::Plugin { skill: name, source };
        skill.instance(Some(0.5), robot).map_err(plugin_error)?;
        Ok(skill)
    }

    /// The same of a skill as the registry loads it, with the targets of its manifest where it takes any.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn from_loaded(loaded: &LoadedSkill, robot: &RobotModel) -> Result<Self, SkillRefused> {
        let (library, policy) = (Arc::clone(&loaded.library), loaded.policy.clone());
        let skill = Self::checked(&loaded.manifest.name, library, &loaded.parameters, policy, robot)?;
        Ok(Self { target: TargetRule::of(&loaded.manifest), ..skill })
    }

    /// What the plugin says of itself.
    pub fn description(&self) -> &Description {
        self.library.description()
    }

    /// The plugin.
    pub fn library(&self) -> &Arc<PluginLibrary> {
        &self.library
    }

    /// The parameter text, without a phase.
    pub fn parameters(&self) -> &str {
        &self.parameters
    }

    /// The policy network, where it has one.
    pub fn policy(&self) -> Option<&PolicyNetwork> {
        self.policy.as_ref()
    }

    /// How its position targets are set; none of a skill that follows velocities.
    pub fn target(&self) -> Option<TargetRule> {
        self.target
    }

    /// A fresh instance that starts at `phase` of its cycle, if the plugin offers that.
    ///
    /// # Errors
    /// What the plugin reports.
    pub fn instance(&self, phase: Option<f32>, robot: &RobotModel) -> Result<PluginInstance, PluginError> {
        let policy = self.policy.as_ref();
        match (phase, &self.table) {
            (Some(phase), Some(table)) => {
                let mut parameters = table.clone();
                parameters.insert(PHASE.to_owned(), toml::Value::Float(f64::from(phase)));
                self.library.create_with(&parameters.to_string(), &robot.description, policy)
            }
            _ => self.library.create_with(&self.parameters, &robot.description, policy),
        }
    }
}
