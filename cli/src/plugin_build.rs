//! Builds plugins' libraries into the folder of this program's own profile, where the host looks for
//! them: cargo builds no library that nothing links to. For developers and tests; a robot is given
//! built plugins.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Why plugins could not be built.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// Cargo could not be started, or this program's own place is unknown.
    #[error("{what}: {source}")]
    Io {
        /// What was tried.
        what: String,
        /// What the system says.
        #[source]
        source: std::io::Error,
    },
    /// Cargo ended with an error, which it has printed.
    #[error("{0} failed; cargo's own message is above")]
    Cargo(String),
    /// `cargo metadata` said something unexpected.
    #[error("cargo metadata: {0}")]
    Metadata(String),
}

/// The workspace that this program was built from.
pub fn workspace_root() -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    folder.parent().unwrap_or(folder).to_owned()
}

/// Builds every member of the workspace below one of `places` that makes a library to be loaded, and
/// the packages named in `also`, into the folder of this program's profile, and returns that folder.
///
/// `places` are relative to the workspace, such as `plugins`. Cargo narrates on stderr; stdout stays
/// untouched.
///
/// # Errors
/// Cargo cannot be run, or fails.
pub fn build_plugins(places: &[&str], also: &[&str]) -> Result<PathBuf, BuildError> {
    let program = std::env::current_exe()
        .map_err(|source| BuildError::Io { what: "the path of this program".to_owned(), source })?;
    let folder = program.parent().unwrap_or(Path::new("."));
    let folder = if folder.ends_with("deps") { folder.parent().unwrap_or(folder) } else { folder };
    let profile = match folder.file_name().and_then(|name| name.to_str()) {
        None | Some("debug") => "dev",
        Some(profile) => profile,
    };
    let mut build = cargo();
    build.args(["build", "--profile", profile]);
    if let Some(target_folder) = folder.parent() {
        build.arg("--target-dir").arg(target_folder);
    }
    for package in plugin_packages(places)?.iter().map(String::as_str).chain(also.iter().copied()) {
        build.args(["--package", package]);
    }
    let status =
        build.status().map_err(|source| BuildError::Io { what: "cargo build".to_owned(), source })?;
    if !status.success() {
        return Err(BuildError::Cargo("cargo build of the plugins".to_owned()));
    }
    Ok(folder.to_owned())
}

/// Names of the workspace's packages below `places` that make a library to be loaded.
fn plugin_packages(places: &[&str]) -> Result<Vec<String>, BuildError> {
    let output = cargo()
        .args(["metadata", "--no-deps", "--format-version", "1"])
        .stderr(std::process::Stdio::inherit())
        .output()
        .map_err(|source| BuildError::Io { what: "cargo metadata".to_owned(), source })?;
    if !output.status.success() {
        return Err(BuildError::Cargo("cargo metadata".to_owned()));
    }
    let metadata: Metadata =
        serde_json::from_slice(&output.stdout).map_err(|error| BuildError::Metadata(error.to_string()))?;
    let places: Vec<PathBuf> = places.iter().map(|place| metadata.workspace_root.join(place)).collect();
    let is_plugin = |package: &Package| {
        places.iter().any(|place| package.manifest_path.starts_with(place))
            && package.targets.iter().any(|target| target.crate_types.iter().any(|kind| kind == "cdylib"))
    };
    let packages = metadata.packages.into_iter().filter(is_plugin);
    Ok(packages.map(|package| package.name).collect())
}

fn cargo() -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(workspace_root());
    command
}

#[derive(serde::Deserialize)]
struct Metadata {
    packages: Vec<Package>,
    workspace_root: PathBuf,
}

#[derive(serde::Deserialize)]
struct Package {
    name: String,
    manifest_path: PathBuf,
    targets: Vec<Target>,
}

#[derive(serde::Deserialize)]
struct Target {
    crate_types: Vec<String>,
}
