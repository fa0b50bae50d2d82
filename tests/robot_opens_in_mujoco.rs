//! The robot file opens unmodified in MuJoCo, and both simulators move it alike: mass, joint names and
//! ranges, standing height, trajectories under the same torques, each within its stated tolerance.
//! Needs the feature `peers` and then `python3` with the package `mujoco`.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Arc;

use serde_json::{Value, json};
use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::JointTarget;
use vocaloco_sim::plant::{BasePose, Plant, PlantKind, STEP_S};
use vocaloco_sim::terrain::{Terrain, TerrainKind};
use vocaloco_tests::repository;

/// Physics steps of every run: one second.
const STEPS: usize = 200;
/// The reference plant's solver iterations are substeps; the peer takes as many.
const SUBSTEPS: usize = PlantKind::Reference.engine().iterations;
const STIFFNESS: f32 = 95.0;
const DAMPING: f32 = 3.6;

fn robots() -> PathBuf {
    repository().join("manifests/robots")
}

fn robot() -> Arc<RobotModel> {
    Arc::new(RobotModel::load(&robots(), "anymal_d").expect("the shipped robot"))
}

/// Runs the peer.
fn ask(runs: &[Value]) -> Value {
    let request = json!({"model": robots().join("anymal_d.xml"), "runs": runs});
    let mut child = Command::new("python3")
        .arg(repository().join("tests/peers/robot_in_mujoco.py"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("python3 starts");
    let mut stdin = child.stdin.take().expect("a pipe");
    stdin.write_all(request.to_string().as_bytes()).expect("the request is written");
    drop(stdin);
    let output = child.wait_with_output().expect("the peer ends");
    assert!(output.status.success(), "python3 with the package mujoco ran");
    serde_json::from_slice(&output.stdout).expect("a JSON answer")
}

fn run(robot: &RobotModel, name: &str, height_m: f64, rows: (&str, &[Vec<f32>])) -> Value {
    let stand: serde_json::Map<String, Value> = robot
        .description
        .joints
        .iter()
        .map(|joint| (joint.name.to_string(), json!(joint.stand_rad)))
        .collect();
    let drive = robot.drive;
    json!({
        "name": name, "substeps": SUBSTEPS, "height_m": height_m, "joint_position_rad": stand,
        rows.0: rows.1, "stiffness": STIFFNESS, "damping": DAMPING, "effort_nm": drive.effort_nm,
        "saturation_nm": drive.saturation_nm,
        "velocity_limit_rad_per_s": drive.velocity_limit_rad_per_s,
    })
}

/// A plant at rest at a height, in the stand, on flat ground.
fn plant(robot: &Arc<RobotModel>, height_m: f64) -> Plant {
    let flat = Terrain::tile(TerrainKind::Flat, 0.0, 1);
    let mut plant = Plant::new(robot, &flat, PlantKind::Reference);
    let pose = BasePose::from_yaw([0.0, 0.0, height_m as f32], 0.0);
    plant.place(&pose, &robot.stand_position_rad());
    plant
}

fn follow(plant: &mut Plant, positions: &[f32]) {
    let target = |position: &f32| JointTarget {
        position_rad: *position,
        stiffness_nm_per_rad: STIFFNESS,
        damping_nms_per_rad: DAMPING,
        feed_forward_nm: 0.0,
    };
    let targets: Vec<JointTarget> = positions.iter().map(target).collect();
    plant.step(&targets);
}

/// Every joint on a sine of its own around the stand.
fn sines(robot: &RobotModel, step: usize) -> Vec<f32> {
    let stand = robot.stand_position_rad();
    let sine = |joint: usize| {
        let cycles = (1.0 + 0.1 * joint as f32) * step as f32 * STEP_S;
        0.25 * (std::f32::consts::TAU * cycles).sin()
    };
    (0..stand.len()).map(|joint| stand[joint] + sine(joint)).collect()
}

/// Diagonal legs lifted in turn.
fn trot(robot: &RobotModel, step: usize) -> Vec<f32> {
    let phase = (std::f32::consts::TAU * step as f32 * STEP_S / 0.5).sin();
    let mut positions = robot.stand_position_rad();
    for (joint, position) in positions.iter_mut().enumerate() {
        let diagonal = if matches!(joint / 3, 0 | 3) { 1.0 } else { -1.0 };
        let front = if joint < 6 { 1.0 } else { -1.0 };
        *position += front * [0.0, 0.35, -0.7][joint % 3] * (diagonal * phase).max(0.0);
    }
    positions
}

/// Largest and root mean square difference of joint positions, rad, with the worst joint and step.
fn compare(robot: &RobotModel, ours: &[Vec<f32>], theirs: &Value) -> (f64, f64, String) {
    let (mut worst, mut sum, mut at) = (0.0_f64, 0.0, String::new());
    for (step, row) in ours.iter().enumerate() {
        for (joint, position) in row.iter().enumerate() {
            let peer = theirs["joint_position_rad"][step][joint].as_f64().expect("a number");
            let gap = (f64::from(*position) - peer).abs();
            sum += gap * gap;
            if gap > worst {
                worst = gap;
                at = format!("{} at step {step}", robot.description.joints[joint].name);
            }
        }
    }
    (worst, (sum / (ours.len() * robot.joint_count()) as f64).sqrt(), at)
}

#[test]
fn mass_joints_and_ranges_agree() {
    let robot = robot();
    let answer = ask(&[]);
    let mass_kg = answer["mass_kg"].as_f64().expect("a mass");
    assert!((mass_kg - robot.description.mass_kg).abs() < 1e-9, "{mass_kg} kg");
    assert_eq!(answer["bodies"], robot.links.len());
    let joints = answer["joints"].as_array().expect("joints");
    assert_eq!(joints.len(), robot.joint_count());
    for ((peer, ours), link) in joints.iter().zip(&robot.description.joints).zip(&robot.links[1..]) {
        assert_eq!(peer["name"], ours.name.as_str());
        for (field, value) in [
            ("lower_rad", ours.lower_rad),
            ("upper_rad", ours.upper_rad),
            ("armature_kg_m2", link.armature_kg_m2),
        ] {
            let found = peer[field].as_f64().expect("a number");
            assert!((found - value).abs() < 1e-9, "{} {field}: {found}, ours {value}", ours.name);
        }
    }
}

/// Both stand on soft contacts of different kinds: 2 mm and 0.002 rad apart at most after a second.
#[test]
fn standing_height_agrees() {
    let robot = robot();
    let height_m = robot.description.stand_height_m;
    let rows = vec![robot.stand_position_rad(); STEPS];
    let answer = ask(&[run(&robot, "stand", height_m, ("target_rad", &rows))]);
    let theirs = &answer["runs"]["stand"];
    let mut plant = plant(&robot, height_m);
    for row in &rows {
        follow(&mut plant, row);
    }
    let ours_m = f64::from(plant.measure().base.position_m[2]);
    let theirs_m = theirs["base_position_m"][STEPS - 1][2].as_f64().expect("a height");
    assert!((ours_m - theirs_m).abs() < 0.002, "ours {ours_m} m, theirs {theirs_m} m");
    for (joint, position) in plant.measure().joint_position_rad.iter().enumerate() {
        let peer = theirs["joint_position_rad"][STEPS - 1][joint].as_f64().expect("a number");
        let gap = (f64::from(*position) - peer).abs();
        assert!(gap < 0.002, "{}: {gap} rad apart", robot.description.joints[joint].name);
    }
}

/// The same torques, joint for joint and step for step, in free fall, where nothing feeds back: after
/// 0.1 s 5e-4 rad and after a second 0.02 rad apart at most.
#[test]
fn trajectories_under_the_same_torques_agree() {
    let robot = robot();
    let mut driven = plant(&robot, 50.0);
    let (mut torques, mut ours) = (Vec::new(), Vec::new());
    for step in 0..STEPS {
        follow(&mut driven, &sines(&robot, step));
        torques.push(driven.measure().joint_torque_nm.clone());
        ours.push(driven.measure().joint_position_rad.clone());
    }
    assert!(torques.iter().flatten().any(|torque| torque.abs() > 15.0));
    let answer = ask(&[run(&robot, "fall", 50.0, ("torque_nm", &torques))]);
    let theirs = &answer["runs"]["fall"];
    let (early, _, at) = compare(&robot, &ours[..20], theirs);
    assert!(early < 5e-4, "{early} rad apart in 0.1 s: {at}");
    let (late, _, at) = compare(&robot, &ours, theirs);
    assert!(late < 0.02, "{late} rad apart in 1 s: {at}");
}

/// Drives following a trot on the ground: contacts differ, so does the timing of impacts; the joints
/// stay within 0.02 rad (root mean square) of each other.
#[test]
fn a_trot_on_the_ground_agrees() {
    let robot = robot();
    let height_m = robot.description.stand_height_m;
    let rows: Vec<Vec<f32>> = (0..STEPS).map(|step| trot(&robot, step)).collect();
    let answer = ask(&[run(&robot, "trot", height_m, ("target_rad", &rows))]);
    let mut plant = plant(&robot, height_m);
    let ours: Vec<Vec<f32>> = rows
        .iter()
        .map(|row| {
            follow(&mut plant, row);
            plant.measure().joint_position_rad.clone()
        })
        .collect();
    let (worst, rms, at) = compare(&robot, &ours, &answer["runs"]["trot"]);
    assert!(rms < 0.02, "{rms} rad apart on average, {worst} rad: {at}");
}
