//! Measures the engine's settings against each other and against MuJoCo: the table of docs/plant.md.
//!
//! `cargo run -p vocaloco-sim --example plant_table`; the last two columns, root mean square differences
//! of the joint positions over a second in rad from MuJoCo at a fine step, need `python3` with `mujoco`.

#![allow(clippy::print_stdout, reason = "a table is its result")]

use std::io::Write as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Instant;

use serde_json::{Value, json};
use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::JointTarget;
use vocaloco_sim::plant::{BasePose, Engine, GRAVITY_M_PER_S2, JointKind, Plant, PlantKind, STEP_S};
use vocaloco_sim::terrain::{Terrain, TerrainKind};

/// Steps of each comparison.
const STEPS: usize = 200;

fn repository() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A trot in place: diagonal legs are lifted in turn.
fn trot(robot: &RobotModel, step: usize) -> Vec<f32> {
    let phase = std::f32::consts::TAU * step as f32 * STEP_S / 0.5;
    let lift = |leg: usize| {
        let side = if leg == 0 || leg == 3 { 1.0 } else { -1.0 };
        (side * phase.sin()).max(0.0)
    };
    let stand = robot.stand_position_rad();
    (0..stand.len())
        .map(|joint| {
            let (leg, front) = (joint / 3, if joint < 6 { 1.0 } else { -1.0 });
            let bend = [0.0, 0.35, -0.7][joint % 3];
            stand[joint] + front * bend * lift(leg)
        })
        .collect()
}

fn targets(positions: &[f32], stiffness: f32, damping: f32) -> Vec<JointTarget> {
    let target = |position: &f32| JointTarget {
        position_rad: *position,
        stiffness_nm_per_rad: stiffness,
        damping_nms_per_rad: damping,
        feed_forward_nm: 0.0,
    };
    positions.iter().map(target).collect()
}

/// Torques that swing all joints about inside their ranges, each in its own time, in free fall: what
/// the reference's drives gave while following sines.
fn swing(robot: &Arc<RobotModel>, terrain: &Terrain) -> Vec<Vec<f32>> {
    let mut plant = Plant::new(robot, terrain, PlantKind::Reference);
    plant.place(&high_up(), &robot.stand_position_rad());
    let row = |step: usize| {
        let sine = |joint: usize| {
            let frequency_hz = 1.0 + 0.1 * joint as f32;
            0.25 * (std::f32::consts::TAU * frequency_hz * step as f32 * STEP_S).sin()
        };
        let stand = robot.stand_position_rad();
        let positions: Vec<f32> = (0..stand.len()).map(|joint| stand[joint] + sine(joint)).collect();
        plant.step(&targets(&positions, 95.0, 3.6));
        plant.measure().joint_torque_nm.clone()
    };
    (0..STEPS).map(row).collect()
}

/// Where nothing is touched for seconds.
fn high_up() -> BasePose {
    BasePose::from_yaw([0.0, 0.0, 50.0], 0.0)
}

/// The fastest of 30 rounds of 100 steps of the trot, µs a step.
fn us_per_step(robot: &Arc<RobotModel>, terrain: &Terrain, engine: Engine) -> f64 {
    let mut plant = Plant::with_engine(robot, terrain, engine);
    let ground = terrain.height_m(1.0, 0.0);
    let height = robot.description.stand_height_m as f32 + ground + 0.01;
    let rows: Vec<Vec<JointTarget>> = (0..100).map(|step| targets(&trot(robot, step), 95.0, 3.6)).collect();
    (0..30)
        .map(|_| {
            plant.place(&BasePose::from_yaw([1.0, 0.0, height], 0.0), &robot.stand_position_rad());
            #[expect(clippy::disallowed_methods, reason = "this program measures time")]
            let start = Instant::now();
            for row in &rows {
                plant.step(row);
            }
            start.elapsed().as_secs_f64() * 1e6 / rows.len() as f64
        })
        .fold(f64::INFINITY, f64::min)
}

/// Largest gap between work and kinetic energy, as a share of the work turned over, joints swinging in
/// free fall; gravity's work is taken by the same trapezoid as the joints'.
fn work_balance(robot: &Arc<RobotModel>, terrain: &Terrain, engine: Engine, torques: &[Vec<f32>]) -> f64 {
    let mut plant = Plant::with_engine(robot, terrain, engine);
    plant.place(&high_up(), &robot.stand_position_rad());
    let mut gravity_j = 0.0;
    let mut turned_over_j = 0.0;
    let mut worst_j: f64 = 0.0;
    for row in torques {
        let (before, work_before_j) = (plant.momentum(), plant.signed_work_j());
        plant.step_torques(row);
        let after = plant.momentum();
        let mean = 0.5 * (before.vertical_kg_m_per_s + after.vertical_kg_m_per_s);
        gravity_j -= f64::from(GRAVITY_M_PER_S2 * STEP_S) * mean;
        turned_over_j += (plant.signed_work_j() - work_before_j).abs();
        worst_j = worst_j.max((after.kinetic_energy_j - gravity_j - plant.signed_work_j()).abs());
    }
    worst_j / turned_over_j
}

fn peer(robot: &RobotModel, torques: &[Vec<f32>]) -> Option<Value> {
    let stand: serde_json::Map<String, Value> = robot
        .description
        .joints
        .iter()
        .map(|joint| (joint.name.to_string(), json!(joint.stand_rad)))
        .collect();
    let drive = robot.drive;
    let run = |name: &str, substeps: usize| {
        json!({
            "name": name, "substeps": substeps, "joint_position_rad": stand,
            "stiffness": 95.0, "damping": 3.6, "effort_nm": drive.effort_nm,
            "saturation_nm": drive.saturation_nm,
            "velocity_limit_rad_per_s": drive.velocity_limit_rad_per_s,
        })
    };
    let rows = |row: &dyn Fn(usize) -> Vec<f32>| -> Vec<Vec<f32>> { (0..STEPS).map(row).collect() };
    let mut fall = run("fall", 1);
    fall["height_m"] = json!(50.0);
    fall["torque_nm"] = json!(torques);
    let mut fine = fall.clone();
    fine["name"] = json!("fall_fine");
    fine["substeps"] = json!(50);
    let mut trotting = run("trot", 1);
    trotting["height_m"] = json!(robot.description.stand_height_m);
    trotting["target_rad"] = json!(rows(&|step| trot(robot, step)));
    let mut trotting_fine = trotting.clone();
    trotting_fine["name"] = json!("trot_fine");
    trotting_fine["substeps"] = json!(10);
    let request = json!({
        "model": repository().join("manifests/robots/anymal_d.xml"),
        "runs": [fall, fine, trotting, trotting_fine],
    });
    let mut child = Command::new("python3")
        .arg(repository().join("tests/peers/robot_in_mujoco.py"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .ok()?;
    child.stdin.take()?.write_all(request.to_string().as_bytes()).ok()?;
    let output = child.wait_with_output().ok()?;
    serde_json::from_slice(&output.stdout).ok()
}

/// Root mean square difference of the joint positions from a run of the peer's, rad.
fn deviation(ours: &[Vec<f32>], theirs: &Value) -> f64 {
    let mut sum = 0.0;
    let mut n = 0;
    for (row, peer) in ours.iter().zip(theirs["joint_position_rad"].as_array().into_iter().flatten()) {
        for (joint, value) in row.iter().enumerate() {
            sum += (f64::from(*value) - peer[joint].as_f64().unwrap_or(f64::NAN)).powi(2);
            n += 1;
        }
    }
    (sum / f64::from(n)).sqrt()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let robot = Arc::new(RobotModel::load(&repository().join("manifests/robots"), "anymal_d")?);
    let flat = Terrain::tile(TerrainKind::Flat, 0.0, 1);
    let stairs = Terrain::tile(TerrainKind::StairsUp, 0.1, 1);
    let rough = Terrain::tile(TerrainKind::Rough, 0.05, 1);
    let torques = swing(&robot, &flat);
    let peer = peer(&robot, &torques);
    let engines = [
        ("multibody, 1 iteration", JointKind::Multibody, 1),
        ("multibody, 2 iterations", JointKind::Multibody, 2),
        ("multibody, 4 iterations", JointKind::Multibody, 4),
        ("reduced, 1 iteration", JointKind::Reduced, 1),
        ("reduced, 2 iterations", JointKind::Reduced, 2),
        ("reduced, 4 iterations", JointKind::Reduced, 4),
        ("impulse joints, 2 iterations", JointKind::Impulse, 2),
        ("impulse joints, 4 iterations", JointKind::Impulse, 4),
        ("impulse joints, 8 iterations", JointKind::Impulse, 8),
    ];
    println!("| engine | flat | stairs | rough | work balance | free fall | trot |");
    println!("|---|---|---|---|---|---|---|");
    for (name, joints, iterations) in engines {
        let engine = Engine { joints, iterations };
        let [flat_us, stairs_us, rough_us] =
            [&flat, &stairs, &rough].map(|terrain| us_per_step(&robot, terrain, engine));
        let balance = work_balance(&robot, &flat, engine, &torques);
        let mut fall = Vec::new();
        let mut plant = Plant::with_engine(&robot, &flat, engine);
        plant.place(&high_up(), &robot.stand_position_rad());
        for row in &torques {
            plant.step_torques(row);
            fall.push(plant.measure().joint_position_rad.clone());
        }
        let mut trotting = Vec::new();
        let height = robot.description.stand_height_m as f32;
        plant.place(&BasePose::from_yaw([0.0, 0.0, height], 0.0), &robot.stand_position_rad());
        for step in 0..STEPS {
            plant.step(&targets(&trot(&robot, step), 95.0, 3.6));
            trotting.push(plant.measure().joint_position_rad.clone());
        }
        let against = |ours: &[Vec<f32>], name: &str| {
            peer.as_ref().map_or(f64::NAN, |answer| deviation(ours, &answer["runs"][name]))
        };
        println!(
            "| {name} | {flat_us:.0} | {stairs_us:.0} | {rough_us:.0} | {:.2} % | {:.4} | {:.4} |",
            100.0 * balance,
            against(&fall, "fall_fine"),
            against(&trotting, "trot_fine"),
        );
    }
    if let Some(answer) = &peer {
        let itself = |run: &str, fine: &str| -> Result<f64, serde_json::Error> {
            let positions = answer["runs"][run]["joint_position_rad"].clone();
            let rows: Vec<Vec<f32>> = serde_json::from_value(positions)?;
            Ok(deviation(&rows, &answer["runs"][fine]))
        };
        let (fall, trot) = (itself("fall", "fall_fine")?, itself("trot", "trot_fine")?);
        println!("| MuJoCo at 5 ms | | | | | {fall:.4} | {trot:.4} |");
    }
    Ok(())
}
