use std::path::PathBuf;
use std::sync::Arc;

use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::JointTarget;

use super::*;
use crate::terrain::{Terrain, TerrainKind};

fn robot() -> Arc<RobotModel> {
    let robots = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
    Arc::new(RobotModel::load(&robots, "anymal_d").expect("the shipped robot"))
}

fn flat() -> Terrain {
    Terrain::tile(TerrainKind::Flat, 0.0, 1)
}

/// Targets that hold the stand.
fn stand(robot: &RobotModel) -> Vec<JointTarget> {
    let hold = |position: &f32| JointTarget {
        position_rad: *position,
        stiffness_nm_per_rad: robot.stand.stiffness_nm_per_rad,
        damping_nms_per_rad: robot.stand.damping_nms_per_rad,
        feed_forward_nm: 0.0,
    };
    robot.stand_position_rad().iter().map(hold).collect()
}

#[test]
fn the_stand_holds_on_flat_ground() {
    let robot = robot();
    let targets = stand(&robot);
    for kind in [PlantKind::Reference, PlantKind::Fast] {
        let mut plant = Plant::new(&robot, &flat(), kind);
        for _ in 0..600 {
            plant.step(&targets);
        }
        let measured = plant.measure();
        let sunk = robot.description.stand_height_m as f32 - measured.base.position_m[2];
        assert!((0.0..0.03).contains(&sunk), "{kind:?}: sank by {sunk} m");
        assert!(measured.projected_gravity[2] < -0.999, "{kind:?}: {:?}", measured.projected_gravity);
        assert!(measured.base.position_m[0].abs() < 0.01 && measured.base.position_m[1].abs() < 0.01);
        assert_eq!(measured.foot_contact, [true; 4], "{kind:?}");
        assert!(!measured.base_contact && !measured.nonfoot_contact, "{kind:?}");
        assert!(measured.joint_velocity_rad_per_s.iter().all(|v| v.abs() < 0.01), "{kind:?}");
    }
}
