use vocaloco_plugin_api::Command;

use super::fixture::{FORWARD, Loop, fake, ramp, skill};
use super::*;

#[test]
fn the_loop_starts_standing_and_walks_when_ten_ticks_agree() {
    let walk = fake(0.99, 0.2);
    let mut it = Loop::new(vec![skill("walk", &walk), skill("ascend", &fake(0.99, 0.9))]);
    let first = it.tick();
    assert_eq!((first.active.as_str(), first.choice.as_str()), ("stand", "walk"));
    assert_eq!(
        first.reason,
        "lowest cost of transport of 2 viable skills; 1 of 10 ticks in a row, stand goes on"
    );
    assert_eq!(it.until("walk"), 9);
    assert_eq!(it.tick().reason, "lowest cost of transport of 2 viable skills");
    assert_eq!(walk.with(|script| (script.resets, script.acts)), (1, 2));
}

#[test]
fn a_skill_is_reset_each_time_it_becomes_active_and_only_then() {
    let (walk, ascend) = (fake(0.99, 0.2), fake(0.99, 0.9));
    let mut it = Loop::new(vec![skill("walk", &walk), skill("ascend", &ascend)]);
    it.until("walk");
    ascend.with(|script| script.prediction = Some((0.99, 0.1)));
    assert_eq!(it.until("ascend"), 10);
    ascend.with(|script| script.prediction = Some((0.99, 0.9)));
    assert_eq!(it.until("walk"), 10);
    it.ticks(5);
    assert_eq!((walk.with(|s| s.resets), ascend.with(|s| s.resets)), (2, 1));
}

#[test]
fn a_skill_added_with_lower_cot_wins() {
    let (walk, trot) = (fake(0.99, 0.2), fake(0.99, 0.15));
    let mut it = Loop::new(vec![skill("walk", &walk), skill("trot", &trot)]);
    assert_eq!(it.until("trot"), 10);
}

#[test]
fn with_no_viable_skill_it_stops_through_the_window_and_leaves_after_the_resume_window() {
    let walk = fake(0.99, 0.2);
    let mut it = Loop::new(vec![skill("walk", &walk)]);
    it.until("walk");
    walk.with(|script| script.prediction = Some((0.5, 0.2)));
    let unviable = it.tick();
    assert_eq!((unviable.choice.as_str(), unviable.active.as_str()), ("stop", "walk"));
    assert_eq!(it.until("stand"), 9);
    walk.with(|script| script.prediction = Some((0.99, 0.2)));
    assert!(it.tick().stopped);
    assert_eq!(it.until("walk"), 24);
}

#[test]
fn a_skill_that_drives_goes_on_down_to_what_it_is_held_to_and_begins_at_its_threshold() {
    let walk = fake(0.99, 0.2);
    let mut held = skill("walk", &walk);
    held.rule.hold_threshold = 0.6;
    let mut it = Loop::new(vec![held]);
    it.until("walk");
    walk.with(|script| script.prediction = Some((0.7, 0.2)));
    assert_eq!(it.ticks(50).active, "walk");
    walk.with(|script| script.prediction = Some((0.5, 0.2)));
    assert_eq!(it.until("stand"), 10);
    walk.with(|script| script.prediction = Some((0.7, 0.2)));
    assert_eq!(it.ticks(50).active, "stand");
}

#[test]
fn a_zero_command_stands_at_once() {
    let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.2))]);
    it.until("walk");
    it.observation.command = Command::velocity(0.0, 0.0, 0.0);
    let decision = it.tick();
    assert_eq!((decision.active.as_str(), decision.forced), ("stand", Some(Forced::ZeroCommand)));
    assert!(!decision.stopped && it.stands_with_stand_gains());
    it.observation.command = FORWARD;
    assert_eq!(it.until("walk"), 10);
}

#[test]
fn a_robot_that_has_fallen_stands_until_it_is_upright() {
    let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.2))]);
    it.until("walk");
    it.observation.projected_gravity = [0.0, -0.9, -0.43];
    assert_eq!(it.tick().active, "walk", "64 degrees");
    it.observation.projected_gravity = [0.0, -1.0, 0.1];
    let decision = it.tick();
    assert_eq!((decision.active.as_str(), decision.forced), ("stand", Some(Forced::Fallen)));
    assert_eq!((decision.reason.as_str(), decision.choice.as_str()), ("base tilted too far: stop", "stop"));
    assert!(decision.stopped && it.stands_with_stand_gains());
    assert_eq!(it.ticks(100).active, "stand");
    it.observation.projected_gravity = [0.0, 0.0, -1.0];
    assert_eq!(it.until("walk"), 25);
}

#[test]
fn a_command_outside_the_range_stops_with_that_reason() {
    let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.2))]);
    it.until("walk");
    it.observation.command = Command::velocity(1.5, 0.0, 0.0);
    let decision = it.tick();
    assert_eq!(decision.skills[0].reason.to_string(), "forward command 1.5 m/s outside 0.4 to 0.7 m/s");
    assert_eq!(it.until("stand"), 9);
}

#[test]
fn a_failing_plugin_stands_within_the_tick_and_the_others_go_on() {
    let (walk, ascend) = (fake(0.99, 0.2), fake(0.99, 0.9));
    let mut it = Loop::new(vec![skill("walk", &walk), skill("ascend", &ascend)]);
    it.until("walk");
    walk.with(|script| script.fails = true);
    let decision = it.tick();
    assert_eq!((decision.active.as_str(), decision.forced), ("stand", Some(Forced::Fault)));
    assert_eq!(decision.events, ["skill walk is taken out of service: act: act panicked: out of cheese"]);
    assert!(it.stands_with_stand_gains());
    walk.with(|script| script.fails = false);
    assert_eq!(it.until("ascend"), 25);
    assert_eq!(it.tick().skills[0].reason, Reason::PluginFailed);
}

#[test]
fn a_plugin_that_cannot_start_stands_within_the_tick() {
    let walk = fake(0.99, 0.2);
    walk.with(|script| script.reset_fails = true);
    let mut it = Loop::new(vec![skill("walk", &walk)]);
    let tenth = it.ticks(10);
    assert_eq!(tenth.active, "stand");
    assert_eq!(tenth.events, ["skill walk is taken out of service: reset: no start"]);
}

#[test]
fn targets_that_are_not_finite_or_out_of_range_stand_within_the_tick() {
    type Spoiler = fn(&mut [JointTarget]);
    let spoilers: [(&str, Spoiler); 10] = [
        ("LH_HFE: stiffness_nm_per_rad 0", |joints| joints[7].stiffness_nm_per_rad = 0.0),
        ("LH_HFE: damping_nms_per_rad 0", |joints| joints[7].damping_nms_per_rad = 0.0),
        ("RF_KFE: position_rad NaN", |joints| joints[5].position_rad = f32::NAN),
        ("LF_HAA: position_rad inf", |joints| joints[0].position_rad = f32::INFINITY),
        ("LF_HAA: position_rad 9", |joints| joints[0].position_rad = 9.0),
        ("LH_HFE: stiffness_nm_per_rad -1", |joints| joints[7].stiffness_nm_per_rad = -1.0),
        ("LH_HFE: stiffness_nm_per_rad 100000", |joints| joints[7].stiffness_nm_per_rad = 1e5),
        ("LH_HFE: damping_nms_per_rad NaN", |joints| joints[7].damping_nms_per_rad = f32::NAN),
        ("RH_KFE: feed_forward_nm 81", |joints| joints[11].feed_forward_nm = 81.0),
        ("RH_KFE: position_rad NaN", |joints| {
            joints[11] = JointTarget { position_rad: f32::NAN, ..joints[11] }
        }),
    ];
    for (wanted, spoil) in spoilers {
        let walk = fake(0.99, 0.2);
        let mut it = Loop::new(vec![skill("walk", &walk)]);
        it.until("walk");
        walk.with(|script| script.act = Some(spoil));
        let decision = it.tick();
        assert_eq!(decision.active, "stand", "{wanted}");
        assert!(decision.events[0].contains(wanted), "{wanted}: {}", decision.events[0]);
        assert!(it.runtime.joints.iter().all(|joint| joint.position_rad.is_finite()), "{wanted}");
    }
}

#[test]
fn a_target_that_folds_feed_forward_torque_beyond_the_joints_range_is_taken() {
    let walk = fake(0.99, 0.2);
    walk.with(|script| script.act = Some(|joints| joints[2].position_rad -= 80.0 / 77.0));
    let mut it = Loop::new(vec![skill("walk", &walk)]);
    assert_eq!(it.until("walk"), 10);
}

#[test]
fn terrain_that_is_missing_old_small_or_mostly_unknown_stops_at_once() {
    type Spoiler = fn(&mut Observation);
    let spoilers: [(&str, Spoiler); 6] = [
        ("found nothing", |o| o.elevation = None),
        ("0.220 s old", |o| o.elevation.as_mut().unwrap().t_s = o.t_s - 0.22),
        ("-0.500 s old", |o| o.elevation.as_mut().unwrap().t_s = o.t_s + 0.5),
        ("NaN s old", |o| o.elevation.as_mut().unwrap().t_s = f64::NAN),
        ("height_m is 0 heights", |o| o.elevation.as_mut().unwrap().height_m.clear()),
        ("341 of 341 cells unknown", |o| o.elevation.as_mut().unwrap().height_m.fill(f32::NAN)),
    ];
    for (wanted, spoil) in spoilers {
        let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.2))]);
        it.until("walk");
        it.observation.t_s += 0.02;
        it.observation.elevation.as_mut().unwrap().t_s = it.observation.t_s;
        spoil(&mut it.observation);
        let decision = it.runtime.tick(&it.observation).decision.clone();
        assert_eq!((decision.active.as_str(), decision.choice.as_str()), ("stand", "stop"), "{wanted}");
        assert!(decision.events[0].contains(wanted), "{wanted}: {:?}", decision.events);
        assert_eq!(decision.skills[0].reason, Reason::NoTerrain);
        it.observation.elevation = Some(ramp());
        assert_eq!(it.until("walk"), 25, "{wanted}: seen again, one resume window later");
    }
}

#[test]
fn terrain_as_old_as_allowed_is_still_looked_at() {
    let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.2))]);
    it.until("walk");
    it.observation.t_s += 0.2;
    assert_eq!(it.runtime.tick(&it.observation).decision.active, "walk");
}

#[test]
fn three_predictions_that_are_no_numbers_take_the_active_skill_out_and_stand() {
    let walk = fake(0.99, 0.2);
    let mut it = Loop::new(vec![skill("walk", &walk), skill("ascend", &fake(0.99, 0.9))]);
    it.until("walk");
    walk.with(|script| script.prediction = Some((f32::NAN, 0.2)));
    assert_eq!(it.tick().active, "walk");
    assert_eq!(it.tick().active, "walk");
    let third = it.tick();
    assert_eq!((third.active.as_str(), third.forced), ("stand", Some(Forced::Fault)));
    assert_eq!(it.until("ascend"), 25);
}

#[test]
fn a_measurement_that_is_no_number_stands_at_once_and_names_the_joint() {
    let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.2))]);
    it.until("walk");
    it.observation.joint_velocity_rad_per_s[4] = f32::NAN;
    let decision = it.tick();
    assert_eq!(decision.active, "stand");
    assert_eq!(decision.events, ["joint_velocity_rad_per_s.RF_HFE: found NaN, wanted a finite number"]);
    assert!(it.stands_with_stand_gains());
    it.observation.joint_velocity_rad_per_s[4] = 0.0;
    assert_eq!(it.until("walk"), 25);
}

#[test]
fn a_stand_after_a_faulty_first_line_begins_where_the_joints_are_measured() {
    // It began at the faulty line, in the stand pose, and pulled a crouching robot up to it at once.
    let crouch = |it: &mut Loop| {
        for (index, position) in it.observation.joint_position_rad.iter_mut().enumerate() {
            *position *= if index % 3 == 0 { 1.0 } else { 1.4 };
        }
    };
    let mut measured_first = Loop::new(vec![skill("walk", &fake(0.99, 0.2))]);
    crouch(&mut measured_first);
    measured_first.tick();

    let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.2))]);
    let fault = ObservationFault::new("line", "nonsense", "a JSON object");
    it.runtime.fault_tick(&fault);
    it.runtime.fault_tick(&fault);
    let blind = it.runtime.joints.clone();
    crouch(&mut it);
    it.tick();
    assert_eq!(it.runtime.joints, measured_first.runtime.joints);
    assert_ne!(it.runtime.joints, blind);
}

#[test]
fn what_a_plugin_needs_and_the_source_leaves_out_is_the_sources_fault() {
    let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.2))]);
    it.until("walk");
    it.observation.foot_contact = None;
    assert_eq!(
        it.tick().events,
        ["foot_contact: found nothing, wanted a value: a skill of this deployment needs it"]
    );
    assert_eq!(it.runtime.selector.out_of_service(0), None);
}

#[test]
fn time_running_backwards_is_one_fault_and_the_loop_goes_on() {
    let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.2))]);
    it.until("walk");
    it.observation.t_s = 0.0;
    let decision = it.tick();
    assert!(decision.events[0].starts_with("t_s: found 0.02, wanted "), "{:?}", decision.events);
    assert_eq!(decision.active, "stand");
    assert_eq!(it.until("walk"), 25);
}

#[test]
fn a_plugin_gets_the_terrain_patch_that_it_declared() {
    let walk = fake(0.99, 0.2);
    let mut it = Loop::new(vec![skill("walk", &walk)]);
    it.until("walk");
    let terrain = walk.with(|script| script.terrain.clone());
    assert_eq!(terrain.len(), 7 * 3);
    // Row 0 is 0.2 m behind (row 8 of the ramp), column 0 is 0.1 m to the left (column 4).
    assert!((terrain[0] - (0.16 - 0.02 - 0.55)).abs() < 1e-6);
    assert!((terrain[2] - (0.16 - 0.03 - 0.55)).abs() < 1e-6);
    assert!((terrain[18] - (0.28 - 0.02 - 0.55)).abs() < 1e-6);
}

#[test]
fn a_restarted_loop_decides_as_a_new_one_does() {
    let walk = fake(0.99, 0.2);
    let mut it = Loop::new(vec![skill("walk", &walk)]);
    let first: Vec<_> = (0..30).map(|_| it.tick()).collect();
    walk.with(|script| script.fails = true);
    it.tick();
    walk.with(|script| script.fails = false);
    it.runtime.restart();
    it.observation.t_s = 0.0;
    for (tick, wanted) in first.iter().enumerate() {
        assert_eq!(&it.tick(), wanted, "tick {tick}");
    }
}

#[test]
fn a_model_that_panics_is_a_prediction_that_cannot_be_used() {
    let walk = fake(0.99, 0.2);
    let mut it = Loop::new(vec![skill("walk", &walk), skill("ascend", &fake(0.99, 0.9))]);
    walk.with(|script| script.prediction = None);
    let decision = it.tick();
    assert_eq!((decision.choice.as_str(), decision.skills[0].reason), ("ascend", Reason::Unusable));
    assert_eq!(decision.events, ["the model's runtime panicked"]);
}
