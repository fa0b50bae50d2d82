//! `bench --json` has the fields that other programs read, and every figure is a positive number.

use std::path::Path;
use std::process::Command;
use std::sync::LazyLock;

use serde_json::Value;
use vocaloco_tests::{plugin_folder, repository};

/// What `vocaloco bench … --json` prints.
fn bench(arguments: &[&str]) -> Value {
    static LEARNING: LazyLock<()> = LazyLock::new(|| {
        vocaloco_dev::build_plugins(&[], &["vocaloco-train"]).expect("vocaloco-train builds");
    });
    LazyLock::force(&LEARNING);
    let output = Command::new(plugin_folder().join("vocaloco"))
        .arg("bench")
        .args(arguments)
        .arg("--json")
        .env("VOCALOCO_ROOT", repository())
        .env("VOCALOCO_PLUGIN_PATH", plugin_folder())
        .output()
        .expect("the program starts");
    let narration = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {narration}");
    serde_json::from_slice(&output.stdout).expect("one JSON object and nothing else on stdout")
}

/// Whether each of these is a positive number.
fn assert_positive(report: &Value, pointers: &[&str]) {
    for pointer in pointers {
        let figure = report.pointer(pointer).and_then(Value::as_f64);
        assert!(figure.is_some_and(|figure| figure > 0.0 && figure.is_finite()), "{pointer} in {report:#}");
    }
}

#[test]
fn a_tick_of_more_skills_than_are_shipped_is_timed_and_a_skill_drives() {
    let report = bench(&["tick", "--skills", "5", "--ticks", "50", "--python", "/nowhere/python3"]);
    assert_eq!((&report["skills"], &report["ticks"]), (&5.into(), &50.into()), "{report:#}");
    assert_positive(&report, &["/p50_us", "/p99_us", "/max_us", "/driven_share"]);
    assert_positive(&report, &["/parts/networks_p50_us", "/parts/known_terrain_p50_us"]);
    assert_positive(&report, &["/real_time/p50_us", "/real_time/added_p50_us"]);
    if cfg!(target_os = "linux") {
        assert_positive(&report, &["/isolated/p50_us", "/isolated/added_p50_us"]);
    }
    let figure = |name: &str| report[name].as_f64().expect(name);
    assert!(figure("p50_us") <= figure("p99_us") && figure("p99_us") <= figure("max_us"), "{report:#}");
    assert!(report["backend"].is_string(), "{report:#}");
    assert_eq!(report["networks"], serde_json::json!({ "own forward": 10 }), "{report:#}");
    assert_eq!(report.get("peer"), Some(&Value::Null), "{report:#}");
}

#[test]
fn a_tick_allocates_nothing() {
    let report = bench(&["tick", "--ticks", "300", "--python", "/nowhere/python3"]);
    assert_eq!(report["allocations_per_tick"].as_f64(), Some(0.0), "{report:#}");
}

#[test]
#[cfg_attr(not(feature = "peers"), ignore = "needs python3 with the packages numpy and onnxruntime")]
fn onnxruntime_answers_as_the_tick_s_networks_do_and_takes_longer_than_the_whole_tick() {
    let report = bench(&["tick", "--ticks", "300"]);
    assert_positive(&report, &["/peer/p50_us"]);
    let figure = |pointer: &str| report.pointer(pointer).and_then(Value::as_f64).expect(pointer);
    assert!(figure("/peer/largest_difference") <= 1e-4, "{report:#}");
    assert!(figure("/p50_us") < figure("/peer/p50_us"), "{report:#}");
}

#[test]
fn a_soak_misses_no_decision_repeats_all_of_them_and_meets_faults_of_every_source() {
    let soak = || bench(&["soak", "--ticks", "10000", "--seed", "3"]);
    let (report, again) = (soak(), soak());
    for same in ["fingerprint", "faults", "skills_added", "skills_removed", "switches", "driven_share"] {
        assert_eq!(report[same], again[same], "{same}: {report:#}, {again:#}");
    }
    assert_eq!(report["ticks"], 10_000, "{report:#}");
    for nothing in ["missed", "replay_differs", "unanswered", "unsound_targets"] {
        assert_eq!(report[nothing], 0, "{nothing}: {report:#}");
    }
    assert!(report["rss_growth"].is_f64() && report["judges_growth"] == false, "{report:#}");
    assert_positive(
        &report,
        &["/skills_added", "/skills_removed", "/switches", "/driven_share", "/ticks_per_s"],
    );
    let faults = report["faults"].as_object().expect("faults by kind");
    for source in ["terrain: ", "measurement: ", "prediction: ", "plugin: "] {
        assert!(faults.keys().any(|kind| kind.starts_with(source)), "{source}: {report:#}");
    }
    assert!(
        faults.keys().any(|kind| kind.ends_with("in its process")),
        "an isolated plugin failed: {report:#}"
    );
    assert!(!faults.contains_key("plugin: other"), "{report:#}");
    assert!(report["rss_mib"].as_array().is_some_and(|curve| curve.len() >= 8), "{report:#}");
}

#[test]
fn a_skill_that_comes_and_goes_while_the_loop_drives_is_timed_and_ends_in_the_stand() {
    let report = bench(&["hot-add", "--seconds", "0.5"]);
    assert_eq!((&report["skill"], &report["then_drives"]), (&"walk".into(), &"stand".into()), "{report:#}");
    let phases = ["/quiet", "/adding", "/removing"];
    let figures = phases
        .iter()
        .flat_map(|phase| ["ticks", "p50_us", "p99_us", "max_us"].map(|it| format!("{phase}/{it}")));
    let figures: Vec<String> =
        figures.chain(["/takes_part_after_s", "/swap_us/0", "/swap_us/1"].map(str::to_owned)).collect();
    assert_positive(&report, &figures.iter().map(String::as_str).collect::<Vec<_>>());
    // A second on a machine that has time for it; tests share theirs.
    let after = |name: &str| report[name].as_f64().expect(name);
    assert!(
        after("takes_part_after_s") < after("drives_after_s") && after("drives_after_s") < 30.0,
        "{report:#}"
    );
    assert!((0.0..30.0).contains(&after("gone_after_s")), "{report:#}");
    // Loading a skill takes longer than that, and is no part of a tick.
    for tick in report["swap_us"].as_array().expect("two ticks") {
        assert!(tick.as_f64().is_some_and(|us| us < 1e5), "{report:#}");
    }
}

#[test]
fn rollouts_are_timed_on_either_plant_and_a_peer_that_is_not_there_is_null() {
    for plant in ["reference", "fast"] {
        let python = ["--python", "/nowhere/python3"];
        let report = bench(
            &[&["rollouts", "--samples", "2", "--threads", "2", "--plant", plant], &python[..]].concat(),
        );
        assert_eq!((&report["threads"], &report["rollouts"]), (&2.into(), &2.into()), "{report:#}");
        assert_eq!(report["plant"], plant);
        assert_positive(&report, &["/rollouts_per_s", "/physics_steps_per_s", "/us_per_step"]);
        assert_eq!(report.get("peer"), Some(&Value::Null), "{report:#}");
        // One second of settling and at least the ticks of a stumble.
        let steps = report["physics_steps_per_s"].as_f64().unwrap() * report["wall_s"].as_f64().unwrap();
        assert!((2.0 * 200.0..2.0 * 100.0 * 1000.0).contains(&steps), "{steps} steps in {report:#}");
    }
}

#[test]
#[cfg_attr(not(feature = "peers"), ignore = "needs python3 with the package mujoco")]
fn mujoco_is_timed_in_the_same_run() {
    let report = bench(&["rollouts", "--samples", "1"]);
    assert_positive(&report, &["/peer/us_per_step"]);
    assert!(report["peer"]["name"].as_str().is_some_and(|name| name.starts_with("mujoco ")), "{report:#}");
}

#[test]
fn policy_steps_are_timed_with_the_shipped_configuration() {
    let configured = repository().join("skills/walk_network/training.toml");
    assert!(Path::new(&configured).is_file(), "the default of --skill is shipped");
    let report = bench(&["policy", "--environments", "2", "--iterations", "1", "--threads", "1"]);
    assert_eq!((&report["environments"], &report["threads"]), (&2.into(), &1.into()), "{report:#}");
    let steps = ["physics", "environment", "learning"];
    let pointers: Vec<String> = steps.iter().map(|name| format!("/policy_steps_per_s/{name}")).collect();
    assert_positive(&report, &pointers.iter().map(String::as_str).collect::<Vec<_>>());
    assert_positive(&report, &["/learn_share"]);
    // The shipped configuration pulls towards no expert.
    assert!(report["policy_steps_per_s"]["learning_with_expert"].is_null(), "{report:#}");
    assert!(report["command"].as_str().is_some_and(|command| command.starts_with("vocaloco bench policy")));
}
