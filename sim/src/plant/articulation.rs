//! The joints of a robot in its world: reduced coordinates, or bodies held together by impulses.

use rapier3d::prelude::*;
use vocaloco_core::robot::RobotModel;

use super::world::{World, vector};
use super::{BasePose, JointKind};

/// How the links are joined, with what is needed to read them.
pub(super) enum Articulation {
    /// One multibody, by any of its joints.
    Multibody(MultibodyJointHandle),
    /// An impulse joint between each link and its parent.
    Impulse,
}

/// Joint states and the base's velocity in the world.
pub(super) struct Motion<'a> {
    pub(super) joint_position_rad: &'a mut [f32],
    pub(super) joint_velocity_rad_per_s: &'a mut [f32],
    pub(super) base_linear_in_world: [f32; 3],
    pub(super) base_angular_in_world: [f32; 3],
}

/// Index of the link that a joint hangs on; links are numbered base first.
pub(super) fn parent_link(robot: &RobotModel, joint: usize) -> usize {
    usize::try_from(robot.description.joints[joint].parent + 1).unwrap_or(0)
}

impl Articulation {
    /// Joins the links of a robot at its zero position.
    ///
    /// # Panics
    /// When the robot has no joint: [`RobotModel`] does not load such a one.
    pub(super) fn join(
        kind: JointKind,
        world: &mut World,
        robot: &RobotModel,
        links: &[RigidBodyHandle],
    ) -> Self {
        let mut multibody = None;
        for (index, joint) in robot.description.joints.iter().enumerate() {
            let parent = links[parent_link(robot, index)];
            let mut hinge = RevoluteJointBuilder::new(vector(joint.axis))
                .local_anchor1(vector(joint.origin_in_parent_m))
                .local_anchor2(Vector::ZERO)
                .limits([joint.lower_rad as f32, joint.upper_rad as f32])
                .build();
            hinge.data.contacts_enabled = false;
            match kind {
                JointKind::Multibody | JointKind::Reduced => {
                    multibody = world.multibody_joints.insert(parent, links[index + 1], hinge, true);
                }
                JointKind::Impulse => {
                    world.impulse_joints.insert(parent, links[index + 1], hinge, true);
                }
            }
        }
        if kind == JointKind::Impulse {
            return Self::Impulse;
        }
        let handle = multibody.expect("a robot has joints");
        let (multibody, _) = world.multibody_joints.get_mut(handle).expect("just inserted");
        // The engine would damp joints by 0.1 N·m·s/rad.
        multibody.damping_mut().fill(0.0);
        let assembly_ids: Vec<usize> = multibody.links().skip(1).map(MultibodyLink::assembly_id).collect();
        for (link, id) in robot.links[1..].iter().zip(assembly_ids) {
            multibody.armature_mut()[id] = link.armature_kg_m2 as f32;
        }
        Self::Multibody(handle)
    }

    /// Moves a robot that is at its zero position.
    pub(super) fn place(
        &self,
        world: &mut World,
        robot: &RobotModel,
        links: &[RigidBodyHandle],
        base: &BasePose,
        joint_position_rad: &[f32],
    ) {
        world.bodies[links[0]].set_position(base.into(), false);
        match self {
            Self::Multibody(handle) => {
                let Some((multibody, _)) = world.multibody_joints.get_mut(*handle) else { return };
                let mut displacement = vec![0.0; multibody.ndofs()];
                for (link, position) in multibody.links().skip(1).zip(joint_position_rad) {
                    displacement[link.assembly_id()] = *position;
                }
                multibody.apply_displacements(&displacement);
                multibody.forward_kinematics(&world.bodies, true);
                multibody.update_rigid_bodies(&mut world.bodies, true);
            }
            Self::Impulse => {
                for (index, joint) in robot.description.joints.iter().enumerate() {
                    let parent = *world.bodies[links[parent_link(robot, index)]].position();
                    let axis = vector(joint.axis);
                    let half = 0.5 * joint_position_rad[index];
                    let (sine, cosine) = (libm::sinf(half), libm::cosf(half));
                    let turned = Rotation::from_xyzw(axis.x * sine, axis.y * sine, axis.z * sine, cosine);
                    let pose = parent * Pose::from_parts(vector(joint.origin_in_parent_m), turned);
                    world.bodies[links[index + 1]].set_position(pose, false);
                }
            }
        }
    }

    /// Reads joints and base as they are now.
    pub(super) fn read(
        &self,
        world: &World,
        robot: &RobotModel,
        links: &[RigidBodyHandle],
        motion: &mut Motion<'_>,
    ) {
        match self {
            Self::Multibody(handle) => {
                let Some((multibody, _)) = world.multibody_joints.get(*handle) else { return };
                let velocities = multibody.generalized_velocity();
                for (joint, link) in multibody.links().skip(1).enumerate() {
                    motion.joint_position_rad[joint] = link.joint().coords()[3];
                    motion.joint_velocity_rad_per_s[joint] = velocities[link.assembly_id()];
                }
                // The bodies' own velocities can lag a substep behind these.
                motion.base_linear_in_world = [velocities[0], velocities[1], velocities[2]];
                motion.base_angular_in_world = [velocities[3], velocities[4], velocities[5]];
            }
            Self::Impulse => {
                for (index, joint) in robot.description.joints.iter().enumerate() {
                    let parent = &world.bodies[links[parent_link(robot, index)]];
                    let child = &world.bodies[links[index + 1]];
                    let axis = vector(joint.axis);
                    let turned = parent.rotation().inverse() * *child.rotation();
                    let sine = turned.x * axis.x + turned.y * axis.y + turned.z * axis.z;
                    let angle = 2.0 * libm::atan2f(sine, turned.w);
                    // Both signs of a quaternion are one rotation; joints stay within ±π.
                    let turn = 2.0 * std::f32::consts::PI;
                    motion.joint_position_rad[index] = angle - turn * libm::roundf(angle / turn);
                    motion.joint_velocity_rad_per_s[index] =
                        (child.angvel() - parent.angvel()).dot(*child.rotation() * axis);
                }
                let base = &world.bodies[links[0]];
                motion.base_linear_in_world = base.linvel().to_array();
                motion.base_angular_in_world = base.angvel().to_array();
            }
        }
    }

    /// Adds a velocity to the whole robot, m/s in the world.
    pub(super) fn push(&self, world: &mut World, links: &[RigidBodyHandle], velocity_in_world: [f32; 3]) {
        match self {
            Self::Multibody(handle) => {
                let Some((multibody, _)) = world.multibody_joints.get_mut(*handle) else { return };
                let mut velocities = multibody.generalized_velocity_mut();
                for (velocity, added) in velocities.iter_mut().zip(velocity_in_world) {
                    *velocity += added;
                }
            }
            Self::Impulse => {
                for link in links {
                    let body = &mut world.bodies[*link];
                    let velocity = body.linvel() + Vector::from_array(velocity_in_world);
                    body.set_linvel(velocity, false);
                }
            }
        }
    }
}
