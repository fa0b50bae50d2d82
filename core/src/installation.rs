//! Where an installation keeps its manifests, skills and plugins.

use std::io;
use std::path::{Path, PathBuf};

/// Where manifests, skills and plugins are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Installation {
    /// The folder that holds `manifests/` and `skills/`.
    pub root: PathBuf,
    /// Folders searched for plugins, in order.
    pub plugin_path: Vec<PathBuf>,
}

/// Why there is no installation to work with.
#[derive(Debug, thiserror::Error)]
pub enum InstallationError {
    /// Neither the working folder nor one above it has manifests.
    #[error("{}: found no manifests/ here or above, wanted a folder with manifests/ (or VOCALOCO_ROOT)", .0.display())]
    NoRoot(PathBuf),
    /// `VOCALOCO_ROOT` leads nowhere.
    #[error("VOCALOCO_ROOT: found {}, wanted a folder that holds manifests/", .0.display())]
    BadRoot(PathBuf),
    /// The system would not say where we are.
    #[error("working folder and program: {0}")]
    Io(#[from] io::Error),
}

impl Installation {
    /// The installation of this process.
    ///
    /// The root is `VOCALOCO_ROOT`, else the nearest folder from the working folder upward with
    /// `manifests/`; the plugin path is `VOCALOCO_PLUGIN_PATH` (separated as `PATH` is), else the folder
    /// of this program and, when that is cargo's `deps`, the folder above.
    ///
    /// # Errors
    /// There is no such root.
    pub fn find() -> Result<Self, InstallationError> {
        Ok(Self { root: find_root()?, plugin_path: find_plugin_path()? })
    }

    /// The manifest of a skill.
    pub fn skill_file(&self, name: &str) -> PathBuf {
        self.root.join(format!("manifests/skills/{name}.toml"))
    }

    /// The folder of a skill's models.
    pub fn skill_folder(&self, name: &str) -> PathBuf {
        self.root.join("skills").join(name)
    }

    /// Folders searched for a skill's plugin, in order: its own, where a bundle puts it, then the rest.
    pub fn plugin_path_of(&self, skill: &str) -> Vec<PathBuf> {
        std::iter::once(self.skill_folder(skill)).chain(self.plugin_path.iter().cloned()).collect()
    }

    /// The manifest of a deployment.
    pub fn deployment_file(&self, name: &str) -> PathBuf {
        self.root.join(format!("manifests/deployments/{name}.toml"))
    }

    /// The folder of robots.
    pub fn robots_folder(&self) -> PathBuf {
        self.root.join("manifests/robots")
    }

    /// Names of all skills that have a manifest, sorted.
    ///
    /// # Errors
    /// The folder cannot be read; a missing one holds nothing.
    pub fn skill_names(&self) -> io::Result<Vec<String>> {
        stems(&self.root.join("manifests/skills"))
    }

    /// Names of all deployments, sorted.
    ///
    /// # Errors
    /// The folder cannot be read; a missing one holds nothing.
    pub fn deployment_names(&self) -> io::Result<Vec<String>> {
        stems(&self.root.join("manifests/deployments"))
    }

    /// Names of all robots, sorted.
    ///
    /// # Errors
    /// The folder cannot be read; a missing one holds nothing.
    pub fn robot_names(&self) -> io::Result<Vec<String>> {
        stems(&self.robots_folder())
    }
}

fn find_root() -> Result<PathBuf, InstallationError> {
    if let Some(root) = std::env::var_os("VOCALOCO_ROOT") {
        let root = PathBuf::from(root);
        return if has_manifests(&root) { Ok(root) } else { Err(InstallationError::BadRoot(root)) };
    }
    let here = std::env::current_dir()?;
    let root = here.ancestors().find(|folder| has_manifests(folder)).map(Path::to_owned);
    root.ok_or(InstallationError::NoRoot(here))
}

fn has_manifests(folder: &Path) -> bool {
    folder.join("manifests").is_dir()
}

fn find_plugin_path() -> io::Result<Vec<PathBuf>> {
    if let Some(path) = std::env::var_os("VOCALOCO_PLUGIN_PATH") {
        return Ok(std::env::split_paths(&path).collect());
    }
    let program = std::env::current_exe()?;
    let folder = program.parent().unwrap_or(Path::new("."));
    let mut path = vec![folder.to_owned()];
    if folder.ends_with("deps") {
        path.extend(folder.parent().map(Path::to_owned));
    }
    Ok(path)
}

fn stems(folder: &Path) -> io::Result<Vec<String>> {
    let entries = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let mut names = Vec::new();
    for entry in entries {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            names.extend(path.file_stem().map(|stem| stem.to_string_lossy().into_owned()));
        }
    }
    names.sort();
    Ok(names)
}
