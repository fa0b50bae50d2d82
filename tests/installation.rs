//! A throw-away installation: the shipped robots, and skills as a test writes them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;
use vocaloco_core::installation::Installation;

use crate::constant_model;

/// A throw-away installation; its files vanish with it.
pub struct Fixture {
    folder: TempDir,
    plugin_path: Vec<PathBuf>,
}

/// A sound manifest of a skill that runs the test plugin `faulty`.
const FAULTY_SKILL: &str = r#"schema = 1
name = "NAME"
summary = "Holds the stand and misbehaves as told"
plugin = "faulty"

[models]
parameters = "fault.txt"
viability = "viability.onnx"
cot = "cot.onnx"

[selection]
viability_threshold = 0.9

[command]
kind = "velocity"
forward_m_per_s = [0.0, 0.7]
"#;

impl Default for Fixture {
    fn default() -> Self {
        Self::new()
    }
}

impl Fixture {
    /// An installation with the shipped robots and plugins and no skills.
    ///
    /// # Panics
    /// When the folder cannot be written.
    pub fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let fixture = Self { folder, plugin_path: vec![crate::plugin_folder().to_owned()] };
        for file in ["anymal_d.xml", "anymal_d.toml"] {
            let path = format!("manifests/robots/{file}");
            fixture.write(&path, &fs::read(crate::repository().join(&path)).expect("the shipped robot"));
        }
        fixture
    }

    /// The same, and a source tree: the repository's workspace with the plugin interface as its only member.
    ///
    /// # Panics
    /// When the sources cannot be read.
    pub fn workspace() -> Self {
        let fixture = Self::new();
        let repository = crate::repository();
        let text = fs::read_to_string(repository.join("Cargo.toml")).expect("the workspace");
        let mut workspace: toml::Table = text.parse().expect("toml");
        let table = workspace["workspace"].as_table_mut().expect("a table");
        table.insert("members".into(), toml::Value::Array(vec!["plugins/api".into()]));
        table.remove("default-members");
        fixture.write("Cargo.toml", workspace.to_string().as_bytes());
        let sources = sources(&repository, "plugins/api/src");
        for path in ["Cargo.lock", "plugins/api/Cargo.toml"].map(str::to_owned).into_iter().chain(sources) {
            fixture.write(&path, &fs::read(repository.join(&path)).expect("a source file"));
        }
        fixture
    }

    /// As `vocaloco-core` takes it.
    pub fn installation(&self) -> Installation {
        Installation { root: self.root().to_owned(), plugin_path: self.plugin_path.clone() }
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        self.folder.path()
    }

    /// Searches `folder` of this installation for plugins first.
    pub fn search_first(&mut self, folder: &str) {
        self.plugin_path.insert(0, self.folder.path().join(folder));
    }

    /// Writes a file, with the folders it needs.
    ///
    /// # Panics
    /// When it cannot be written.
    pub fn write(&self, path: &str, bytes: &[u8]) {
        let path = self.root().join(path);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a writable folder");
        fs::write(path, bytes).expect("a written file");
    }

    /// Adds a sound skill that runs `faulty` with the given parameters and whose predictors answer
    /// the same everywhere.
    pub fn add_skill(&self, name: &str, parameters: &str, viability: f32, cot: f32) {
        self.write(&format!("manifests/skills/{name}.toml"), FAULTY_SKILL.replace("NAME", name).as_bytes());
        self.write(&format!("skills/{name}/fault.txt"), parameters.as_bytes());
        let models = [("viability", viability), ("cot", cot)];
        for (quantity, value) in models {
            let model = constant_model(quantity, value);
            self.write(&format!("skills/{name}/{quantity}.onnx"), &model);
        }
    }

    /// Adds shipped skills as they are, manifest and folder.
    ///
    /// # Panics
    /// When one is not shipped.
    pub fn add_shipped(&self, names: &[&str]) {
        for name in names {
            let folder = format!("skills/{name}");
            let entries = fs::read_dir(crate::repository().join(&folder)).expect("a shipped skill");
            let inside =
                entries.map(|entry| format!("{folder}/{}", entry.expect("an entry").file_name().display()));
            for path in inside.chain([format!("manifests/skills/{name}.toml")]) {
                self.write(&path, &fs::read(crate::repository().join(&path)).expect("a shipped file"));
            }
        }
    }

    /// The program, told to work on this installation.
    pub fn vocaloco(&self, arguments: &[&str]) -> Command {
        let program = crate::plugin_folder().join(format!("vocaloco{}", std::env::consts::EXE_SUFFIX));
        let mut command = Command::new(program);
        command.args(arguments).current_dir(self.root()).env("VOCALOCO_ROOT", self.root());
        command.env("VOCALOCO_PLUGIN_PATH", crate::plugin_folder());
        command
    }

    /// Replaces `from` by `to` in a file.
    ///
    /// # Panics
    /// When `from` is not in it.
    pub fn alter(&self, path: &str, from: &str, to: &str) {
        let text = fs::read_to_string(self.root().join(path)).expect("a text file");
        assert!(text.contains(from), "{from} is in {path}");
        self.write(path, text.replacen(from, to, 1).as_bytes());
    }

    /// Adds a deployment of these skills on the shipped robot.
    pub fn add_deployment(&self, name: &str, skills: &[&str]) {
        let text = format!("schema = 1\nrobot = \"anymal_d\"\nskills = {skills:?}\n");
        self.write(&format!("manifests/deployments/{name}.toml"), text.as_bytes());
    }
}

/// Every file below a folder of the repository, relative to it.
fn sources(repository: &Path, folder: &str) -> Vec<String> {
    let entries = fs::read_dir(repository.join(folder)).expect("a folder");
    let inside = |entry: std::io::Result<fs::DirEntry>| {
        let entry = entry.expect("an entry");
        let path = format!("{folder}/{}", entry.file_name().display());
        if entry.path().is_dir() { sources(repository, &path) } else { vec![path] }
    };
    entries.flat_map(inside).collect()
}
