//! Climb and gap do what they are for, and a deployment with them crosses the course of obstacles, on which the one
//! without them stops. Small fresh samples: of 20 at 97 % fewer than 16 are one in four thousand.

use std::process::Command;
use std::sync::Arc;

use serde_json::Value;
use vocaloco_core::{
    decision::Forced,
    decision_log::DecisionLog,
    registry::{ModelPolicy, load_skill},
    replay::Replayer,
    robot::RobotModel,
};
use vocaloco_sim::{
    collect::CollectError,
    evaluate::{Query, sample},
    rollout::{Outcome, RolledSkill, RolloutRules},
    terrain::TerrainKind,
    threads::with_threads,
};
use vocaloco_tests::{plugin_folder, shipped};

/// Rollouts of 20 that reach the horizon, from half a metre before the obstacle.
fn reached(name: &str, terrain: TerrainKind) -> usize {
    let robot = RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the shipped robot");
    let robot = Arc::new(robot);
    let loaded = load_skill(&shipped(), name, &robot.description, ModelPolicy::Optional).expect("shipped");
    let skill = RolledSkill::from_loaded(&loaded, &robot).expect("it can be rolled out");
    let rules = RolloutRules::of(&loaded.manifest.rollout);
    let mut query = Query { rules, ..Query::new(terrain, 0.5, 20, 77) };
    query.spawn.start_before_m = Some([0.4, 0.6]);
    query.spawn.yaw_rad = 0.15;
    let samples: Result<_, CollectError> =
        with_threads(0, || sample(&robot, &skill, &query, &|| ())).expect("threads");
    samples.expect("samples").iter().filter(|sample| sample.rollout.outcome == Outcome::Reached).count()
}

#[test]
fn climb_gets_onto_half_a_metre_and_gap_over_it() {
    for (skill, terrain) in [("climb", TerrainKind::Wall), ("gap", TerrainKind::Gap)] {
        let reached = reached(skill, terrain);
        assert!(reached >= 16, "{skill}: {reached} of 20");
    }
}

/// What a committed skill has been waiting for happens at its target in the log's replay too.
#[test]
fn a_log_with_committed_skills_is_decided_again_as_it_was() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let log = folder.path().join("decisions.mcap");
    let output = Command::new(plugin_folder().join("vocaloco"))
        .args([
            "run",
            "--source",
            "sim",
            "--course",
            "obstacles",
            "--deployment",
            "anymal_obstacles",
            "--log",
        ])
        .arg(&log)
        .env("VOCALOCO_ROOT", vocaloco_tests::repository())
        .env("VOCALOCO_PLUGIN_PATH", plugin_folder())
        .output()
        .expect("the drive starts");
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&output.stderr));
    let log = DecisionLog::read(&log).expect("a log");
    let committed = log.decisions.iter().filter(|decision| decision.forced == Some(Forced::Committed));
    assert!(committed.count() > 50, "skills were committed");
    let mut replayer = Replayer::new(log.setup.rules(), log.setup.windows());
    for decision in &log.decisions {
        let again = replayer.as_recorded(decision);
        assert!(again.agrees_with(decision), "tick {}: {again:?}, was {}", decision.tick, decision.active);
    }
}

/// Shares of outcomes on the course of obstacles.
fn rolled_out(deployment: &str, rollouts: u64) -> Value {
    let store = tempfile::tempdir().expect("a temporary folder");
    let output = Command::new(plugin_folder().join("vocaloco"))
        .args([
            "evaluate",
            "success",
            "--course",
            "obstacles",
            "--steps",
            "3",
            "--json",
            "--deployment",
            deployment,
        ])
        .args(["--rollouts", &rollouts.to_string(), "--seed", "78", "--store"])
        .arg(store.path())
        .env("VOCALOCO_ROOT", vocaloco_tests::repository())
        .env("VOCALOCO_PLUGIN_PATH", plugin_folder())
        .output()
        .expect("the evaluation starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).expect("one JSON object on stdout");
    report["rows"][0].clone()
}

#[test]
fn the_course_of_obstacles_is_crossed_with_them_and_stopped_before_without() {
    let with = rolled_out("anymal_obstacles", 8);
    assert_eq!(with["size_m"], 0.5, "its own size");
    assert!(with["reached"].as_f64() >= Some(0.5), "{with}");
    let without = rolled_out("anymal_stairs", 3);
    assert_eq!(without["reached"], 0.0, "{without}");
    assert!(without["stopped"].as_f64() >= Some(0.6), "{without}");
}
