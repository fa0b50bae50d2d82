//! The layers of ARCHITECTURE.md, read from `cargo metadata` and `cargo tree`: who may depend on whom,
//! and what must not be reachable from where.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

use serde_json::Value;

/// Our crates that each of our crates may depend on. Plugins: `plugins/api` alone.
const EDGES: [(&str, &[&str]); 6] = [
    ("vocaloco-plugin-api", &[]),
    ("vocaloco-core", &["vocaloco-plugin-api"]),
    ("vocaloco-sim", &["vocaloco-core", "vocaloco-plugin-api"]),
    ("vocaloco-train", &["vocaloco-core", "vocaloco-plugin-api", "vocaloco-sim"]),
    ("vocaloco", &["vocaloco-core", "vocaloco-plugin-api", "vocaloco-sim"]),
    (
        "vocaloco-tests",
        &["vocaloco", "vocaloco-core", "vocaloco-plugin-api", "vocaloco-sim", "vocaloco-train"],
    ),
];

/// Crates that learn or optimise: `train` alone may have them.
const LEARNING: [&str; 8] = ["burn", "candle", "tch", "dfdx", "linfa", "smartcore", "cmaes", "argmin"];

struct Package {
    /// Folder below the repository, `core` or `plugins/gait`.
    folder: String,
    /// What it depends on in a build; dev-dependencies are no edge.
    dependencies: BTreeSet<String>,
}

fn cargo(arguments: &[&str]) -> String {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args(arguments)
        .current_dir(vocaloco_tests::repository())
        .output()
        .expect("cargo starts");
    assert!(output.status.success(), "cargo {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("cargo speaks UTF-8")
}

fn workspace() -> BTreeMap<String, Package> {
    let text = cargo(&["metadata", "--no-deps", "--locked", "--format-version", "1"]);
    let metadata: Value = serde_json::from_str(&text).expect("cargo metadata is JSON");
    let root = metadata["workspace_root"].as_str().expect("a root").to_owned() + "/";
    let package = |package: &Value| {
        let manifest = package["manifest_path"].as_str().expect("a manifest");
        let folder = manifest.strip_prefix(&root).and_then(|path| path.strip_suffix("/Cargo.toml"));
        let dependencies = package["dependencies"].as_array().expect("dependencies").iter();
        let built = dependencies.filter(|dependency| dependency["kind"] != "dev");
        Package {
            folder: folder.expect("a folder of the workspace").to_owned(),
            dependencies: built.map(|it| it["name"].as_str().expect("a name").to_owned()).collect(),
        }
    };
    let packages = metadata["packages"].as_array().expect("packages").iter();
    packages.map(|it| (it["name"].as_str().expect("a name").to_owned(), package(it))).collect()
}

/// Names of all crates that a build of `package` reaches.
fn reached(package: &str, more: &[&str]) -> BTreeSet<String> {
    let mut arguments =
        vec!["tree", "--locked", "--package", package, "-e", "normal,build", "--prefix", "none"];
    arguments.extend(["--format", "{p}"]);
    arguments.extend(more);
    let names = cargo(&arguments);
    names.lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect()
}

fn is_physics(name: &str) -> bool {
    ["rapier", "parry", "mujoco", "physx"].iter().any(|engine| name.starts_with(engine))
}

/// ONNX runtimes; `tract-onnx` is one too, but also what writes the files.
fn is_runtime(name: &str) -> bool {
    name == "ort" || name.starts_with("ort-") || name.starts_with("tract")
}

#[test]
fn our_crates_depend_downwards_only() {
    let packages = workspace();
    for (name, package) in &packages {
        let listed = EDGES.iter().find(|(of, _)| of == name).map(|(_, allowed)| *allowed);
        let allowed = listed.unwrap_or_else(|| {
            let is_plugin =
                package.folder.starts_with("plugins/") || package.folder.starts_with("tests/plugins/");
            assert!(is_plugin, "{}: a crate outside the layers; add it to EDGES", package.folder);
            &["vocaloco-plugin-api"]
        });
        for dependency in package.dependencies.iter().filter(|name| packages.contains_key(*name)) {
            assert!(allowed.contains(&dependency.as_str()), "{name} depends on {dependency}");
        }
    }
    for (name, _) in EDGES {
        assert!(packages.contains_key(name), "{name} is gone: take it out of EDGES");
    }
}

#[test]
fn core_and_plugins_reach_no_physics_engine() {
    let plugins = workspace().into_iter().filter(|(_, it)| it.folder.starts_with("plugins/"));
    for package in plugins.map(|(name, _)| name).chain(["vocaloco-core".to_owned()]) {
        let physics: Vec<String> = reached(&package, &[]).into_iter().filter(|it| is_physics(it)).collect();
        assert!(physics.is_empty(), "{package} reaches {physics:?}");
    }
}

#[test]
fn a_robots_build_has_no_simulator_and_the_default_one_has() {
    let without = reached("vocaloco", &["--no-default-features"]);
    assert!(!without.iter().any(|name| is_physics(name)), "{without:?}");
    assert!(!without.contains("vocaloco-sim"), "{without:?}");
    // The same look at the default build finds the engine: the look works.
    assert!(reached("vocaloco", &[]).contains("rapier3d"));
}

#[test]
fn only_core_has_an_onnx_runtime() {
    for (name, package) in workspace() {
        if name == "vocaloco-core" {
            continue;
        }
        // `train` writes ONNX files, and the tests write some to be refused.
        let writes = ["vocaloco-train", "vocaloco-tests"].contains(&name.as_str());
        let runtimes = package.dependencies.iter().filter(|it| is_runtime(it));
        let refused: Vec<_> = runtimes.filter(|it| !(writes && *it == "tract-onnx")).collect();
        assert!(refused.is_empty(), "{name} depends on {refused:?}");
    }
    for (name, _) in workspace().iter().filter(|(_, it)| it.folder.starts_with("plugins/")) {
        let runtimes: Vec<String> = reached(name, &[]).into_iter().filter(|it| is_runtime(it)).collect();
        assert!(runtimes.is_empty(), "{name} reaches {runtimes:?}");
    }
}

#[test]
fn learning_stays_out_of_what_people_and_robots_run() {
    let reached = reached("vocaloco", &[]);
    let is_learning = |name: &&String| {
        LEARNING.iter().any(|it| *it == name.as_str() || name.starts_with(&format!("{it}-")))
    };
    let learning: Vec<&String> = reached.iter().filter(is_learning).collect();
    assert!(learning.is_empty() && !reached.contains("vocaloco-train"), "vocaloco reaches {learning:?}");
}
