//! The links as a tree, and where they are in the world.

use rapier3d::math::{Matrix, Rotation, Vector};
use vocaloco_core::robot::RobotModel;

use super::{BasePose, Motion};
use crate::plant::{articulation::parent_link, world::vector};

/// The joint that carries link `i + 1`.
#[derive(Clone)]
pub(super) struct Joint {
    pub(super) parent: usize,
    pub(super) axis: Vector,
    origin_in_parent: Vector,
    pub(super) range_rad: [f32; 2],
}

/// A link's constants.
#[derive(Clone)]
pub(super) struct Body {
    pub(super) mass_kg: f32,
    pub(super) com_in_link: Vector,
    pub(super) inertia: Matrix,
    pub(super) armature_kg_m2: f32,
}

/// Where a link is: axes along the world's, lengths from the base's origin.
#[derive(Clone, Copy)]
pub(super) struct Placed {
    pub(super) rotation: Rotation,
    pub(super) axes: Matrix,
    pub(super) origin: Vector,
    /// Of the joint that carries it.
    pub(super) axis: Vector,
}

/// All links; link `i + 1` hangs behind joint `i`, and no link comes before its parent.
#[derive(Clone)]
pub(super) struct Tree {
    pub(super) joints: Vec<Joint>,
    pub(super) bodies: Vec<Body>,
    pub(super) placed: Vec<Placed>,
    /// By link, the joints between it and the base, the base's first.
    pub(super) path: Vec<Vec<usize>>,
}

impl Tree {
    pub(super) fn of(robot: &RobotModel) -> Self {
        let joint = |(index, joint): (usize, &vocaloco_plugin_api::JointDescription)| Joint {
            parent: parent_link(robot, index),
            axis: vector(joint.axis),
            origin_in_parent: vector(joint.origin_in_parent_m),
            range_rad: [joint.lower_rad as f32, joint.upper_rad as f32],
        };
        let joints: Vec<Joint> = robot.description.joints.iter().enumerate().map(joint).collect();
        let body = |link: &vocaloco_core::robot::Link| Body {
            mass_kg: link.mass_kg as f32,
            com_in_link: vector(link.com_in_link_m),
            // Symmetric, so rows may serve as columns.
            inertia: Matrix::from_cols_array_2d(&link.inertia_kg_m2.map(|row| row.map(|value| value as f32))),
            armature_kg_m2: link.armature_kg_m2 as f32,
        };
        let mut path: Vec<Vec<usize>> = vec![Vec::new()];
        for (index, joint) in joints.iter().enumerate() {
            let mut joints_to_base = path[joint.parent].clone();
            joints_to_base.push(index);
            path.push(joints_to_base);
        }
        let placed = Placed {
            rotation: Rotation::IDENTITY,
            axes: Matrix::IDENTITY,
            origin: Vector::ZERO,
            axis: Vector::ZERO,
        };
        Self {
            joints,
            bodies: robot.links.iter().map(body).collect(),
            placed: vec![placed; path.len()],
            path,
        }
    }

    /// Finds where every link is.
    pub(super) fn pose_links(&mut self, motion: &Motion) {
        let rotation = motion.base_rotation;
        self.placed[0].rotation = rotation;
        self.placed[0].axes = Matrix::from_quat(rotation);
        for (index, joint) in self.joints.iter().enumerate() {
            let parent = self.placed[joint.parent];
            let (sine, cosine) = libm::sincosf(0.5 * motion.joint_position_rad[index]);
            let along = joint.axis * sine;
            let rotation =
                (parent.rotation * Rotation::from_xyzw(along.x, along.y, along.z, cosine)).normalize();
            self.placed[index + 1] = Placed {
                rotation,
                axes: Matrix::from_quat(rotation),
                origin: parent.origin + parent.axes * joint.origin_in_parent,
                axis: parent.axes * joint.axis,
            };
        }
    }

    /// Poses of the links in the world.
    pub(super) fn poses(&self, motion: &Motion) -> Vec<BasePose> {
        let mut found = vec![motion.base()];
        let mut rotations = vec![motion.base_rotation];
        for (index, joint) in self.joints.iter().enumerate() {
            let parent = found[joint.parent];
            let (sine, cosine) = libm::sincosf(0.5 * motion.joint_position_rad[index]);
            let along = joint.axis * sine;
            let turned = Rotation::from_xyzw(along.x, along.y, along.z, cosine);
            let rotation = (rotations[joint.parent] * turned).normalize();
            let offset = rotations[joint.parent] * joint.origin_in_parent;
            let position = Vector::from_array(parent.position_m) + offset;
            found.push(BasePose { position_m: position.to_array(), orientation_xyzw: rotation.to_array() });
            rotations.push(rotation);
        }
        found
    }
}
