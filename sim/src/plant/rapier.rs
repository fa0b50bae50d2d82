//! The plant on rapier's own pipeline.

use rapier3d::prelude::*;
use vocaloco_core::robot::RobotModel;

use super::{
    BasePose, Engine, GRAVITY_M_PER_S2, STEEP_NORMAL_Z, STEP_S, Variation,
    articulation::{Motion, parent_link},
    world::{self, Handles, Pressing, World},
};
use crate::terrain::Terrain;

/// What no step changes of a robot in rapier; its state is a [`World`].
pub(super) struct Rapier {
    handles: Handles,
    parameters: IntegrationParameters,
    /// The robot at the origin, before its first step.
    pristine: World,
}

/// The engine's work space; it refers to the world stepped last.
pub(super) struct Workspace {
    pipeline: PhysicsPipeline,
    ccd: CCDSolver,
    soft_bodies: SoftBodySet,
    torque_on_link: Vec<Vector>,
}

impl Workspace {
    pub(super) fn new() -> Self {
        Self {
            pipeline: PhysicsPipeline::new(),
            ccd: CCDSolver::new(),
            soft_bodies: SoftBodySet::new(),
            torque_on_link: Vec::new(),
        }
    }

    /// Before another world is stepped than the one stepped last.
    pub(super) fn forget(&mut self) {
        self.pipeline = PhysicsPipeline::new();
    }
}

impl Rapier {
    pub(super) fn new(robot: &RobotModel, terrain: &Terrain, engine: Engine) -> Self {
        let (pristine, handles) = World::build(robot, terrain, engine);
        Self { handles, parameters: parameters(engine), pristine }
    }

    /// The robot at rest in a pose.
    pub(super) fn placed(&self, robot: &RobotModel, pose: &BasePose, joint_position_rad: &[f32]) -> World {
        let mut world = self.pristine.clone();
        let Handles { links, articulation, .. } = &self.handles;
        articulation.place(&mut world, robot, links, pose, joint_position_rad);
        world
    }

    pub(super) fn vary(&self, world: &mut World, robot: &RobotModel, variation: &Variation) {
        for handle in &self.handles.robot_colliders {
            let collider = &mut world.colliders[*handle];
            collider.set_friction(variation.friction);
        }
        let link = &robot.links[0];
        let mass_kg = link.mass_kg + f64::from(variation.base_mass_offset_kg);
        let base = &mut world.bodies[self.handles.links[0]];
        base.set_additional_mass_properties(world::mass_properties(link, mass_kg), false);
        base.recompute_mass_properties_from_colliders(&world.colliders);
    }

    pub(super) fn push(&self, world: &mut World, velocity_in_world: [f32; 3]) {
        let Handles { links, articulation, .. } = &self.handles;
        articulation.push(world, links, velocity_in_world);
    }

    /// One physics step under joint torques.
    pub(super) fn step(
        &self,
        work: &mut Workspace,
        world: &mut World,
        robot: &RobotModel,
        torque_nm: &[f32],
    ) {
        self.apply_torques(&mut work.torque_on_link, world, robot, torque_nm);
        work.pipeline.step(
            Vector::new(0.0, 0.0, -GRAVITY_M_PER_S2),
            &self.parameters,
            &mut world.islands,
            &mut world.broad_phase,
            &mut world.narrow_phase,
            &mut world.bodies,
            &mut world.colliders,
            &mut world.impulse_joints,
            &mut world.multibody_joints,
            &mut work.soft_bodies,
            &mut work.ccd,
            &(),
            &(),
        );
    }

    /// +τ on the child, −τ on the parent, about the joint's axis in the world.
    fn apply_torques(
        &self,
        torque_on_link: &mut Vec<Vector>,
        world: &mut World,
        robot: &RobotModel,
        torque_nm: &[f32],
    ) {
        torque_on_link.clear();
        torque_on_link.resize(robot.links.len(), Vector::ZERO);
        for (index, joint) in robot.description.joints.iter().enumerate() {
            let rotation = world.bodies[self.handles.links[index + 1]].rotation();
            let torque = rotation * world::vector(joint.axis) * torque_nm[index];
            torque_on_link[index + 1] += torque;
            torque_on_link[parent_link(robot, index)] -= torque;
        }
        for (handle, torque) in self.handles.links.iter().zip(torque_on_link) {
            let body = &mut world.bodies[*handle];
            // Torques given by the user persist from step to step.
            body.reset_torques(false);
            body.add_torque(*torque, false);
        }
    }

    /// Joints and the base's velocity, and the base's pose.
    pub(super) fn read(&self, world: &World, robot: &RobotModel, motion: &mut Motion<'_>) -> BasePose {
        let Handles { links, articulation, .. } = &self.handles;
        articulation.read(world, robot, links, motion);
        world.bodies[links[0]].position().into()
    }

    /// Every contact that pressed in the last step.
    pub(super) fn pressing<'a>(&'a self, world: &'a World) -> impl Iterator<Item = Pressing> + 'a {
        let part = |collider: ColliderHandle| self.handles.parts[collider.into_raw_parts().0 as usize];
        world.narrow_phase.contact_pairs().filter_map(move |pair| {
            let mut pressing = false;
            let mut steep = false;
            for manifold in pair.rigid().into_iter().flat_map(RigidPairContacts::solver_manifolds) {
                let presses = manifold.points.iter().any(|point| point.data.impulse > 0.0);
                pressing |= presses;
                steep |= presses && manifold.data.normal.z.abs() < STEEP_NORMAL_Z;
            }
            pressing.then(|| Pressing { sides: [part(pair.collider1), part(pair.collider2)], steep })
        })
    }

    /// Poses of the links, the base first.
    pub(super) fn link_poses(&self, world: &World) -> Vec<BasePose> {
        self.handles.links.iter().map(|handle| world.bodies[*handle].position().into()).collect()
    }
}

fn parameters(engine: Engine) -> IntegrationParameters {
    IntegrationParameters {
        dt: STEP_S,
        num_solver_iterations: engine.iterations,
        // Feet are slow against the thickness of the ground.
        max_ccd_substeps: 0,
        // A foot at 2 m/s is seen a step ahead; more only makes contacts that never press.
        normalized_prediction_distance: 0.01,
        // A reused contact would hold a foot that has slid over an edge.
        contact_recycling: false,
        ..IntegrationParameters::default()
    }
}
