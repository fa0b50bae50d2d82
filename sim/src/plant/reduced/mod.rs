//! The robot in reduced coordinates, integrated here: composite inertias over the tree of links, and
//! contacts and ranges as inequalities on its velocities. Shapes meet by parry's queries.
//!
//! ```text
//! M(q)·u̇ + h(q, u) = (0, τ) + Σ_row Jᵀ·λ,   u = (v_base, ω_base, q̇) in the world
//! ```
//!
//! Rapier's multibody solves the same equations with dense matrices; here legs keep their zeros.

mod contact;
mod inertia;
mod row;
mod tree;

use rapier3d::math::{Rotation, Vector};
use vocaloco_core::robot::RobotModel;

use self::{contact::Shapes, inertia::Inertia, row::Rows, tree::Tree};
use super::{BasePose, GRAVITY_M_PER_S2, STEEP_NORMAL_Z, STEP_S, Variation, articulation, world};
use crate::terrain::Terrain;

/// Of the base, before the joints: linear, then angular.
const BASE_DOFS: usize = 6;
/// Values to a vector register: what is summed by degree of freedom lies in slots, padded to whole ones.
const LANES: usize = 4;
/// Slots of the base; the joints' follow.
const BASE_SLOTS: usize = 2 * LANES;
/// Sweeps over the rows with the pull out of what is too deep, and then without it.
const SWEEPS: [usize; 2] = [4, 2];

/// A robot and its ground, with the work space of a step.
#[derive(Clone)]
pub(super) struct Reduced {
    tree: Tree,
    shapes: Shapes,
    inertia: Inertia,
    rows: Rows,
    substeps: usize,
}

/// What a step changes and a snapshot keeps.
#[derive(Clone)]
pub(super) struct Motion {
    pub(super) base_position: Vector,
    pub(super) base_rotation: Rotation,
    pub(super) joint_position_rad: Vec<f32>,
    /// Of the base origin and of the base in the world, then of the joints.
    pub(super) velocity: Vec<f32>,
    /// Pressing at the end of the last step, to start the next one from.
    pressing: Vec<Pressing>,
}

/// Two shapes that press on each other.
#[derive(Clone, Copy)]
struct Pressing {
    pair: [u32; 2],
    normal_ns: f32,
    normal_z: f32,
    /// In the world.
    friction_ns: Vector,
}

impl Motion {
    /// At rest.
    pub(super) fn at(pose: &BasePose, joint_position_rad: &[f32]) -> Self {
        let [x, y, z, w] = pose.orientation_xyzw;
        Self {
            base_position: Vector::from_array(pose.position_m),
            base_rotation: Rotation::from_xyzw(x, y, z, w),
            joint_position_rad: joint_position_rad.to_vec(),
            velocity: vec![0.0; BASE_DOFS + joint_position_rad.len()],
            pressing: Vec::new(),
        }
    }

    pub(super) fn base(&self) -> BasePose {
        BasePose {
            position_m: self.base_position.to_array(),
            orientation_xyzw: self.base_rotation.to_array(),
        }
    }

    /// Joints and the base's velocity.
    pub(super) fn read(&self, motion: &mut articulation::Motion<'_>) {
        let (base, joints) = self.velocity.split_at(BASE_DOFS);
        motion.joint_position_rad.copy_from_slice(&self.joint_position_rad);
        motion.joint_velocity_rad_per_s.copy_from_slice(joints);
        motion.base_linear_in_world = [base[0], base[1], base[2]];
        motion.base_angular_in_world = [base[3], base[4], base[5]];
    }

    fn integrate(&mut self, dt: f32) {
        let velocity = |i: usize| Vector::new(self.velocity[i], self.velocity[i + 1], self.velocity[i + 2]);
        let (linear, angular) = (velocity(0), velocity(3));
        self.base_position += linear * dt;
        self.base_rotation = (turned(angular * dt) * self.base_rotation).normalize();
        for (position, velocity) in self.joint_position_rad.iter_mut().zip(&self.velocity[BASE_DOFS..]) {
            *position += velocity * dt;
        }
    }
}

/// Slots of a robot with so many joints.
fn slots(joints: usize) -> usize {
    BASE_SLOTS + joints.next_multiple_of(LANES)
}

/// Four sums side by side, since one sum alone waits for each addition; of whole registers.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0; LANES];
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// `to += times · direction`, of whole registers.
fn add(to: &mut [f32], direction: &[f32], times: f32) {
    let (to, direction) = (to.as_chunks_mut::<LANES>().0, direction.as_chunks::<LANES>().0);
    for (to, direction) in to.iter_mut().zip(direction) {
        for lane in 0..LANES {
            to[lane] += times * direction[lane];
        }
    }
}

/// The rotation by a vector's length about its direction.
fn turned(by: Vector) -> Rotation {
    let angle = by.length();
    let (sine, cosine) = libm::sincosf(0.5 * angle);
    let share = if angle > 1e-6 { sine / angle } else { 0.5 };
    Rotation::from_xyzw(by.x * share, by.y * share, by.z * share, cosine)
}

impl Reduced {
    pub(super) fn new(robot: &RobotModel, terrain: &Terrain, substeps: usize) -> Self {
        let tree = Tree::of(robot);
        Self {
            shapes: Shapes::of(robot, &tree, terrain),
            inertia: Inertia::for_tree(&tree),
            rows: Rows::new(tree.joints.len()),
            tree,
            substeps,
        }
    }

    /// One physics step under joint torques.
    pub(super) fn step(&mut self, motion: &mut Motion, torque_nm: &[f32], variation: &Variation) {
        let dt = STEP_S / self.substeps as f32;
        for _ in 0..self.substeps {
            self.tree.pose_links(motion);
            self.inertia.assemble(&self.tree, motion, variation.base_mass_offset_kg);
            self.inertia.accelerate(&self.tree, motion, torque_nm, dt);
            self.rows.start(&motion.velocity);
            self.rows.add_ranges(&self.tree, &self.inertia, motion, dt);
            let (rows, tree, inertia) = (&mut self.rows, &self.tree, &self.inertia);
            self.shapes.meet(tree, motion, variation.friction, |contact| {
                rows.add_contact(tree, inertia, contact, motion, dt);
            });
            rows.warm_start();
            for _ in 0..SWEEPS[0] {
                rows.sweep(true);
            }
            rows.write_velocity(inertia, &mut motion.velocity);
            motion.integrate(dt);
            for _ in 0..SWEEPS[1] {
                rows.sweep(false);
            }
            rows.write_velocity(inertia, &mut motion.velocity);
            rows.keep(&mut motion.pressing);
        }
    }

    /// Every contact that presses.
    pub(super) fn pressing<'a>(&'a self, motion: &'a Motion) -> impl Iterator<Item = world::Pressing> + 'a {
        motion.pressing.iter().map(|pressing| world::Pressing {
            sides: pressing.pair.map(|side| self.shapes.part(side)),
            steep: pressing.normal_z.abs() < STEEP_NORMAL_Z,
        })
    }

    /// Poses of the links, the base first.
    pub(super) fn link_poses(&self, motion: &Motion) -> Vec<BasePose> {
        self.tree.poses(motion)
    }
}

#[cfg(test)]
mod tests;
