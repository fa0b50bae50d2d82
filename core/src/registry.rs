//! Skills and deployments, loaded: manifest, plugin, parameters and predictors, checked against the
//! robot and against each other.
//!
//! A skill that is not sound is refused with its findings and the others go on; knowing no skill by
//! name, this is all that the runtime, the simulator and the command line see of the files.

mod examine;

use std::path::Path;
use std::sync::Arc;

use vocaloco_plugin_api::{Needs, RobotDescription};

#[cfg(target_os = "linux")]
use crate::heightfield::{COLUMNS, Heightfield, ROWS};
use crate::installation::Installation;
use crate::lock::{Intake, Lock};
use crate::manifest::{Deployment, Finding, MAX_BYTES, SkillManifest, is_snake_case};
use crate::plugin::{PluginError, PluginInstance, PluginLibrary, repeats};
use crate::policy::PolicyNetwork;
use crate::predictor::Predictor;
use crate::robot::{RobotError, RobotModel};
use examine::examine;

/// A sound skill, ready to make instances.
#[derive(Debug)]
pub struct LoadedSkill {
    /// Its manifest, with the deployment's viability threshold where that names one.
    pub manifest: SkillManifest,
    /// The deployment's threshold for it while it drives; none is its viability threshold.
    pub hold_threshold: Option<f32>,
    /// Its plugin.
    pub library: Arc<PluginLibrary>,
    /// The text that its instances are made from: its parameter file, or the contract of its policy.
    pub parameters: String,
    /// What its instances read each tick.
    pub needs: Needs,
    /// Its policy network, where its manifest names one.
    pub policy: Option<PolicyNetwork>,
    /// Its viability predictor; always there when models were required.
    pub viability: Option<Predictor>,
    /// Its predictor of cost of transport; always there when models were required.
    pub cot: Option<Predictor>,
}

impl LoadedSkill {
    /// A new controller of this skill.
    ///
    /// # Errors
    /// As [`PluginLibrary::create`]; `robot` is the one the skill was loaded for, so only a plugin
    /// that breaks its contract errs here.
    pub fn create(&self, robot: &RobotDescription) -> Result<PluginInstance, PluginError> {
        self.library.create_with(&self.parameters, robot, self.policy.as_ref())
    }
}

/// Whether a skill may lack its predictors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelPolicy {
    /// To be chosen from: both must be there.
    Required,
    /// To be rolled out: what is there must be sound.
    Optional,
}

/// A skill that was not taken, and the first reason.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("skill {skill} is refused: {finding}")]
pub struct Refusal {
    /// Name of the skill.
    pub skill: String,
    /// What is wrong with it.
    pub finding: Finding,
}

impl Refusal {
    pub(crate) fn of(installation: &Installation, skill: &str, finding: Finding) -> Self {
        Self { skill: skill.to_owned(), finding: finding.relative_to(&installation.root) }
    }
}

/// A deployment and those of its skills that are sound, in its order.
#[derive(Debug)]
pub struct LoadedDeployment {
    /// The manifest.
    pub deployment: Deployment,
    /// The robot.
    pub robot: Arc<RobotModel>,
    /// The sound skills; at least one.
    pub skills: Vec<LoadedSkill>,
    /// The others.
    pub refused: Vec<Refusal>,
}

/// Why a deployment cannot run at all.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// Its manifest is not sound.
    #[error("{0}")]
    Deployment(Finding),
    /// Its robot is not sound.
    #[error("{0}")]
    Robot(#[from] RobotError),
    /// Its lock is missing, lacks a signature that is demanded, or cannot be made.
    #[error("{0}")]
    Lock(Finding),
    /// A skill is not sound, so nothing is locked.
    #[error("{0}")]
    Unsound(Refusal),
    /// Every skill was refused.
    #[error("deployment {deployment}: found no sound skill, wanted at least one: {}", lines(.refused))]
    NoSkillLeft {
        /// Name of the deployment.
        deployment: String,
        /// Why each was refused.
        refused: Vec<Refusal>,
    },
}

fn lines(refused: &[Refusal]) -> String {
    refused.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// Loads a deployment, its robot and those of its skills that are sound.
///
/// # Errors
/// The deployment or its robot is not sound, or no skill is.
pub fn load_deployment(installation: &Installation, name: &str) -> Result<LoadedDeployment, LoadError> {
    load(installation, name, &Intake::open(&installation.root), |_| Ok(()))
}

/// As [`load_deployment`], taking no byte but those of `lock`, which one of the deployment's trusted
/// keys has signed where it names any.
///
/// # Errors
/// As [`load_deployment`]; the deployment, its robot or the signature is not as locked. A skill that
/// is not is refused alone.
pub fn load_locked(
    installation: &Installation,
    name: &str,
    lock: &Lock,
) -> Result<LoadedDeployment, LoadError> {
    load(installation, name, &Intake::locked(&installation.root, lock), |deployment| {
        let signed = lock.check_signature(&deployment.trusted_keys);
        signed.map_err(|finding| LoadError::Lock(finding.relative_to(&installation.root)))
    })
}

/// The lock of a deployment as it is now.
///
/// # Errors
/// As [`load_deployment`], and when one of its skills is not sound.
pub fn lock_deployment(installation: &Installation, name: &str) -> Result<Lock, LoadError> {
    let intake = Intake::recording(&installation.root);
    let mut loaded = load(installation, name, &intake, |_| Ok(()))?;
    if !loaded.refused.is_empty() {
        return Err(LoadError::Unsound(loaded.refused.swap_remove(0)));
    }
    Lock::of(installation, name, intake.into_record()).map_err(LoadError::Lock)
}

fn load(
    installation: &Installation,
    name: &str,
    intake: &Intake<'_>,
    admit: impl FnOnce(&Deployment) -> Result<(), LoadError>,
) -> Result<LoadedDeployment, LoadError> {
    let deployment = deployment_through(installation, name, intake).map_err(LoadError::Deployment)?;
    admit(&deployment)?;
    let read = |path: &Path| {
        let bytes = intake.bytes(path, MAX_BYTES, path, "file");
        bytes.map_err(|finding| RobotError::Refused(finding.relative_to(&installation.root)))
    };
    let robot = Arc::new(RobotModel::load_by(&installation.robots_folder(), &deployment.robot, &read)?);
    let (mut skills, mut refused) = (Vec::new(), Vec::new());
    for skill in &deployment.skills {
        match load_deployed(installation, &deployment, skill, &robot.description, intake) {
            Ok(loaded) => skills.push(loaded),
            Err(refusal) => refused.push(refusal),
        }
    }
    if skills.is_empty() {
        return Err(LoadError::NoSkillLeft { deployment: deployment.name, refused });
    }
    Ok(LoadedDeployment { deployment, robot, skills, refused })
}

/// Loads one skill as `deployment` needs it.
///
/// # Errors
/// The first thing that is wrong with it.
pub(crate) fn load_deployed(
    installation: &Installation,
    deployment: &Deployment,
    skill: &str,
    robot: &RobotDescription,
    intake: &Intake<'_>,
) -> Result<LoadedSkill, Refusal> {
    examine(installation, skill, robot, ModelPolicy::Required, intake)
        .map_err(|findings| first(installation, skill, findings))
        .and_then(|loaded| fits_rate(installation, deployment, loaded))
        .and_then(|loaded| with_thresholds(installation, deployment, loaded))
}

/// Does all that loading a skill does, under `lock` where there is one, and asks its predictors once; what comes of it is
/// dropped. For a process that may end of it.
///
/// # Errors
/// The first thing that is wrong with it; what the predictors answer is not looked at.
#[cfg(target_os = "linux")]
pub(crate) fn try_skill(
    installation: &Installation,
    skill: &str,
    lock: Option<&Lock>,
    robot: &RobotDescription,
) -> Result<(), Finding> {
    let intake = Intake::of(&installation.root, lock);
    let loaded = examine(installation, skill, robot, ModelPolicy::Required, &intake);
    let LoadedSkill { viability, cot, .. } =
        loaded.map_err(|findings| first(installation, skill, findings).finding)?;
    if let Ok(flat) = (Heightfield { cells_m: [[0.0; COLUMNS]; ROWS] }).prepare(None) {
        let _ = [viability, cot].map(|predictor| predictor.map(|mut it| it.predict(&flat).ok()));
    }
    Ok(())
}

/// The skill under the thresholds that the deployment sets for it.
fn with_thresholds(
    installation: &Installation,
    deployment: &Deployment,
    mut loaded: LoadedSkill,
) -> Result<LoadedSkill, Refusal> {
    let skill = &loaded.manifest.name;
    let threshold = &mut loaded.manifest.selection.viability_threshold;
    *threshold = deployment.viability_thresholds.get(skill).copied().unwrap_or(*threshold);
    loaded.hold_threshold = deployment.hold_thresholds.get(skill).copied();
    match loaded.hold_threshold {
        Some(hold) if hold > *threshold => {
            let field = format!("hold_thresholds.{skill}");
            let wanted = format!("at most {threshold}, its viability threshold");
            let finding = Finding::new(&deployment.file, &field, hold, wanted);
            Err(Refusal { skill: skill.clone(), finding: finding.relative_to(&installation.root) })
        }
        _ => Ok(loaded),
    }
}

/// Reads a deployment's manifest alone.
///
/// # Errors
/// There is none of that name, or it is not sound.
pub fn read_deployment(installation: &Installation, name: &str) -> Result<Deployment, Finding> {
    deployment_through(installation, name, &Intake::open(&installation.root))
}

pub(crate) fn deployment_through(
    installation: &Installation,
    name: &str,
    intake: &Intake<'_>,
) -> Result<Deployment, Finding> {
    let file = installation.deployment_file(name);
    named(&file, name, "deployment")
        .and_then(|()| intake.text(&file, MAX_BYTES, &file, "file"))
        .and_then(|text| Deployment::parse(&file, text))
        .map_err(|finding| finding.relative_to(&installation.root))
}

/// Loads one skill for `robot`.
///
/// # Errors
/// The first of [`check_skill`]'s findings.
pub fn load_skill(
    installation: &Installation,
    name: &str,
    robot: &RobotDescription,
    models: ModelPolicy,
) -> Result<LoadedSkill, Refusal> {
    examine(installation, name, robot, models, &Intake::open(&installation.root))
        .map_err(|findings| first(installation, name, findings))
}

fn first(installation: &Installation, skill: &str, mut findings: Vec<Finding>) -> Refusal {
    Refusal::of(installation, skill, findings.swap_remove(0))
}

/// All that is wrong with a skill; nothing when it is sound. A sound one is also driven for a moment, to
/// see whether the same inputs give the same targets.
pub fn check_skill(
    installation: &Installation,
    name: &str,
    robot: &RobotDescription,
    models: ModelPolicy,
) -> Vec<Finding> {
    let findings = match examine(installation, name, robot, models, &Intake::open(&installation.root)) {
        Err(findings) => findings,
        Ok(loaded) => repeats(&loaded, robot).err().into_iter().collect(),
    };
    findings.into_iter().map(|finding| finding.relative_to(&installation.root)).collect()
}

fn repeats(loaded: &LoadedSkill, robot: &RobotDescription) -> Result<(), Finding> {
    let mut instance = loaded.create(robot).map_err(PluginError::into_finding)?;
    repeats::check(loaded.library.file(), &mut instance, robot, &loaded.manifest.command)
}

fn named(file: &Path, name: &str, kind: &str) -> Result<(), Finding> {
    if is_snake_case(name) {
        return Ok(());
    }
    Err(Finding::new(file, "name", format!("{name:?}"), format!("a {kind}'s name in snake_case")))
}

fn fits_rate(
    installation: &Installation,
    deployment: &Deployment,
    skill: LoadedSkill,
) -> Result<LoadedSkill, Refusal> {
    let rate_hz = skill.library.description().rate_hz;
    if (rate_hz - deployment.rate_hz).abs() < 1e-9 {
        return Ok(skill);
    }
    let wanted = format!("{rate_hz}, the rate of plugin {}", skill.manifest.plugin);
    let finding = Finding::new(&deployment.file, "rate_hz", deployment.rate_hz, wanted);
    Err(Refusal { skill: skill.manifest.name, finding: finding.relative_to(&installation.root) })
}
