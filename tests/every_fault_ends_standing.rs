//! Whatever a plugin or a predictor does wrong while it runs, the robot stands within the tick and
//! the other skills go on: with real libraries and real models, through the whole runtime.

use vocaloco_core::decision::{Decision, Forced};
use vocaloco_core::elevation::Elevation;
use vocaloco_core::observation::Observation;
use vocaloco_core::registry::load_deployment;
use vocaloco_core::runtime::Runtime;
use vocaloco_plugin_api::{Command, JointTarget};
use vocaloco_tests::{Fixture, constant_model};

/// The robot in its stand on flat ground, at a tick.
fn observation(runtime: &Runtime, tick: u64) -> Observation {
    let robot = runtime.robot();
    let t_s = tick as f64 * 0.02;
    Observation {
        t_s,
        joint_position_rad: robot.stand_position_rad(),
        joint_velocity_rad_per_s: vec![0.0; robot.joint_count()],
        joint_torque_nm: None,
        foot_contact: None,
        base_linear_velocity: [0.0; 3],
        base_angular_velocity: [0.0; 3],
        projected_gravity: [0.0, 0.0, -1.0],
        base_in_odom: None,
        elevation: Some(Elevation {
            t_s,
            resolution_m: 0.1,
            back_m: 1.0,
            front_m: 2.0,
            half_width_m: 0.5,
            height_m: vec![-0.5; 31 * 11],
        }),
        command: Command::velocity(0.5, 0.0, 0.0),
        field_noise: None,
        heightfield: None,
    }
}

/// Ticks of a deployment of `bad`, the cheaper one, and `good`.
fn ticks(fixture: &Fixture, count: u64) -> Vec<(Decision, Vec<JointTarget>)> {
    fixture.add_deployment("pair", &["bad", "good"]);
    let loaded = load_deployment(&fixture.installation(), "pair").expect("both are sound at load");
    assert!(loaded.refused.is_empty(), "{:?}", loaded.refused);
    let mut runtime = Runtime::new(loaded).expect("a runtime");
    (0..count)
        .map(|tick| {
            let observation = observation(&runtime, tick);
            let tick = runtime.tick(&observation);
            (tick.decision.clone(), tick.joints.to_vec())
        })
        .collect()
}

fn pair(fault: &str) -> Fixture {
    let fixture = Fixture::new();
    fixture.add_skill("bad", fault, 0.99, 0.1);
    fixture.add_skill("good", "none", 0.99, 0.5);
    fixture
}

#[test]
fn a_plugin_that_fails_is_replaced_by_the_stand_in_the_same_tick_and_then_by_the_other_skill() {
    for fault in ["panic", "error", "nan", "infinite_gain", "out_of_range", "negative_stiffness", "silent"] {
        let fixture = pair(&format!("{fault} 5"));
        let ticks = ticks(&fixture, 60);
        let active: Vec<&str> = ticks.iter().map(|(decision, _)| decision.active.as_str()).collect();
        assert!(active[..9].iter().all(|active| *active == "stand"), "{fault}: {active:?}");
        assert!(active[9..14].iter().all(|active| *active == "bad"), "{fault}: {active:?}");
        let (decision, joints) = &ticks[14];
        assert_eq!(decision.active, "stand", "{fault}: the tick of the fault");
        assert_eq!(decision.forced, Some(Forced::Fault), "{fault}");
        assert!(decision.events[0].starts_with("skill bad is taken out of service"), "{fault}: {decision:?}");
        for (index, joint) in joints.iter().enumerate() {
            let stands = joint.position_rad.is_finite() && joint.stiffness_nm_per_rad > 50.0;
            assert!(stands, "{fault}: joint {index} got {joint:?}");
        }
        assert!(active[14..39].iter().all(|active| *active == "stand"), "{fault}: {active:?}");
        assert!(active[39..].iter().all(|active| *active == "good"), "{fault}: {active:?}");
    }
}

#[test]
fn a_plugin_that_cannot_start_leaves_the_robot_standing() {
    let ticks = ticks(&pair("panic_in_reset"), 40);
    assert_eq!(ticks[9].0.active, "stand");
    assert!(ticks[9].0.events[0].contains("reset panicked"), "{:?}", ticks[9].0.events);
    assert_eq!(ticks[34].0.active, "good");
}

#[test]
fn a_cost_that_is_not_positive_leaves_the_skill_in_service_but_not_viable() {
    let fixture = pair("none");
    fixture.write("skills/bad/cot.onnx", &constant_model("cot", -0.2));
    for (decision, _) in ticks(&fixture, 20) {
        let bad = &decision.skills[0];
        assert!(!bad.viable && !bad.reason.is_out_of_service(), "tick {}: {bad:?}", decision.tick);
        assert_eq!(decision.choice, "good");
    }
}

#[test]
fn a_viability_outside_zero_to_one_takes_the_skill_out_after_three_ticks() {
    let fixture = pair("none");
    fixture.write("skills/bad/viability.onnx", &constant_model("viability", 1.5));
    let ticks = ticks(&fixture, 20);
    let out: Vec<bool> = ticks.iter().map(|(it, _)| it.skills[0].reason.is_out_of_service()).collect();
    assert_eq!(out[..4], [false, false, true, true]);
    assert!(ticks[0].0.events[0].contains("viability: found 1.5, wanted 0 to 1"), "{:?}", ticks[0].0.events);
    assert!(ticks.iter().all(|(decision, _)| decision.choice == "good"));
}

#[test]
fn the_same_observations_give_the_same_bytes() {
    let bytes = |_: u32| {
        let ticks = ticks(&pair("error 5"), 60);
        ticks.iter().map(|(decision, joints)| format!("{decision:?} {joints:?}")).collect::<Vec<_>>()
    };
    for (tick, (first, second)) in bytes(1).iter().zip(&bytes(2)).enumerate() {
        assert_eq!(first, second, "tick {tick}");
    }
}
