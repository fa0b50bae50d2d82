use std::path::PathBuf;
use std::sync::Arc;

use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::JointTarget;

use super::*;
use crate::{
    plant::{Engine, JointKind, Plant, PlantKind},
    terrain::TerrainKind,
};

fn robot() -> Arc<RobotModel> {
    let robots = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
    Arc::new(RobotModel::load(&robots, "anymal_d").expect("the shipped robot"))
}

fn flat() -> Terrain {
    Terrain::tile(TerrainKind::Flat, 0.0, 1)
}

/// Turned, bent differently in every joint, and moving in every coordinate.
fn moving(robot: &RobotModel) -> Motion {
    let pose = BasePose::from_roll_pitch_yaw([1.0, -2.0, 30.0], 0.3, -0.4, 1.1);
    let mut positions = robot.stand_position_rad();
    for (joint, position) in positions.iter_mut().enumerate() {
        *position += 0.03 * joint as f32 - 0.1;
    }
    let mut motion = Motion::at(&pose, &positions);
    for (index, velocity) in motion.velocity.iter_mut().enumerate() {
        *velocity = 0.4 * libm::sinf(1.0 + 2.0 * index as f32);
    }
    motion
}

/// Targets that swing every joint in its own time.
fn swing(robot: &RobotModel, step: usize) -> Vec<JointTarget> {
    let target = |(joint, stand): (usize, f32)| {
        let cycles = (1.0 + 0.1 * joint as f32) * step as f32 * STEP_S;
        JointTarget {
            position_rad: stand + 0.25 * libm::sinf(std::f32::consts::TAU * cycles),
            stiffness_nm_per_rad: 95.0,
            damping_nms_per_rad: 3.6,
            feed_forward_nm: 0.0,
        }
    };
    robot.stand_position_rad().into_iter().enumerate().map(target).collect()
}

/// ½·uᵀ·M·u through the factor is the energy of the links one by one.
#[test]
fn the_mass_matrix_gives_the_kinetic_energy_of_the_links() {
    let robot = robot();
    let mut tree = Tree::of(&robot);
    let mut inertia = Inertia::for_tree(&tree);
    let motion = moving(&robot);
    tree.pose_links(&motion);
    inertia.assemble(&tree, &motion, 0.0);
    let energy_j = inertia.kinetic_energy_j(&motion.velocity);

    let base = motion.base();
    let velocity = |from: usize| base.vector_in_body([0, 1, 2].map(|axis| motion.velocity[from + axis]));
    let mut measured =
        crate::plant::Measurement::at_rest(base, &motion.joint_position_rad, robot.description.feet.len());
    measured.base_linear_velocity = velocity(0);
    measured.base_angular_velocity = velocity(3);
    measured.joint_velocity_rad_per_s = motion.velocity[BASE_DOFS..].to_vec();
    let by_links = crate::plant::energy::momentum(&robot, &robot.links, &measured, 0.0);
    let wanted_j = by_links.kinetic_energy_j as f32;
    assert!((energy_j - wanted_j).abs() < 1e-4 * wanted_j, "{energy_j} J for {wanted_j} J");
}

#[test]
fn free_fall_is_that_of_the_reference() {
    let robot = robot();
    let fall = |kind: PlantKind| {
        let mut plant = Plant::new(&robot, &flat(), kind);
        plant.place(&BasePose::from_yaw([0.0, 0.0, 50.0], 0.4), &robot.stand_position_rad());
        for step in 0..100 {
            plant.step(&swing(&robot, step));
        }
        plant.measure().clone()
    };
    let (fast, reference) = (fall(PlantKind::Fast), fall(PlantKind::Reference));
    let joints = fast.joint_position_rad.iter().zip(&reference.joint_position_rad);
    for (joint, (fast, reference)) in robot.description.joints.iter().zip(joints) {
        assert!((fast - reference).abs() < 5e-3, "{}: {fast} rad for {reference} rad", joint.name);
    }
    for axis in 0..3 {
        let (fast, reference) = (fast.base.position_m[axis], reference.base.position_m[axis]);
        assert!((fast - reference).abs() < 0.01, "axis {axis}: {fast} m for {reference} m");
    }
}

/// The error is the step length's: halved with every doubling of substeps.
#[test]
fn more_substeps_close_the_gap_to_a_finer_run() {
    let robot = robot();
    let fall = |iterations: usize| {
        let mut plant =
            Plant::with_engine(&robot, &flat(), Engine { joints: JointKind::Reduced, iterations });
        plant.place(&BasePose::from_yaw([0.0, 0.0, 50.0], 0.4), &robot.stand_position_rad());
        for step in 0..100 {
            plant.step(&swing(&robot, step));
        }
        plant.measure().joint_position_rad.clone()
    };
    let fine = fall(32);
    let gap = |iterations: usize| -> f32 {
        fall(iterations).iter().zip(&fine).map(|(coarse, fine)| (coarse - fine).abs()).sum()
    };
    let (one, two, four) = (gap(1), gap(2), gap(4));
    assert!(two < 0.7 * one && four < 0.7 * two, "{one}, {two}, {four} rad");
}

#[test]
fn a_robot_at_rest_presses_its_weight_on_its_feet() {
    let robot = robot();
    let mut plant = Plant::new(&robot, &flat(), PlantKind::Fast);
    for _ in 0..600 {
        plant.step(&swing(&robot, 0));
    }
    let speed = plant.measure().base_linear_velocity;
    assert!(speed.iter().all(|axis| axis.abs() < 1e-3), "{speed:?} m/s");
    let crate::plant::body::Body::Reduced(motion) = &plant.state.body else { panic!("the fast plant") };
    let pressed_ns: f32 = motion.pressing.iter().map(|pressing| pressing.normal_ns).sum();
    let wanted_ns = plant.total_mass_kg() * GRAVITY_M_PER_S2 * STEP_S / 2.0;
    assert!((pressed_ns - wanted_ns).abs() < 0.01 * wanted_ns, "{pressed_ns} N·s for {wanted_ns} N·s");
}
