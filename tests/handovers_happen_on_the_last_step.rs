//! A handover is what it is said to be: the second skill takes over while the hind feet are still on the
//! last step, a skill that takes over from itself goes on, and a row repeats exactly.

use std::sync::{Arc, OnceLock};

use serde_json::Value;
use vocaloco_core::{
    plugin::PluginLibrary,
    registry::{ModelPolicy, load_skill},
    robot::RobotModel,
};
use vocaloco_sim::{
    handover::{Handover, HandoverError, HandoverQuery, LAST_RISER_X_M, hand_over, summarise},
    plant::PlantKind,
    rollout::{Outcome, RolledSkill},
    terrain::{CourseKind, TREAD_M},
    threads::with_threads,
};
use vocaloco_tests::{Fixture, plugin_folder, shipped};

fn robot() -> &'static Arc<RobotModel> {
    static ROBOT: OnceLock<Arc<RobotModel>> = OnceLock::new();
    ROBOT.get_or_init(|| {
        Arc::new(RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the shipped robot"))
    })
}

fn skill(name: &str) -> RolledSkill {
    let loaded = load_skill(&shipped(), name, &robot().description, ModelPolicy::Optional);
    RolledSkill::from_loaded(&loaded.expect("a shipped skill"), robot()).expect("it can be rolled out")
}

fn faulty(fault: &str) -> RolledSkill {
    let library = PluginLibrary::open(&[plugin_folder().to_owned()], "faulty").expect("the plugin loads");
    RolledSkill::new("faulty", library, fault, robot()).expect("sound parameters")
}

fn query(course: CourseKind, size_m: f32, samples: u64) -> HandoverQuery {
    HandoverQuery { plant: PlantKind::Fast, ..HandoverQuery::new(course, size_m, samples, 1) }
}

fn handovers(
    skills: [&RolledSkill; 2],
    query: &HandoverQuery,
    threads: usize,
) -> Result<Vec<Handover>, HandoverError> {
    with_threads(threads, || hand_over(robot(), skills, query, &|| ())).expect("threads")
}

#[test]
fn the_hind_feet_are_on_the_last_step_and_the_fore_feet_past_it() {
    for (from, course) in
        [("ascend_network", CourseKind::StairsUp), ("descend_network", CourseKind::StairsDown)]
    {
        let (from, walk) = (skill(from), skill("walk"));
        let handovers = handovers([&from, &walk], &query(course, 0.12, 4), 2).expect("handovers");
        for (row, handover) in handovers.iter().enumerate() {
            let x_m: Vec<f32> =
                handover.feet_in_world_m.iter().map(|foot| foot[0] - LAST_RISER_X_M).collect();
            assert!(x_m[0] > 0.0 && x_m[1] > 0.0, "{course:?}, handover {row}: LF and RF at {x_m:?}");
            let on_it = |x_m: f32| (-TREAD_M..=0.0).contains(&x_m);
            assert!(on_it(x_m[2]) && on_it(x_m[3]), "{course:?}, handover {row}: LH and RH at {x_m:?}");
            let past_m = handover.base.position_m[0] - LAST_RISER_X_M;
            assert!((0.0..=0.6).contains(&past_m), "{course:?}, handover {row}: base {past_m} m past");
            assert!(handover.speed_m_per_s > 0.1, "{course:?}, handover {row} is on its way");
        }
    }
}

#[test]
fn a_skill_that_takes_over_from_itself_on_low_steps_goes_on() {
    let walk = skill("walk");
    let query = query(CourseKind::StairsUp, 0.02, 8);
    let handovers = handovers([&walk, &walk], &query, 2).expect("handovers");
    let outcomes: Vec<Outcome> = handovers.iter().map(|one| one.outcome).collect();
    let cleared = outcomes.iter().filter(|outcome| **outcome == Outcome::Reached).count();
    assert!(cleared >= 7, "{outcomes:?}");
}

#[test]
fn a_row_repeats_on_any_number_of_threads() {
    let (ascend, walk) = (skill("ascend_network"), skill("walk"));
    let skills = [&ascend, &walk];
    let query = query(CourseKind::StairsUp, 0.12, 4);
    let row = |threads| {
        let handovers = handovers(skills, &query, threads).expect("handovers");
        serde_json::to_string(&summarise(skills, &query, &handovers)).expect("a row")
    };
    assert_eq!(row(1), row(2));
}

#[test]
fn a_skill_that_fails_after_it_took_over_has_failed_the_handover() {
    let walk = skill("walk");
    let query = query(CourseKind::StairsUp, 0.02, 1);
    for fault in ["panic_in_reset 0", "error 10"] {
        let faulty = faulty(fault);
        let skills = [&walk, &faulty];
        let handovers = handovers(skills, &query, 1).expect("handovers");
        assert_eq!(summarise(skills, &query, &handovers).cleared, 0.0, "{fault}");
        assert!(matches!(handovers[0].outcome, Outcome::Fault | Outcome::BaseCollision), "{fault}");
    }
}

#[test]
fn a_skill_that_never_gets_there_is_named() {
    let (standing, walk) = (faulty("error 0"), skill("walk"));
    let refused = handovers([&standing, &walk], &query(CourseKind::StairsUp, 0.02, 1), 1);
    let message = refused.expect_err("no approach").to_string();
    assert!(message.contains("`faulty`") && message.contains("last step"), "{message}");
}

/// Of the command that docs/switching.md reports, with fewer rollouts.
#[test]
fn a_switch_shakes_the_joints_no_harder_than_skills_do_and_with_a_window_asks_for_no_more_torque() {
    let arguments =
        "evaluate switches --course stairs_up --size-m 0.12 --rollouts 16 --ramp-s 0,0.1 --seed 1 --json";
    let arguments: Vec<&str> = arguments.split(' ').collect();
    let output = Fixture::new().vocaloco(&arguments).env("VOCALOCO_ROOT", &shipped().root).output();
    let output = output.expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    let rows = report["rows"].as_array().expect("rows");
    assert_eq!(rows.iter().map(|row| &row["ramp_s"]).collect::<Vec<_>>(), [0.0, 0.1, 0.1]);
    for row in rows {
        let of = |field: &str| {
            row.pointer(field).and_then(Value::as_f64).unwrap_or_else(|| panic!("{field}: {row:#}"))
        };
        assert!(of("/acceleration_at_switches/n") >= 20.0, "{row:#}");
        assert!(of("/acceleration_at_switches/p50") <= of("/acceleration_within/p50"), "{row:#}");
        // The highest but one of some twenty.
        assert!(of("/acceleration_at_switches/p95") <= 1.25 * of("/acceleration_within/p95"), "{row:#}");
        if of("/ramp_s") > 0.0 {
            assert!(of("/torque_at_switches/p50") <= of("/torque_within/p50"), "{row:#}");
        }
    }
}
