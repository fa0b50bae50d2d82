//! The robot file opens unmodified in rapier's own MJCF reader, with the bodies, joints and mass that
//! this project's reader finds in it.

use rapier3d::prelude::*;
use rapier3d_mjcf::{MjcfLoaderOptions, MjcfMultibodyOptions, MjcfRobot};
use vocaloco_core::robot::RobotModel;
use vocaloco_tests::repository;

#[test]
fn rapiers_own_reader_sees_the_same_robot() {
    let robots = repository().join("manifests/robots");
    let path = robots.join("anymal_d.xml");
    let (loaded, _) = MjcfRobot::from_file(&path, MjcfLoaderOptions::default()).expect("the file opens");
    let (mut bodies, mut colliders) = (RigidBodySet::new(), ColliderSet::new());
    let (mut multibodies, mut impulses) = (MultibodyJointSet::new(), ImpulseJointSet::new());
    loaded.insert_using_multibody_joints(
        &mut bodies,
        &mut colliders,
        &mut multibodies,
        &mut impulses,
        MjcfMultibodyOptions::default(),
    );
    for (_, body) in bodies.iter_mut() {
        body.recompute_mass_properties_from_colliders(&colliders);
    }
    let robot = RobotModel::load(&robots, "anymal_d").expect("the shipped robot");
    let masses_kg: Vec<f32> =
        bodies.iter().filter(|(_, body)| body.is_dynamic()).map(|(_, body)| body.mass()).collect();
    let mass_kg: f32 = masses_kg.iter().sum();
    assert_eq!(masses_kg.len(), robot.links.len());
    assert_eq!(multibodies.iter().count(), robot.joint_count());
    assert!((f64::from(mass_kg) - robot.description.mass_kg).abs() < 1e-3, "{mass_kg} kg");
}
