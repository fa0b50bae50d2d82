//! `vocaloco skills new` writes a plugin that compiles, passes its own contract test, loads into the
//! host, and lacks nothing but trained predictors; it overwrites nothing.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use vocaloco_tests::{Fixture, plugin_folder, snapshot};

fn vocaloco(root: &Path, arguments: &[&str]) -> Output {
    let program = plugin_folder().join(format!("vocaloco{}", std::env::consts::EXE_SUFFIX));
    Command::new(program)
        .args(["skills"])
        .args(arguments)
        .env("VOCALOCO_ROOT", root)
        .env("VOCALOCO_PLUGIN_PATH", plugin_folder())
        .output()
        .expect("vocaloco runs")
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn it_builds_passes_and_lacks_only_its_predictors() {
    let fixture = Fixture::workspace();
    let root = fixture.root();
    let before = snapshot(root);
    let output = vocaloco(root, &["new", "side_step"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(stdout(&output).contains("plugins/side_step/src/lib.rs"), "{}", stdout(&output));
    let after = snapshot(root);
    let changed: Vec<_> = before.iter().filter(|(path, bytes)| after.get(*path) != Some(*bytes)).collect();
    assert!(
        changed.len() == 1 && changed[0].0 == &root.join("Cargo.toml"),
        "new files and a member: {changed:?}"
    );

    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let run = |arguments: &[&str]| {
        let mut command = Command::new(&cargo);
        command.args(arguments).args(["--offline", "--package", "vocaloco-side-step"]).current_dir(root);
        // The interface is compiled anew at its new place; what it depends on is not.
        let target = plugin_folder().parent().expect("the target folder");
        let output = command.env("CARGO_TARGET_DIR", target).output().expect("cargo runs");
        let text = stdout(&output) + &String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{text}");
        text
    };
    let text = run(&["test"]);
    assert!(text.contains("4 passed"), "the contract test ran: {text}");
    run(&["build"]);

    let output = vocaloco(root, &["check", "--json"]);
    assert_eq!(output.status.code(), Some(1), "it has no predictors yet");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON alone on stdout");
    let findings: Vec<&str> = report["skills"][0]["findings"]
        .as_array()
        .expect("findings")
        .iter()
        .filter_map(serde_json::Value::as_str)
        .collect();
    assert_eq!(report["skills"][0]["name"], "side_step");
    assert_eq!(findings.len(), 2, "{findings:?}");
    assert!(findings[0].contains("models.viability") && findings[1].contains("models.cot"), "{findings:?}");

    let manifest = fs::read(root.join("manifests/skills/side_step.toml")).expect("a manifest");
    let again = vocaloco(root, &["new", "side_step"]);
    assert_eq!(again.status.code(), Some(2));
    assert_eq!(fs::read(root.join("manifests/skills/side_step.toml")).expect("the manifest"), manifest);
}

#[test]
fn a_bad_name_writes_nothing() {
    let fixture = Fixture::workspace();
    for name in ["SideStep", "side-step", "../side", "fn", "api", "", "1step"] {
        let output = vocaloco(fixture.root(), &["new", "--", name]);
        assert_eq!(output.status.code(), Some(2), "{name:?}");
        let line = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(line.contains("NAME") && line.trim().lines().count() == 1, "{name:?}: {line}");
    }
    assert!(!fixture.root().join("manifests/skills").exists());
    assert!(!fixture.root().join("skills").exists());
}

#[test]
fn the_list_tells_what_is_there() {
    let fixture = Fixture::new();
    fixture.add_skill("sound", "none", 0.97, 0.3);
    fixture.add_skill("broken", "none", 0.97, 0.3);
    fixture.alter("manifests/skills/broken.toml", "schema = 1", "schema = 3");
    fs::remove_file(fixture.root().join("skills/sound/cot.onnx")).expect("removed");
    let output = vocaloco(fixture.root(), &["list", "--json"]);
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON alone on stdout");
    assert_eq!(report["skills"][0]["name"], "broken");
    assert!(report["skills"][0]["error"].as_str().is_some_and(|error| error.contains("schema")), "{report}");
    let sound = &report["skills"][1];
    assert_eq!((&sound["plugin"], &sound["viability_threshold"]), (&"faulty".into(), &0.9.into()));
    assert_eq!((&sound["models"]["viability"], &sound["models"]["cot"]), (&true.into(), &false.into()));
    let table = stdout(&vocaloco(fixture.root(), &["list"]));
    assert!(table.contains("sound") && table.contains("no cot") && table.contains("broken"), "{table}");
}
