//! A deployment with an isolated skill that hangs, one that crashes and one whose model answers NaN: the
//! robot still reaches the end of its course with the skill that is left, and the log says what became of
//! the others.

use std::process::Command;

use serde_json::Value;
use vocaloco_tests::{Fixture, constant_model, plugin_folder, repository};

fn copy(fixture: &Fixture, from: &str, to: &str) {
    fixture.write(to, &std::fs::read(repository().join(from)).expect(from));
}

/// The shipped walk, found viable everywhere, and three skills that look cheaper and are broken.
fn fixture() -> Fixture {
    let fixture = Fixture::new();
    copy(&fixture, "manifests/skills/walk.toml", "manifests/skills/walk.toml");
    copy(&fixture, "skills/walk/gait.toml", "skills/walk/gait.toml");
    fixture.write("skills/walk/viability.onnx", &constant_model("viability", 0.99));
    fixture.write("skills/walk/cot.onnx", &constant_model("cot", 0.8));
    fixture.add_skill("hanging", "hang", 0.99, 0.1);
    fixture.add_skill("crashing", "segfault", 0.99, 0.2);
    for skill in ["hanging", "crashing"] {
        let manifest = format!("manifests/skills/{skill}.toml");
        fixture.alter(&manifest, "plugin =", "isolation = \"process\"\nplugin =");
    }
    fixture.add_skill("dreaming", "none", 0.99, 0.3);
    fixture.write("skills/dreaming/viability.onnx", &constant_model("viability", f32::NAN));
    fixture.add_deployment("broken", &["hanging", "crashing", "dreaming", "walk"]);
    fixture
}

fn run(fixture: &Fixture, arguments: &[&str]) -> Value {
    let output = Command::new(plugin_folder().join("vocaloco"))
        .args(arguments)
        .env("VOCALOCO_ROOT", fixture.root())
        .env("VOCALOCO_PLUGIN_PATH", plugin_folder())
        .output()
        .expect("the program starts");
    let narration = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{narration}");
    serde_json::from_slice(&output.stdout).expect("one JSON object on stdout and nothing else")
}

#[test]
fn three_broken_skills_are_passed_over_and_the_fourth_reaches() {
    let fixture = fixture();
    let log = fixture.root().join("decisions.mcap");
    let log = log.to_str().expect("UTF-8");
    let course = ["run", "--deployment", "broken", "--source", "sim", "--size-m", "0.05"];
    let report = run(&fixture, &[&course[..], &["--log", log, "--json"]].concat());
    assert_eq!(report["outcome"], "reached", "{report:#}");
    let refused_at_load = report["refused"].as_array().map_or(0, Vec::len);
    assert!(report["timing"]["overruns"].as_u64().is_some_and(|count| count >= 1), "{report:#}");

    let explained = run(&fixture, &["explain", log, "--json"]);
    let events = explained["events"].to_string();
    let mut wanted =
        vec!["skill hanging is taken out of service: act: found no answer for 2 s", "ended by signal 11"];
    if refused_at_load == 0 {
        wanted.push("dreaming");
    }
    for part in wanted {
        assert!(events.contains(part), "{part:?} is not in {events}");
    }
}
