//! A throw-away installation: the shipped robots, and skills as a test writes them.

use std::fs;
use std::path::{Path, PathBuf};

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
