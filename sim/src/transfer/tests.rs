use std::{
    io::{Cursor, Write},
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
};

use serde_json::{Value, json};
use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::JointTarget;

use super::{MujocoPlant, TransferError, agreement, ground::Ground, link::Link};
use crate::{
    physics::Physics,
    plant::{BasePose, Variation},
    terrain::{Solid, Terrain, TerrainKind},
};

fn robots() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots")
}

fn robot() -> Arc<RobotModel> {
    Arc::new(RobotModel::load(&robots(), "anymal_d").unwrap())
}

/// What a fake was asked.
#[derive(Clone, Default)]
struct Asked(Arc<Mutex<Vec<u8>>>);

impl Write for Asked {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Asked {
    fn lines(&self) -> Vec<Value> {
        let text = String::from_utf8(self.0.lock().unwrap().clone()).unwrap();
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }
}

/// A plant over a fake that gives these answers, one a question, after the greeting.
fn plant(answers: &[Value]) -> (Result<MujocoPlant, TransferError>, Asked) {
    let lines: Vec<String> = answers.iter().map(|answer| format!("{answer}\n")).collect();
    let asked = Asked::default();
    let link = Link::between(Box::new(asked.clone()), Box::new(Cursor::new(lines.concat())), "some-python");
    (MujocoPlant::open(link, Path::new("anymal_d.xml"), &robot()), asked)
}

fn greeting() -> Value {
    json!({"version": "9.9", "mass_kg": 51.5})
}

/// A quarter turn to the left about the vertical, moving along the world's x.
fn state() -> Value {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    json!({
        "joint_position_rad": vec![0.1; 12], "joint_velocity_rad_per_s": vec![0.5; 12],
        "position_m": [1.0, 2.0, 0.5], "orientation_xyzw": [0.0, 0.0, half, half],
        "linear_in_world": [0.7, 0.0, 0.0], "angular_in_base": [0.1, 0.2, 0.3],
        "foot_contact": [true, false, false, true], "base_contact": false, "nonfoot_contact": true,
    })
}

fn targets(position_rad: f32) -> Vec<JointTarget> {
    let target = JointTarget {
        position_rad,
        stiffness_nm_per_rad: 50.0,
        damping_nms_per_rad: 2.0,
        feed_forward_nm: 1.0,
    };
    vec![target; 12]
}

/// The highest of the solids at a point, from the JSON alone.
fn height_m(solids: &[Value], x: f64, y: f64) -> f64 {
    let number = |value: &Value| value.as_f64().unwrap();
    let mut top_m = f64::NEG_INFINITY;
    for solid in solids {
        let body = &solid["box"];
        if body.is_object() {
            let [cx, cy, cz] = [0, 1, 2].map(|axis| number(&body["centre_m"][axis]));
            let [hx, hy, hz] = [0, 1, 2].map(|axis| number(&body["half_extents_m"][axis]));
            if (x - cx).abs() <= hx && (y - cy).abs() <= hy {
                top_m = top_m.max(cz + hz);
            }
            continue;
        }
        let grid = &solid["grid"];
        let columns = grid["columns"].as_u64().unwrap() as usize;
        let spacing_m = number(&grid["spacing_m"]);
        let [u, v] = [(0, x), (1, y)].map(|(axis, at)| (at - number(&grid["origin_m"][axis])) / spacing_m);
        let at = |i: usize, j: usize| {
            number(&grid["heights_m"][(u.floor() as usize + i) * columns + v.floor() as usize + j])
        };
        let (u, v) = (u.fract(), v.fract());
        // The plane through the three corners of the triangle below the point.
        let height_m = if u + v < 1.0 {
            at(0, 0) * (1.0 - u - v) + at(1, 0) * u + at(0, 1) * v
        } else {
            at(1, 1) * (u + v - 1.0) + at(0, 1) * (1.0 - u) + at(1, 0) * (1.0 - v)
        };
        top_m = top_m.max(height_m);
    }
    top_m
}

#[test]
fn the_ground_as_told_has_the_heights_of_the_terrain() {
    for kind in TerrainKind::ALL {
        let size_m = if kind == TerrainKind::Flat { 0.0 } else { 0.21 };
        let terrain = Terrain::tile(kind, size_m, 7);
        let told = serde_json::to_value(Ground::of(&terrain)).unwrap();
        let solids = told.as_array().unwrap();
        for n in 0..400_u32 {
            let share = |factor: f32| (n as f32 * factor).fract();
            let point = [(0, 0.618_034), (1, 0.414_214)].map(|(axis, factor)| {
                terrain.min_m[axis]
                    + (0.01 + 0.98 * share(factor)) * (terrain.max_m[axis] - terrain.min_m[axis])
            });
            let wanted = f64::from(terrain.height_m(point[0], point[1]));
            let found = height_m(solids, point[0].into(), point[1].into());
            assert!((found - wanted).abs() < 1e-4, "{kind} at {point:?}: told {found}, is {wanted}");
        }
        assert!(terrain.solids.iter().all(|solid| matches!(solid, Solid::Box { .. } | Solid::Grid { .. })));
    }
}

#[test]
fn a_state_is_read_into_the_frames_of_the_reference() {
    let (plant, asked) = plant(&[greeting(), state()]);
    let mut plant = plant.unwrap();
    plant.place(&BasePose::from_yaw([3.0, 4.0, 0.6], 0.0), &[0.2; 12]).unwrap();
    let measured = plant.measure();
    let [forward, left, up] = measured.base_linear_velocity;
    // Facing +y, the world's +x is to the right.
    assert!(forward.abs() < 1e-6 && (left + 0.7).abs() < 1e-6 && up.abs() < 1e-6, "{measured:?}");
    assert_eq!(measured.base_angular_velocity, [0.1, 0.2, 0.3]);
    assert!((measured.projected_gravity[2] + 1.0).abs() < 1e-6, "{measured:?}");
    assert_eq!(measured.foot_contact, [true, false, false, true]);
    assert!(measured.nonfoot_contact && !measured.base_contact);
    let lines = asked.lines();
    assert_eq!(lines[0]["do"], "open");
    assert_eq!(lines[0]["joints"][2], "LF_KFE");
    assert_eq!(lines[0]["feet"], json!(["LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT"]));
    assert_eq!(lines[0]["base_shapes"].as_array().unwrap().len(), 5);
    assert_eq!(lines[1]["do"], "place");
    assert_eq!(lines[1]["joint_position_rad"].as_array().unwrap().len(), 12);
}

#[test]
fn torques_and_work_are_those_of_the_drives() {
    let mut later = state();
    later["joint_velocity_rad_per_s"] = json!(vec![1.5; 12]);
    let (plant, asked) = plant(&[greeting(), state(), json!({}), later]);
    let mut plant = plant.unwrap();
    plant.place(&BasePose::from_yaw([0.0; 3], 0.0), &[0.1; 12]).unwrap();
    plant.vary(&Variation { friction: 0.6, base_mass_offset_kg: 2.0, motor_strength: 0.5 });
    plant.step(&targets(0.3));
    let lines = asked.lines();
    assert_eq!(lines[2]["do"], "vary");
    assert!((lines[2]["friction"].as_f64().unwrap() - 0.6).abs() < 1e-6);
    // 0.5·(50·(0.3 − 0.1) − 2·0.5 + 1)
    for torque in lines[3]["torque_nm"].as_array().unwrap() {
        assert!((torque.as_f64().unwrap() - 5.0).abs() < 1e-5, "{torque}");
    }
    // 12 joints, 5 N·m at 1 rad/s on average for 5 ms.
    assert!((plant.positive_work_j() - 0.3).abs() < 1e-6, "{} J", plant.positive_work_j());
    assert!((plant.total_mass_kg() - 53.5).abs() < 1e-4);
    plant.check().unwrap();
}

#[test]
fn a_state_that_is_not_a_number_fails_the_rollout_and_nothing_else() {
    let (plant, _) = plant(&[greeting(), state(), json!({"diverged": true}), state()]);
    let mut plant = plant.unwrap();
    let pose = BasePose::from_yaw([0.0; 3], 0.0);
    plant.place(&pose, &[0.1; 12]).unwrap();
    plant.step(&targets(0.3));
    assert!(plant.measure().base.position_m[0].is_nan());
    plant.check().unwrap();
    plant.place(&pose, &[0.1; 12]).unwrap();
    assert_eq!(plant.measure().base.position_m, [1.0, 2.0, 0.5]);
}

#[test]
fn a_process_that_ends_or_complains_says_what_it_was_asked() {
    let pose = BasePose::from_yaw([0.0; 3], 0.0);
    for (answer, wanted) in [
        (vec![], "asked to place the robot: found its end"),
        (vec![json!({"error": "KeyError: LF"})], "MuJoCo could not place the robot: KeyError: LF"),
        (vec![json!({"joint_position_rad": []})], "wanted a line of JSON"),
    ] {
        let (plant, _) = plant(&[vec![greeting()], answer].concat());
        let mut plant = plant.unwrap();
        let error = plant.place(&pose, &[0.1; 12]).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
        assert!(plant.measure().base.position_m[0].is_nan(), "no rollout goes on from here");
    }
}

#[test]
fn a_missing_package_and_another_robot_are_named() {
    let (plant, _) = plant(&[json!({"missing": "No module named 'mujoco'"})]);
    let error = plant.err().unwrap().to_string();
    assert!(error.contains("some-python") && error.contains("pip install mujoco"), "{error}");
    let (plant, _) = self::plant(&[json!({"version": "9.9", "mass_kg": 51.0})]);
    let error = plant.err().unwrap().to_string();
    assert!(error.contains("found 51.000 kg, wanted 51.500"), "{error}");
}

fn pairs(both: usize, first: usize, second: usize, neither: usize) -> impl Iterator<Item = (bool, bool)> {
    [((true, true), both), ((true, false), first), ((false, true), second), ((false, false), neither)]
        .into_iter()
        .flat_map(|(pair, count)| std::iter::repeat_n(pair, count))
}

#[test]
fn the_interval_of_a_difference_has_its_published_value() {
    // Newcombe (1998), 10 of 10 against none of 10: 0.6075 to 1.
    let all = agreement(pairs(0, 0, 10, 0));
    assert_eq!((all.n, all.points), (10, 100.0));
    assert!((all.points_low - 60.75).abs() < 0.02 && all.points_high > 99.99, "{all:?}");
    let none = agreement(pairs(0, 0, 0, 0));
    assert_eq!((none.points_low, none.points_high), (-100.0, 100.0));
}

#[test]
fn the_difference_changes_its_sign_with_the_order_and_pairs_narrow_its_interval() {
    let [one, other] = [agreement(pairs(40, 8, 2, 10)), agreement(pairs(40, 2, 8, 10))];
    assert!((one.points + 10.0).abs() < 1e-9 && (other.points - 10.0).abs() < 1e-9);
    assert!((one.points_low + other.points_high).abs() < 1e-9, "{one:?} {other:?}");
    // The same shares, 48 and 42 of 60, but no pair agrees more than by chance.
    let loose = agreement(pairs(34, 14, 8, 4));
    let width = |of: &super::Agreement| of.points_high - of.points_low;
    assert!((loose.points - one.points).abs() < 1e-9 && width(&one) < width(&loose), "{one:?} {loose:?}");
}

#[test]
fn a_stand_is_timed_with_the_stands_own_gains_and_the_drives_effort() {
    let (plant, asked) = plant(&[greeting(), json!({"step_us": 12.5})]);
    let step_us = plant.unwrap().standing_step_us().unwrap();
    assert!((step_us - 12.5).abs() < 1e-12);
    let question = asked.lines().remove(1);
    let robot = robot();
    let gain = |name: &str| question[name].as_f64().unwrap() as f32;
    assert_eq!(question["do"], "time_stand");
    assert_eq!(question["position_rad"].as_array().unwrap().len(), robot.joint_count());
    assert!((gain("stiffness_nm_per_rad") - robot.stand.stiffness_nm_per_rad).abs() < 1e-6);
    assert!((gain("damping_nms_per_rad") - robot.stand.damping_nms_per_rad).abs() < 1e-6);
    assert!((gain("effort_nm") - robot.drive.effort_nm).abs() < 1e-6);
}
