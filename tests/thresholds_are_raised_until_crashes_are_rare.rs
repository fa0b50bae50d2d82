//! `evaluate promise` raises what a deployment asks of a skill until whole courses keep a promise, and does not drive
//! again what it has driven.

use std::process::{Command, Output};

use serde_json::Value;
use vocaloco_tests::{Fixture, plugin_folder, repository};

/// Walk alone, before steps that topple it, under a threshold that refuses little.
fn fixture() -> Fixture {
    let fixture = Fixture::new();
    let files = [
        "manifests/skills/walk.toml",
        "skills/walk/gait.toml",
        "skills/walk/viability.onnx",
        "skills/walk/cot.onnx",
    ];
    for file in files {
        fixture.write(file, &std::fs::read(repository().join(file)).expect("a shipped file"));
    }
    fixture.add_deployment("alone", &["walk"]);
    fixture.alter(
        "manifests/deployments/alone.toml",
        "robot",
        "viability_thresholds = { walk = 0.6 }\nrobot",
    );
    fixture
}

fn promise(fixture: &Fixture, more: &[&str]) -> Output {
    let store = fixture.root().join("measured");
    Command::new(plugin_folder().join("vocaloco"))
        .args(["evaluate", "promise", "--deployment", "alone", "--course", "stairs_down", "--size-m", "0.3"])
        .args(["--rollouts", "16", "--json", "--store"])
        .arg(store)
        .args(more)
        .env("VOCALOCO_ROOT", fixture.root())
        .env("VOCALOCO_PLUGIN_PATH", plugin_folder())
        .output()
        .expect("the program starts")
}

fn report(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).expect("one JSON object on stdout and nothing else")
}

#[test]
fn a_skill_that_crashes_is_refused_until_it_does_so_no_more() {
    let fixture = fixture();
    let found = promise(&fixture, &["--alpha", "0.5"]);
    assert_eq!(found.status.code(), Some(0), "{}", String::from_utf8_lossy(&found.stderr));
    let rounds = report(&found)["rounds"].as_array().expect("rounds").clone();
    let crashes = |round: &Value| round["crashes"].as_array().expect("crashes").len() as u64;
    let threshold = |round: &Value| round["thresholds"]["walk"].as_f64().expect("a threshold");
    let (first, last) = (&rounds[0], &rounds[rounds.len() - 1]);
    assert!(crashes(first) > first["allowed"].as_u64().expect("a count"), "{first:#}");
    assert!(crashes(last) <= last["allowed"].as_u64().expect("a count"), "{last:#}");
    assert_eq!(last["rollouts"], 16, "{last:#}");
    assert!(rounds.windows(2).all(|pair| threshold(&pair[0]) < threshold(&pair[1])), "{rounds:#?}");
    // None of the rounds drives what another has driven.
    let numbers = |round: &Value| -> Vec<u64> {
        let crashes = round["crashes"].as_array().expect("crashes").iter();
        crashes.map(|crash| crash["rollout"].as_u64().expect("a number") / 1_000_000).collect()
    };
    for (index, round) in rounds.iter().enumerate() {
        assert!(numbers(round).iter().all(|number| *number == index as u64 + 1), "{round:#}");
    }
    assert!(report(&found)["upper_bound"].as_f64().expect("a bound") <= 0.5);

    let files = || std::fs::read_dir(fixture.root().join("measured")).expect("a store").count();
    let before = files();
    let again = promise(&fixture, &["--alpha", "0.5"]);
    assert_eq!((found.stdout, files()), (again.stdout, before));
}

#[test]
fn a_course_named_twice_is_refused_since_its_rollouts_would_count_twice() {
    let refused = promise(&fixture(), &["--size-m", "0.2,0.3"]);
    let error = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{error}");
    assert!(error.contains("found stairs_down of 0.3 m twice, wanted each once"), "{error}");
}

#[test]
fn too_few_rollouts_to_show_a_share_are_refused_before_any_is_driven() {
    let fixture = fixture();
    let refused = promise(&fixture, &["--alpha", "0.01"]);
    let error = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{error}");
    assert!(error.contains("--rollouts: found 16 a round, wanted more"), "{error}");
}
