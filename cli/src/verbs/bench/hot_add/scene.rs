//! A temporary installation in which a deployment lacks a skill, and what changes that.

use std::path::Path;
use std::process::Command;
use std::sync::mpsc::{Receiver, channel};

use anyhow::{Context, ensure};
use tempfile::TempDir;
use vocaloco_core::bundle;
use vocaloco_core::installation::Installation;
use vocaloco_core::manifest::{Deployment, SkillManifest};
use vocaloco_core::registry::read_deployment;
use vocaloco_core::runtime::give_way;

use crate::verbs::run::pace::clock;

/// A temporary installation in which the deployment lacks the skill, and what changes that.
pub(super) struct Scene {
    _folder: TempDir,
    pub(super) installation: Installation,
    pub(super) deployment: String,
    /// The skill's bundle.
    pub(super) bundle: String,
    /// The deployment's file with the skill in it.
    pub(super) with: String,
}

impl Scene {
    pub(super) fn set(source: &Installation, deployment: &str, skill: &str) -> anyhow::Result<Self> {
        let found = read_deployment(source, deployment)?;
        let others: Vec<String> = found.skills.iter().filter(|name| *name != skill).cloned().collect();
        ensure!(
            !others.is_empty(),
            "deployment `{deployment}`: found no skill but {skill}, wanted others to run"
        );
        let folder = tempfile::tempdir()?;
        let installation =
            Installation { root: folder.path().to_owned(), plugin_path: source.plugin_path.clone() };
        copy_folder(&source.robots_folder(), &installation.robots_folder())?;
        for name in &others {
            copy(&source.skill_file(name), &installation.skill_file(name))?;
            for path in SkillManifest::read(&source.skill_file(name))?.models.paths() {
                copy(&source.skill_folder(name).join(path), &installation.skill_folder(name).join(path))?;
            }
        }
        let bundle = folder.path().join("added.skill");
        bundle::pack(source, skill, &bundle, None)?;
        let scene = Self {
            deployment: deployment.to_owned(),
            bundle: bundle.display().to_string(),
            with: text(&found, &[&[skill.to_owned()], others.as_slice()].concat()),
            installation,
            _folder: folder,
        };
        let file = scene.installation.deployment_file(deployment);
        std::fs::create_dir_all(file.parent().context("a folder")?)?;
        std::fs::write(&file, text(&found, &others))?;
        Ok(scene)
    }

    /// Runs this program in another process, then replaces the deployment's file; sends when it was done.
    pub(super) fn change(&self, arguments: &[&str], line: Option<String>) -> Receiver<anyhow::Result<f64>> {
        let (done, receiver) = channel();
        let arguments: Vec<String> = arguments.iter().map(|word| (*word).to_owned()).collect();
        let (root, file) =
            (self.installation.root.clone(), self.installation.deployment_file(&self.deployment));
        let plugin_path = std::env::join_paths(&self.installation.plugin_path);
        std::thread::spawn(move || {
            // A loop that runs at a priority of its own does not lend it to those who install something.
            give_way();
            let change = || {
                let output = Command::new(std::env::current_exe()?)
                    .args(&arguments)
                    .env("VOCALOCO_ROOT", &root)
                    .env("VOCALOCO_PLUGIN_PATH", plugin_path?)
                    .output()?;
                let narration = String::from_utf8_lossy(&output.stderr).into_owned();
                ensure!(output.status.success(), "vocaloco {}: {narration}", arguments.join(" "));
                if let Some(line) = line {
                    let new = root.join("deployment.toml");
                    std::fs::write(&new, line)?;
                    std::fs::rename(&new, &file)?;
                }
                Ok(clock().as_secs_f64())
            };
            // Who no longer waits has said why.
            let _ = done.send(change());
        });
        receiver
    }
}

/// When it was done, once it is.
pub(super) fn ended(change: &Receiver<anyhow::Result<f64>>) -> anyhow::Result<f64> {
    change.recv().context("found no end of the other process, wanted one")?
}

/// The deployment with other skills.
fn text(deployment: &Deployment, skills: &[String]) -> String {
    let Deployment { robot, rate_hz, switch_window, stop_window, resume_window, heightfield, .. } =
        deployment;
    format!(
        "schema = 1\nrobot = {robot:?}\nskills = {skills:?}\nrate_hz = {rate_hz:?}\nswitch_window = {switch_window}\n\
         stop_window = {stop_window}\nresume_window = {resume_window}\n\n[heightfield]\nmax_age_s = {:?}\n",
        heightfield.max_age_s
    )
}

fn copy(from: &Path, to: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(to.parent().context("a folder")?)?;
    std::fs::copy(from, to).with_context(|| from.display().to_string())?;
    Ok(())
}

fn copy_folder(from: &Path, to: &Path) -> anyhow::Result<()> {
    for entry in std::fs::read_dir(from).with_context(|| from.display().to_string())? {
        let entry = entry?;
        if entry.path().is_file() {
            copy(&entry.path(), &to.join(entry.file_name()))?;
        }
    }
    Ok(())
}
