//! Four skills as bundles, and an installation of their own that they come to and go from.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use tempfile::TempDir;
use toml::{Table, Value};
use vocaloco_core::bundle::{EXTENSION, install, pack, remove};
use vocaloco_core::installation::Installation;

/// Name of the deployment of the four.
pub(super) const DEPLOYMENT: &str = "soak";
/// The plugin that misbehaves as it is told.
const FAULTY: &str = "faulty";
/// Ticks of driving before the first fault; a bundle is tried for fewer before it is installed.
const SOUND_TICKS: u32 = 30;

/// Bundles, and the folder in which they are installed.
pub(super) struct Bundles {
    folder: TempDir,
    installation: Installation,
    names: Vec<String>,
}

impl Bundles {
    /// Packs the first two skills of `deployment` and two that misbehave, with the predictors of the first.
    pub(super) fn pack(source: &Installation, deployment: &str, seed: u64) -> anyhow::Result<Self> {
        let folder = tempfile::tempdir().context("found no temporary folder, wanted one")?;
        let file = source.deployment_file(deployment);
        let mut settings = table(&file)?;
        let skills = settings.get("skills").and_then(Value::as_array).cloned().unwrap_or_default();
        let skills: Vec<String> = skills.iter().filter_map(|it| it.as_str().map(str::to_owned)).collect();
        let [first, second, ..] = skills.as_slice() else {
            anyhow::bail!("{}: skills: found {skills:?}, wanted two or more", file.display());
        };
        let at = |root: &str, plugin_path: &[PathBuf]| Installation {
            root: folder.path().join(root),
            plugin_path: plugin_path.to_vec(),
        };
        // Where the bundles arrive there are no plugins but theirs.
        let [workshop, installation] = [at("workshop", &source.plugin_path), at("installation", &[])];
        for place in [&workshop, &installation] {
            copy_folder(&source.robots_folder(), &place.robots_folder())?;
        }
        let [wild, fragile] = ["wild", "fragile"].map(str::to_owned);
        for (name, isolation) in [(&wild, "none"), (&fragile, "process")] {
            let parameters = format!("{name} {SOUND_TICKS} {seed}");
            write_faulty(source, first, &workshop, name, isolation, &parameters)?;
        }
        let bundles =
            Self { folder, installation, names: vec![first.clone(), second.clone(), wild, fragile] };
        for (name, from) in bundles.names.iter().zip([source, source, &workshop, &workshop]) {
            pack(from, name, &bundles.file(name), None).map_err(anyhow::Error::new).with_context(|| {
                format!("skill {name} as a bundle (`cargo vocaloco bench soak` builds plugin {FAULTY})")
            })?;
        }
        settings.insert("skills".into(), bundles.names.clone().into());
        for thresholds in ["viability_thresholds", "hold_thresholds"] {
            if let Some(of_skills) = settings.get_mut(thresholds).and_then(Value::as_table_mut) {
                of_skills.retain(|skill, _| bundles.names.iter().any(|name| name == skill));
            }
        }
        settings.remove("trusted_keys");
        settings.remove("deadlines");
        write(&bundles.installation.deployment_file(DEPLOYMENT), settings.to_string().as_bytes())?;
        Ok(bundles)
    }

    /// Names of the four skills, in the deployment's order.
    pub(super) fn names(&self) -> &[String] {
        &self.names
    }

    /// The installation.
    pub(super) fn installation(&self) -> &Installation {
        &self.installation
    }

    /// A folder for whatever else is to vanish with the bundles.
    pub(super) fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub(super) fn is_installed(&self, name: &str) -> bool {
        self.installation.skill_file(name).is_file()
    }

    pub(super) fn install(&mut self, index: usize) -> anyhow::Result<()> {
        install(&self.installation, &self.file(&self.names[index]), &[])?;
        Ok(())
    }

    pub(super) fn remove(&mut self, index: usize) -> anyhow::Result<()> {
        Ok(remove(&self.installation, &self.names[index])?)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name).with_extension(EXTENSION)
    }
}

/// The skill `like` under another name, with a plugin that misbehaves as `parameters` say.
fn write_faulty(
    source: &Installation,
    like: &str,
    place: &Installation,
    name: &str,
    isolation: &str,
    parameters: &str,
) -> anyhow::Result<()> {
    let mut manifest = table(&source.skill_file(like))?;
    for (key, value) in [("name", name), ("plugin", FAULTY), ("isolation", isolation)] {
        manifest.insert(key.into(), value.into());
    }
    manifest.remove("contract");
    let models = manifest.get_mut("models").and_then(Value::as_table_mut);
    let models = models.with_context(|| format!("skill {like}: models: found nothing, wanted a table"))?;
    models.remove("policy");
    models.insert("parameters".into(), "fault.txt".into());
    for quantity in ["viability", "cot"] {
        let file = models.get(quantity).and_then(Value::as_str);
        let file =
            file.with_context(|| format!("skill {like}: models.{quantity}: found nothing, wanted a file"))?;
        let from = source.skill_folder(like).join(file);
        let bytes = fs::read(&from).with_context(|| from.display().to_string())?;
        write(&place.skill_folder(name).join(file), &bytes)?;
    }
    write(&place.skill_folder(name).join("fault.txt"), parameters.as_bytes())?;
    write(&place.skill_file(name), manifest.to_string().as_bytes())
}

fn table(file: &Path) -> anyhow::Result<Table> {
    let text = fs::read_to_string(file).with_context(|| file.display().to_string())?;
    text.parse().with_context(|| file.display().to_string())
}

fn write(file: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let written = fs::create_dir_all(file.parent().unwrap_or(file)).and_then(|()| fs::write(file, bytes));
    written.with_context(|| file.display().to_string())
}

fn copy_folder(from: &Path, to: &Path) -> anyhow::Result<()> {
    for entry in fs::read_dir(from).with_context(|| from.display().to_string())? {
        let file = entry?.path();
        if let Some(name) = file.file_name().filter(|_| file.is_file()) {
            write(&to.join(name), &fs::read(&file).with_context(|| file.display().to_string())?)?;
        }
    }
    Ok(())
}
