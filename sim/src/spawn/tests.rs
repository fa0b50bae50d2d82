use std::{path::Path, sync::Arc};

use super::*;
use crate::{plant::PlantKind, stream::stream, terrain::TerrainKind};

fn robot() -> Arc<RobotModel> {
    let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
    Arc::new(RobotModel::load(&robots, "anymal_d").unwrap())
}

fn spawn(kind: TerrainKind, size_m: f32, row: u64) -> Result<Spawn, NoValidPose> {
    let robot = robot();
    let terrain = Terrain::tile(kind, size_m, row);
    let mut plant = Plant::new(&robot, &terrain, PlantKind::Reference);
    Spawner::new(&robot, SpawnRules::default()).settle(&mut plant, &terrain, &mut stream(1, "pose", &[row]))
}

#[test]
fn every_pose_on_flat_ground_is_valid_at_once() {
    for row in 0..10 {
        let spawn = spawn(TerrainKind::Flat, 0.0, row).unwrap();
        assert_eq!(spawn.attempts, 1, "row {row}");
        assert!((spawn.heightfield.cells_m[10][5] + spawn.base.position_m[2]).abs() < 1e-5);
    }
}

#[test]
fn a_pose_repeats_and_rows_differ() {
    let at = |row| spawn(TerrainKind::StairsUp, 0.1, row).unwrap().base;
    assert_eq!(at(4), at(4));
    assert_ne!(at(4).position_m, at(5).position_m);
}

#[test]
fn no_valid_pose_has_a_foot_in_a_trench_or_the_base_on_a_step() {
    for row in 0..8 {
        let spawn = spawn(TerrainKind::Gap, 0.8, row).unwrap();
        let [x_m, _, z_m] = spawn.base.position_m;
        assert!(z_m > 0.3, "row {row}: base at {x_m}, {z_m}");
    }
}

#[test]
fn the_settled_robot_stands_still() {
    let robot = robot();
    let terrain = Terrain::tile(TerrainKind::StairsUp, 0.1, 0);
    let mut plant = Plant::new(&robot, &terrain, PlantKind::Reference);
    let spawner = Spawner::new(&robot, SpawnRules::default());
    for row in 0..5 {
        spawner.settle(&mut plant, &terrain, &mut stream(1, "pose", &[row])).unwrap();
        let speed = plant.measure().base_linear_velocity.iter().fold(0.0, |s: f32, v| s.max(v.abs()));
        assert!(speed < 0.1, "row {row}: {speed} m/s");
    }
}
