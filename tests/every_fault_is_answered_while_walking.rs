//! The table of faults in docs/safety.md, row by row, while the simulated robot walks at 0.6 m/s: the
//! answer comes within the tick, the record says why, and the robot stays on its feet.

use std::sync::Arc;
use std::time::Duration;

use vocaloco_core::decision::{Decision, Forced};
use vocaloco_core::elevation::Elevation;
use vocaloco_core::manifest::Isolation;
use vocaloco_core::observation::{BaseInOdom, Observation};
use vocaloco_core::registry::{ModelPolicy, load_skill, read_deployment};
use vocaloco_core::runtime::{Followed, Follower, Watch};
use vocaloco_core::selector::Reason;
use vocaloco_tests::{Fixture, Walking, overflowing_policy};

/// The robot stands by this decision, and says why.
fn assert_stands(walking: &Walking, decision: &Decision, forced: Forced, why: &str) {
    assert_eq!((decision.active.as_str(), decision.forced), ("stand", Some(forced)), "{why}: {decision:?}");
    assert!(walking.stands(), "{why}: {:?}", walking.joints);
    assert!(decision.events.iter().any(|event| event.contains(why)), "{why}: {:?}", decision.events);
}

/// It stands for the resume window, then walks on, and never falls.
fn assert_walks_on(walking: &mut Walking, why: &str) {
    let ticks = (1..=60).find(|_| walking.tick().active == "walk");
    assert_eq!(ticks, Some(25), "{why}: a resume window later");
    for _ in 0..50 {
        assert_eq!(walking.tick().active, "walk", "{why}");
    }
    assert!(walking.is_on_its_feet(), "{why}");
    assert!(walking.plant.measure().base_linear_velocity[0] > 0.3, "{why}: it walks again");
}

#[test]
fn a_plugin_that_fails_or_answers_nonsense() {
    for (fault, why) in [
        ("panic", "act panicked: asked for a panic in act"),
        ("panic_in_reset", "reset panicked: asked for a panic in reset"),
        ("error", "act: asked for an error"),
        ("nan", "LH_HFE: position_rad NaN"),
        ("billion", "LH_HFE: position_rad 1000000000"),
        ("out_of_range", "LH_HFE: position_rad 50"),
        ("infinite_gain", "LH_HFE: damping_nms_per_rad inf"),
        ("negative_stiffness", "LH_HFE: stiffness_nm_per_rad -80"),
        ("limp", "LF_HAA: stiffness_nm_per_rad 0, 1 to 1000 wanted"),
        ("short", "LH_HFE: position_rad NaN"),
        ("long", "act panicked: index out of bounds: the len is 12 but the index is 12"),
        ("silent", "LF_HAA: position_rad NaN"),
    ] {
        let mut walking = Walking::at_speed(fault, Isolation::None, None);
        let decision = walking.until_bad_is_called();
        assert_stands(&walking, &decision, Forced::Fault, why);
        assert!(decision.events[0].starts_with("skill bad is taken out of service: "), "{decision:?}");
        assert_eq!(decision.skills[1].reason, Reason::PluginFailed, "{fault}");
        assert_walks_on(&mut walking, fault);
    }
}

/// The stand takes over from targets of its own, in the midst of what it does.
#[test]
fn a_plugin_that_fails_after_it_has_driven() {
    for (fault, isolation, why) in [
        ("panic 3", Isolation::None, "act panicked: asked for a panic in act"),
        ("nan 3", Isolation::None, "LH_HFE: position_rad NaN"),
        ("limp 3", Isolation::None, "LF_HAA: stiffness_nm_per_rad 0"),
        ("segfault 3", Isolation::Process, "ended by signal 11"),
    ] {
        let mut walking = Walking::at_speed(fault, isolation, None);
        assert_eq!(walking.until_bad_is_called().active, "bad", "{fault}");
        for _ in 1..3 {
            assert_eq!(walking.tick().active, "bad", "{fault}");
        }
        let decision = walking.tick();
        assert_stands(&walking, &decision, Forced::Fault, why);
        assert_eq!(decision.skills[1].reason, Reason::PluginFailed, "{fault}");
        assert_walks_on(&mut walking, fault);
    }
}

#[test]
fn a_plugin_that_hangs_after_it_has_driven_in_real_time() {
    let mut walking = Walking::at_speed("hang 3", Isolation::None, Some(0.7));
    assert_eq!(walking.until_bad_is_called().active, "bad");
    walking.tick();
    assert_eq!(walking.tick().active, "bad");
    let decision = walking.tick();
    assert_stands(&walking, &decision, Forced::Overrun, "skill bad is late: act: found no answer");
    walking.tick();
    assert_eq!(walking.tick().skills[1].reason, Reason::TooSlow);
    assert_walks_on(&mut walking, "hang 3");
}

#[test]
fn a_policy_network_whose_actions_are_no_numbers() {
    let fixture = Fixture::new();
    fixture.add_shipped(&["ascend_network"]);
    let policy = fixture.root().join("skills/ascend_network/policy.onnx");
    let sound = std::fs::read(&policy).expect("a network");
    std::fs::write(&policy, overflowing_policy(&sound)).expect("a written network");
    let mut walking = Walking::beside(None, |robot| {
        let robot = &robot.description;
        let models = ModelPolicy::Optional;
        let skill =
            load_skill(&fixture.installation(), "ascend_network", robot, models).expect("finite weights");
        skill.create(robot)
    })
    .at_full_speed();
    let decision = walking.until_bad_is_called();
    assert_stands(&walking, &decision, Forced::Fault, "wanted finite actions");
    assert_eq!(decision.skills[1].reason, Reason::PluginFailed);
    assert_walks_on(&mut walking, "a network");
}

#[test]
fn a_plugin_that_hangs_or_is_slow_in_real_time() {
    let act_s = 0.7;
    for fault in ["hang", "slow"] {
        let mut walking = Walking::at_speed(fault, Isolation::None, Some(act_s));
        let decision = walking.until_bad_is_called();
        let late = "skill bad is late: reset and act: found no answer, wanted one within 700.0 ms";
        assert_stands(&walking, &decision, Forced::Overrun, late);
        let second = walking.tick();
        assert_stands(
            &walking,
            &second,
            Forced::Overrun,
            "skill bad is late: reset and act: found no answer",
        );
        let third = walking.tick();
        let out = "skill bad is taken out of service: reset and act: found no answer";
        assert_stands(&walking, &third, Forced::Fault, out);
        assert_eq!(third.skills[1].reason, Reason::TooSlow, "{fault}");
        assert_walks_on(&mut walking, fault);
    }
}

#[test]
fn an_isolated_plugin_that_ends_its_process_grows_or_never_returns() {
    for (fault, why) in [
        ("segfault", "ended by signal 11"),
        ("abort", "ended by signal 6"),
        ("spin", "found no answer for 2 s"),
        ("nan", "LH_HFE: position_rad NaN"),
        ("panic", "act panicked: asked for a panic in act"),
        ("leak", "ended by signal"),
        ("long_error", "act: words words words"),
        ("second_answer", "found an answer to another call from its process, which was ended"),
    ] {
        let mut walking = Walking::at_speed(fault, Isolation::Process, None);
        let mut decision = walking.until_bad_is_called();
        // 256 MiB more are eight times 32, and the system may have reserved some besides when that was counted.
        for _ in 0..16 {
            if ["leak", "second_answer"].contains(&fault) && decision.active == "bad" {
                decision = walking.tick();
            }
        }
        assert_stands(&walking, &decision, Forced::Fault, why);
        assert_eq!(decision.skills[1].reason, Reason::PluginFailed, "{fault}");
        assert_walks_on(&mut walking, fault);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn what_an_isolated_plugin_has_started_ends_with_it() {
    let runs = |process: &str| {
        let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
        // One that nobody has waited for yet is left as a Z.
        stat.rsplit_once(") ").is_some_and(|(_, state)| !state.starts_with('Z'))
    };
    let mut walking = Walking::at_speed("process", Isolation::Process, None);
    let decision = walking.until_bad_is_called();
    let words = "act: asked for a process, which is ";
    assert_stands(&walking, &decision, Forced::Fault, words);
    let started = decision.events.iter().find_map(|event| Some(event.split_once(words)?.1.to_owned()));
    let started = started.expect("its number");
    assert!(runs(&started), "{started} runs as long as the plugin does");
    drop(walking);
    let is_gone = (0..200).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(10));
        !runs(&started)
    });
    assert!(is_gone, "{started} is still there");
}

/// Courses that take turns with one runtime each get the skills of a fresh one.
#[test]
fn an_isolated_plugin_that_has_ended_is_there_again_when_the_loop_starts_over() {
    let mut walking = Walking::at_speed("segfault 2", Isolation::Process, None);
    for run in 1..=3 {
        assert_eq!(walking.until_bad_is_called().active, "bad", "run {run}");
        assert_eq!(walking.tick().active, "bad", "run {run}");
        let decision = walking.tick();
        assert_stands(&walking, &decision, Forced::Fault, "its process ended by signal 11");
        walking.runtime.restart();
        walking.bad.set(0.1, 0.1);
        for _ in 0..10 {
            walking.tick();
        }
    }
}

#[test]
fn an_isolated_plugin_that_hangs_in_real_time() {
    let mut walking = Walking::at_speed("spin", Isolation::Process, Some(0.7));
    let decision = walking.until_bad_is_called();
    assert_stands(&walking, &decision, Forced::Overrun, "skill bad is late: reset and act: found no answer");
    walking.tick();
    assert_eq!(walking.tick().skills[1].reason, Reason::TooSlow);
    assert_walks_on(&mut walking, "spin");
}

#[test]
fn terrain_that_is_missing_stale_of_another_size_or_frame_or_unknown() {
    type Spoiler = fn(&mut Observation);
    fn map(o: &mut Observation) -> &mut Elevation {
        o.elevation.as_mut().expect("terrain")
    }
    let spoilers: [(&str, Spoiler); 12] = [
        ("found nothing", |o| o.elevation = None),
        ("341 of 341 cells unknown", |o| map(o).height_m.fill(f32::NEG_INFINITY)),
        ("height_m is 1972 heights, 69 rows of 29 wanted", |o| map(o).height_m.truncate(68 * 29)),
        ("height_m is 2002 heights, 69 rows of 29 wanted", |o| map(o).height_m.push(-0.5)),
        ("resolution_m is 0.2", |o| map(o).resolution_m = 0.2),
        ("front_m is 1.9", |o| map(o).front_m = 1.9),
        ("under the base", |o| map(o).height_m.iter_mut().for_each(|height| *height += 1.0)),
        ("0.220 s old", |o| o.elevation.as_mut().expect("terrain").t_s = o.t_s - 0.22),
        ("height_m is 0 heights in rows of 29", |o| o.elevation.as_mut().expect("terrain").height_m.clear()),
        ("341 of 341 cells unknown", |o| o.elevation.as_mut().expect("terrain").height_m.fill(f32::NAN)),
        ("cells unknown, at most", |o| {
            let heights = &mut o.elevation.as_mut().expect("terrain").height_m;
            let half = heights.len() / 2;
            heights[..half].fill(f32::NAN);
        }),
        ("has no known cell", |o| {
            // Columns of 5 cm: the field's second one, 0.4 m to the left, and its neighbours.
            for (index, height) in o.elevation.as_mut().expect("terrain").height_m.iter_mut().enumerate() {
                if (5..=7).contains(&(index % 29)) {
                    *height = f32::NAN;
                }
            }
        }),
    ];
    for (why, spoil) in spoilers {
        let mut walking = Walking::at_speed("none", Isolation::None, None);
        let decision = walking.tick_with(spoil);
        assert_stands(&walking, &decision, Forced::Terrain, why);
        assert_eq!(
            (decision.choice.as_str(), decision.skills[0].reason),
            ("stop", Reason::NoTerrain),
            "{why}"
        );
        assert_walks_on(&mut walking, why);
    }
}

#[test]
fn a_few_heights_that_are_no_numbers_are_filled_in() {
    let mut walking = Walking::at_speed("none", Isolation::None, None);
    for height in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let decision = walking.tick_with(|o| {
            o.elevation.as_mut().expect("terrain").height_m.iter_mut().step_by(7).for_each(|it| *it = height);
        });
        assert_eq!((decision.active.as_str(), decision.forced), ("walk", None), "{height}: {decision:?}");
        let field = decision.field.expect("a field");
        assert!(field.as_slice().iter().all(|cell| cell.is_finite()), "{height}: {field:?}");
    }
    assert!(walking.is_on_its_feet());
}

#[test]
fn a_measurement_that_is_no_number_missing_from_the_past_or_of_another_unit() {
    type Spoiler = fn(&mut Observation);
    let spoilers: [(&str, Spoiler); 9] = [
        ("joint_velocity_rad_per_s.LF_HAA: found 400", |o| o.joint_velocity_rad_per_s[0] = 400.0),
        ("base_in_odom.position_m: found [0.0, 10001.0, 0.0]", |o| {
            let orientation_xyzw = [0.0, 0.0, 0.0, 1.0];
            o.base_in_odom = Some(BaseInOdom { position_m: [0.0, 10_001.0, 0.0], orientation_xyzw });
        }),
        ("joint_velocity_rad_per_s.RF_HFE: found NaN", |o| o.joint_velocity_rad_per_s[4] = f32::NAN),
        ("projected_gravity[1]: found inf", |o| o.projected_gravity[1] = f32::INFINITY),
        ("joint_position_rad: found 11 values", |o| o.joint_position_rad.truncate(11)),
        ("t_s: found 0, wanted", |o| o.t_s = 0.0),
        ("joint_position_rad.LF_KFE: found -", |o| {
            o.joint_position_rad.iter_mut().for_each(|angle| *angle = angle.to_degrees());
            o.joint_position_rad[..2].fill(0.0);
        }),
        ("projected_gravity: found length 9.81", |o| {
            o.projected_gravity = o.projected_gravity.map(|g| 9.81 * g);
        }),
        ("base_in_odom.orientation_xyzw: found length 0.000", |o| {
            o.base_in_odom = Some(BaseInOdom { position_m: [0.0; 3], orientation_xyzw: [0.0; 4] });
        }),
    ];
    for (why, spoil) in spoilers {
        let mut walking = Walking::at_speed("none", Isolation::None, None);
        let decision = walking.tick_with(spoil);
        assert_stands(&walking, &decision, Forced::Observation, why);
        assert_walks_on(&mut walking, why);
    }
}

#[test]
fn measurements_and_terrain_that_stay_the_same() {
    type Copy = fn(&mut Observation, &Observation);
    let frozen: [(&str, Forced, usize, Copy); 2] = [
        ("joints and base: found the same measurement for 0.100 s", Forced::Observation, 5, |now, then| {
            *now = Observation { t_s: now.t_s, elevation: now.elevation.take(), ..then.clone() };
        }),
        (
            "elevation: found the same heights for 0.200 s under new times",
            Forced::Terrain,
            10,
            |now, then| {
                now.elevation = then.elevation.clone();
                now.elevation.as_mut().expect("terrain").t_s = now.t_s;
            },
        ),
    ];
    for (why, forced, ticks, repeat) in frozen {
        let mut walking = Walking::at_speed("none", Isolation::None, None);
        let mut then = None;
        walking.tick_with(|now| then = Some(now.clone()));
        let then = then.expect("an observation");
        for _ in 1..ticks {
            assert_eq!(walking.tick_with(|now| repeat(now, &then)).active, "walk", "{why}: not yet");
        }
        let decision = walking.tick_with(|now| repeat(now, &then));
        assert_stands(&walking, &decision, forced, why);
        for _ in 0..50 {
            assert_eq!(walking.tick_with(|now| repeat(now, &then)).forced, Some(forced), "{why}: still");
        }
        assert_walks_on(&mut walking, why);
    }
}

#[test]
fn a_base_that_lies_on_its_side() {
    let mut walking = Walking::at_speed("none", Isolation::None, None);
    let decision = walking.tick_with(|o| o.projected_gravity = [0.1, 0.95, -0.3]);
    let why = "projected_gravity: found a base tilted by 1.27 rad, wanted at most 1.2";
    assert_stands(&walking, &decision, Forced::Fallen, why);
    assert_eq!((decision.choice.as_str(), decision.stopped), ("stop", true));
    assert!(decision.skills[0].viable, "its predictors are asked all the same: {decision:?}");
    assert_walks_on(&mut walking, why);
}

#[test]
fn a_prediction_that_is_no_number() {
    let mut walking = Walking::at_speed("none", Isolation::None, None);
    walking.walk.set(f32::NAN, 0.5);
    for _ in 0..2 {
        let decision = walking.tick();
        assert_eq!((decision.active.as_str(), decision.skills[0].reason), ("walk", Reason::Unusable));
    }
    walking.walk.set(0.99, 0.5);
    assert_eq!(walking.tick().choice, "walk", "twice is not three times");
    walking.walk.set(0.99, f32::INFINITY);
    assert_eq!(walking.tick().skills[0].reason, Reason::Unusable);
    walking.walk.set(1.5, 0.5);
    assert_eq!(walking.tick().skills[0].reason, Reason::Unusable, "beyond 1");
    walking.walk.set(-0.1, 0.5);
    let third = walking.tick();
    assert_eq!((third.active.as_str(), third.forced), ("stand", Some(Forced::Fault)), "{third:?}");
    assert_eq!(third.skills[0].reason, Reason::PredictionsFailed);
    assert!(walking.stands());
    for _ in 0..100 {
        assert_eq!(walking.tick().active, "stand", "no skill is left that is viable");
    }
    assert!(walking.is_on_its_feet());
}

#[test]
fn a_prediction_over_its_budget_in_real_time() {
    let budget_s = 0.7;
    let mut walking = Walking::at_speed("none", Isolation::None, Some(budget_s));
    walking.walk.take(Duration::from_secs_f64(10.0 * budget_s));
    let late = "skill walk is late: predict: found no answer, wanted one within 700.0 ms";
    for _ in 0..2 {
        let decision = walking.tick();
        assert_stands(&walking, &decision, Forced::Overrun, late);
        assert!(!decision.skills[0].viable, "{decision:?}");
    }
    let third = walking.tick();
    assert_stands(&walking, &third, Forced::Fault, "skill walk is taken out of service: predict: ");
    assert_eq!(third.skills[0].reason, Reason::TooSlow);
    for _ in 0..50 {
        assert_eq!(walking.tick().active, "stand", "no skill is left that is viable");
    }
    assert!(walking.is_on_its_feet());
}

#[test]
fn terrain_unlike_any_that_the_predictors_were_fitted_to() {
    let mut walking = Walking::at_speed("none", Isolation::None, None);
    walking.walk.find_strange(Some(1.4));
    let first = walking.tick();
    let unknown = Reason::UnknownTerrain { strangeness: 1.4 };
    assert_eq!((first.choice.as_str(), first.skills[0].reason), ("stop", unknown), "in the same tick");
    assert_eq!((2..=60).find(|_| walking.tick().active == "stand"), Some(10), "through the window");
    assert!(walking.stands());
    walking.walk.find_strange(Some(0.3));
    assert_walks_on(&mut walking, "it is known again: never taken out");
}

#[test]
fn a_cost_that_is_not_positive_and_no_viable_skill_at_all() {
    for (viability, cot, reason) in [
        (0.99, -0.2, Reason::CotNotPositive),
        (0.99, 0.0, Reason::CotNotPositive),
        (0.2, 0.5, Reason::BelowThreshold { threshold: Walking::THRESHOLD }),
    ] {
        let mut walking = Walking::at_speed("none", Isolation::None, None);
        walking.walk.set(viability, cot);
        let first = walking.tick();
        assert_eq!((first.choice.as_str(), first.skills[0].reason), ("stop", reason), "in the same tick");
        let ticks = (2..=60).find(|_| walking.tick().active == "stand");
        assert_eq!(ticks, Some(10), "{reason}: through the window, like any other choice");
        assert!(walking.stands());
        walking.walk.set(0.99, 0.5);
        assert_eq!((1..=60).find(|_| walking.tick().active == "walk"), Some(25), "{reason}: never taken out");
        assert!(walking.is_on_its_feet(), "{reason}");
    }
}

/// By the loop's own thread, whenever it finds them.
#[test]
fn a_skill_that_comes_and_goes_while_its_files_are_followed() {
    let fixture = Fixture::new();
    for skill in ["walk", "bad", "trot"] {
        fixture.add_skill(skill, "none", 0.99, 0.9);
    }
    fixture.add_deployment("stairs", &["walk", "bad"]);
    let installation = fixture.installation();
    let walking = Walking::at_speed("none", Isolation::None, None);
    let robot = Arc::clone(walking.runtime.robot());
    let deployment = read_deployment(&installation, "stairs").expect("sound");
    let followed = Followed::now(&installation, "stairs");
    let running = ["walk", "bad"].map(str::to_owned);
    let mut walking =
        walking.following(Follower::start(followed, deployment, robot, running, None).expect("a thread"));
    for skills in [&["walk", "bad", "trot"][..], &["walk", "bad"]] {
        fixture.add_deployment("stairs", skills);
        // At a third of its pace: what is looked for on the way is not how far it comes meanwhile.
        let found = (0..500).any(|_| {
            std::thread::sleep(Duration::from_millis(60));
            let decision = walking.tick();
            assert_eq!((decision.active.as_str(), decision.forced), ("walk", None), "{decision:?}");
            decision.skills.len() == skills.len()
        });
        assert!(found, "{skills:?} within half a minute");
    }
    assert!(walking.is_on_its_feet());
}

/// The files of a deployment are looked at as the loop's own thread does it, in between its ticks.
#[test]
fn skills_that_come_are_spoiled_or_go() {
    let mut walking = Walking::at_speed("none", Isolation::None, None);
    let fixture = Fixture::new();
    for skill in ["walk", "bad", "trot"] {
        fixture.add_skill(skill, "none", 0.99, 0.9);
    }
    fixture.add_deployment("stairs", &["walk", "bad"]);
    let installation = fixture.installation();
    let deployment = read_deployment(&installation, "stairs").expect("sound");
    let robot = Arc::clone(walking.runtime.robot());
    let followed = Followed::now(&installation, "stairs");
    let running = ["walk", "bad"].map(str::to_owned);
    let mut watch = Watch::new(followed, deployment, robot, running, None);
    let mut after = |walking: &mut Walking, change: &dyn Fn()| {
        change();
        let roster = (0..5).find_map(|_| {
            // Two looks that agree, a moment apart.
            std::thread::sleep(Duration::from_millis(20));
            watch.look()
        });
        walking.runtime.adopt(roster.expect("it is news"));
        walking.tick()
    };
    let names = |decision: &Decision| {
        decision.skills.iter().map(|skill| skill.name.clone()).collect::<Vec<_>>().join(" ")
    };

    let came = after(&mut walking, &|| fixture.add_deployment("stairs", &["walk", "bad", "trot"]));
    assert_eq!((names(&came).as_str(), came.active.as_str()), ("walk bad trot", "walk"), "{came:?}");
    let spoiled = after(&mut walking, &|| fixture.write("skills/trot/cot.onnx", b"nonsense"));
    assert_eq!((names(&spoiled).as_str(), spoiled.active.as_str()), ("walk bad trot", "walk"), "{spoiled:?}");
    assert!(spoiled.events[0].contains("cot.onnx"), "{spoiled:?}");
    let unread = after(&mut walking, &|| fixture.write("manifests/deployments/stairs.toml", b"schema = "));
    assert_eq!((names(&unread).as_str(), unread.active.as_str()), ("walk bad trot", "walk"), "{unread:?}");
    assert!(unread.events[0].contains("the skills go on as they were"), "{unread:?}");
    for _ in 0..50 {
        assert_eq!(walking.tick().active, "walk", "undisturbed");
    }
    let gone = after(&mut walking, &|| fixture.add_deployment("stairs", &["bad"]));
    assert_eq!((names(&gone).as_str(), gone.active.as_str()), ("bad", "stand"), "{gone:?}");
    let why = "skill walk is gone while it drives: stop";
    assert!(gone.stopped && gone.events.iter().any(|event| event == why), "{gone:?}");
    assert!(walking.stands());
    for _ in 0..100 {
        assert_eq!(walking.tick().active, "stand");
    }
    assert!(walking.is_on_its_feet());
}
