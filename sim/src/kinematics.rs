//! Where the links are, from the robot's description alone: what pictures are drawn from.

use rapier3d::math::{Rotation, Vector};
use vocaloco_plugin_api::RobotDescription;

use crate::plant::BasePose;

/// Poses of all links in the world, the base first, link `i + 1` behind joint `i`.
///
/// ```text
/// p_link = p_parent + R_parent·origin,   R_link = R_parent·exp(axis·q)
/// ```
///
/// | argument | meaning | unit | shape |
/// |---|---|---|---|
/// | `base` | the base's frame in the world | m | |
/// | `joint_position_rad` | q, in the robot's joint order | rad | `[joint]` |
pub fn forward_kinematics(
    robot: &RobotDescription,
    base: &BasePose,
    joint_position_rad: &[f32],
) -> Vec<BasePose> {
    let mut links = Vec::with_capacity(robot.joints.len() + 1);
    links.push(*base);
    for (joint, q) in robot.joints.iter().zip(joint_position_rad) {
        let parent = links[usize::try_from(joint.parent + 1).unwrap_or(0)];
        let (sine, cosine) = (libm::sinf(0.5 * q), libm::cosf(0.5 * q));
        let [x, y, z] = joint.axis.map(|component| component as f32 * sine);
        let [px, py, pz, pw] = parent.orientation_xyzw;
        let rotation = Rotation::from_xyzw(px, py, pz, pw) * Rotation::from_xyzw(x, y, z, cosine);
        let origin = parent.vector_in_world(joint.origin_in_parent_m.map(|component| component as f32));
        let position = Vector::from_array(parent.position_m) + Vector::from_array(origin);
        links.push(BasePose {
            position_m: position.to_array(),
            orientation_xyzw: rotation.normalize().to_array(),
        });
    }
    links
}

/// Each leg as a line in the world: the origins of its joints from the base outwards, then the
/// centre of its foot; legs in the order of the robot's feet.
pub fn legs(robot: &RobotDescription, links: &[BasePose]) -> Vec<Vec<[f32; 3]>> {
    let leg = |foot: &vocaloco_plugin_api::FootDescription| {
        let mut points = Vec::new();
        let mut joint = foot.joint as usize;
        loop {
            points.push(links[joint + 1].position_m);
            match usize::try_from(robot.joints[joint].parent) {
                Ok(parent) => joint = parent,
                Err(_) => break,
            }
        }
        points.reverse();
        let shank = &links[foot.joint as usize + 1];
        let offset = shank.vector_in_world(foot.centre_in_link_m.map(|component| component as f32));
        points.push((Vector::from_array(shank.position_m) + Vector::from_array(offset)).to_array());
        points
    };
    robot.feet.iter().map(leg).collect()
}

#[cfg(test)]
mod tests {
    use std::{path::Path, sync::Arc};

    use vocaloco_core::robot::RobotModel;

    use super::*;
    use crate::{
        plant::{Plant, PlantKind},
        terrain::{Terrain, TerrainKind},
    };

    fn anymal_d() -> Arc<RobotModel> {
        let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        Arc::new(RobotModel::load(&robots, "anymal_d").unwrap())
    }

    /// Different in every joint, so that a swapped leg or a mirrored axis shows.
    fn asymmetric(robot: &RobotModel) -> Vec<f32> {
        robot.stand_position_rad().iter().enumerate().map(|(i, q)| q + 0.03 * (i as f32 - 4.0)).collect()
    }

    #[test]
    fn links_lie_where_the_physics_engine_has_them() {
        let robot = anymal_d();
        let mut plant = Plant::new(&robot, &Terrain::tile(TerrainKind::Flat, 0.0, 1), PlantKind::Reference);
        let base = BasePose::from_roll_pitch_yaw([0.7, -0.4, 1.3], 0.2, -0.3, 1.1);
        let q = asymmetric(&robot);
        plant.place(&base, &q);
        let computed = forward_kinematics(&robot.description, &base, &q);
        for (index, (engine, ours)) in plant.link_poses().zip(&computed).enumerate() {
            for axis in 0..3 {
                let (found, wanted) = (ours.position_m[axis], engine.position_m[axis]);
                assert!((found - wanted).abs() < 1e-4, "link {index}, axis {axis}: {found} for {wanted}");
            }
        }
    }

    #[test]
    fn every_leg_runs_from_the_base_to_its_foot() {
        let robot = anymal_d();
        let base = BasePose::from_yaw([0.0, 0.0, robot.description.stand_height_m as f32], 0.0);
        let links = forward_kinematics(&robot.description, &base, &robot.stand_position_rad());
        let legs = legs(&robot.description, &links);
        assert_eq!(legs.iter().map(Vec::len).collect::<Vec<_>>(), [4; 4], "three joints and a foot");
        for (leg, foot) in legs.iter().zip(&robot.description.feet) {
            let height = leg[3][2] - foot.radius_m as f32;
            assert!(height.abs() < 0.02, "{} stands {height} m above the ground", foot.name);
        }
        assert!(legs[0][3][0] > 0.0 && legs[0][3][1] > 0.0, "the first foot is left fore");
        assert!(legs[3][3][0] < 0.0 && legs[3][3][1] < 0.0, "the last foot is right hind");
    }
}
