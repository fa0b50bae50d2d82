//! The plant: one robot on one terrain in rapier3d, stepped at 200 Hz.
//!
//! Joints are a reduced-coordinate multibody with rotor inertia, ranges and self-collision; drives
//! are modelled here, since the engine has none. The plant knows no skill and no clock: the same
//! calls give the same bytes, and a restored snapshot continues bit for bit.

mod articulation;
mod energy;
mod measurement;
mod pose;
mod settings;
mod work;
mod world;

use std::sync::Arc;

use rapier3d::prelude::*;
use vocaloco_core::robot::{RobotModel, Role};
use vocaloco_plugin_api::JointTarget;

use crate::terrain::Terrain;
use articulation::{Motion, parent_link};
use world::{Handles, Part, World};

pub use energy::Momentum;
pub use measurement::Measurement;
pub use pose::BasePose;
pub use settings::{Engine, JointKind, PlantKind, Variation};
pub(crate) use work::Work;

/// Length of a physics step, s.
pub const STEP_S: f32 = 0.005;
/// A contact whose normal has less of the vertical in it, 60° from it, is with a riser.
const STEEP_NORMAL_Z: f32 = 0.5;
/// Acceleration of gravity, m/s².
pub const GRAVITY_M_PER_S2: f32 = 9.81;

/// A robot on a terrain.
pub struct Plant {
    blueprint: Arc<Blueprint>,
    pipeline: PhysicsPipeline,
    ccd: CCDSolver,
    soft_bodies: SoftBodySet,
    state: State,
    torque_on_link: Vec<Vector>,
    velocity_before: Vec<f32>,
}

/// What no step changes: shared by a plant and all its snapshots.
struct Blueprint {
    robot: Arc<RobotModel>,
    handles: Handles,
    parameters: IntegrationParameters,
    /// The robot at the origin, before its first step.
    pristine: World,
    engine: Engine,
}

/// Everything that a step changes and a snapshot keeps.
#[derive(Clone)]
struct State {
    world: World,
    variation: Variation,
    measurement: Measurement,
    work: Work,
}

/// A plant's state, to continue from any number of times.
#[derive(Clone)]
pub struct Snapshot {
    blueprint: Arc<Blueprint>,
    state: State,
}

impl Plant {
    /// The robot upright at the origin in its stand pose; [`place`](Self::place) it before stepping.
    pub fn new(robot: &Arc<RobotModel>, terrain: &Terrain, kind: PlantKind) -> Self {
        Self::with_engine(robot, terrain, kind.engine())
    }

    /// As [`new`](Self::new), with the engine's settings given: for measuring them.
    pub fn with_engine(robot: &Arc<RobotModel>, terrain: &Terrain, engine: Engine) -> Self {
        let (pristine, handles) = World::build(robot, terrain, engine);
        let pose = BasePose::from_yaw([0.0, 0.0, robot.description.stand_height_m as f32], 0.0);
        let stand = robot.stand_position_rad();
        let state = State {
            world: pristine.clone(),
            variation: Variation::default(),
            measurement: Measurement::at_rest(pose, &stand, robot.description.feet.len()),
            work: Work::default(),
        };
        let parameters = parameters(engine);
        let blueprint = Blueprint { robot: Arc::clone(robot), handles, parameters, pristine, engine };
        let mut plant = Self::continuing(Arc::new(blueprint), state);
        plant.place(&pose, &stand);
        plant
    }

    /// A plant of its own that continues from a snapshot.
    pub fn from_snapshot(snapshot: &Snapshot) -> Self {
        Self::continuing(Arc::clone(&snapshot.blueprint), snapshot.state.clone())
    }

    fn continuing(blueprint: Arc<Blueprint>, state: State) -> Self {
        Self {
            torque_on_link: vec![Vector::ZERO; blueprint.robot.links.len()],
            velocity_before: vec![0.0; blueprint.robot.joint_count()],
            blueprint,
            pipeline: PhysicsPipeline::new(),
            ccd: CCDSolver::new(),
            soft_bodies: SoftBodySet::new(),
            state,
        }
    }

    /// Sets the robot down at rest, forgetting its contacts; work counts from here, the variation stays.
    ///
    /// `joint_position_rad` is in the robot's joint order and within the joints' ranges.
    pub fn place(&mut self, pose: &BasePose, joint_position_rad: &[f32]) {
        debug_assert_eq!(joint_position_rad.len(), self.blueprint.robot.joint_count());
        let mut world = self.blueprint.pristine.clone();
        let Handles { links, articulation, .. } = &self.blueprint.handles;
        articulation.place(&mut world, &self.blueprint.robot, links, pose, joint_position_rad);
        self.state.world = world;
        self.state.measurement =
            Measurement::at_rest(*pose, joint_position_rad, self.blueprint.robot.description.feet.len());
        self.pipeline = PhysicsPipeline::new();
        self.reset_work();
        let variation = self.state.variation;
        self.vary(&variation);
    }

    /// Sets friction, base mass and motor strength from the next step on.
    pub fn vary(&mut self, variation: &Variation) {
        self.state.variation = *variation;
        let world = &mut self.state.world;
        for handle in &self.blueprint.handles.robot_colliders {
            let collider = &mut world.colliders[*handle];
            collider.set_friction(variation.friction);
        }
        let link = &self.blueprint.robot.links[0];
        let mass_kg = link.mass_kg + f64::from(variation.base_mass_offset_kg);
        let base = &mut world.bodies[self.blueprint.handles.links[0]];
        base.set_additional_mass_properties(world::mass_properties(link, mass_kg), false);
        base.recompute_mass_properties_from_colliders(&world.colliders);
    }

    /// Adds a velocity to the base at once, m/s in the world.
    pub fn push(&mut self, velocity_in_world: [f32; 3]) {
        let Handles { links, articulation, .. } = &self.blueprint.handles;
        articulation.push(&mut self.state.world, links, velocity_in_world);
        self.measure_motion();
    }

    /// One physics step with every drive following its target; `targets` is in the robot's joint order.
    pub fn step(&mut self, targets: &[JointTarget]) {
        let strength = self.state.variation.motor_strength;
        self.state.measurement.drive(&self.blueprint.robot.drive, strength, targets);
        self.advance();
    }

    /// One physics step with the joint torques given, N·m, unlimited: for comparisons of engines.
    pub fn step_torques(&mut self, torque_nm: &[f32]) {
        self.state.measurement.joint_torque_nm.copy_from_slice(torque_nm);
        self.advance();
    }

    /// The measurement after the last step or placement.
    pub fn measure(&self) -> &Measurement {
        &self.state.measurement
    }

    /// Work of the driving joints since [`reset_work`](Self::reset_work), J.
    ///
    /// ```text
    /// Σ_step Σ_joint max(0, τ·½(q̇₀ + q̇₁))·Δt
    /// ```
    pub fn positive_work_j(&self) -> f64 {
        self.state.work.positive_j
    }

    /// As [`positive_work_j`](Self::positive_work_j), braking counted negative, J.
    pub fn signed_work_j(&self) -> f64 {
        self.state.work.signed_j
    }

    /// Starts counting work anew.
    pub fn reset_work(&mut self) {
        self.state.work = Work::default();
    }

    /// The state, to [`restore`](Self::restore) in this plant or in another one made alike.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot { blueprint: Arc::clone(&self.blueprint), state: self.state.clone() }
    }

    /// Continues from a snapshot, bit for bit, on the terrain and as the kind of plant that it is of.
    ///
    /// # Panics
    /// When it is of another robot.
    pub fn restore(&mut self, snapshot: &Snapshot) {
        assert_eq!(self.blueprint.robot.name, snapshot.blueprint.robot.name, "a plant keeps its robot");
        self.blueprint = Arc::clone(&snapshot.blueprint);
        self.state.clone_from(&snapshot.state);
        // The pipeline holds work space that refers to the world it last stepped.
        self.pipeline = PhysicsPipeline::new();
    }

    /// Mass with the variation, kg.
    pub fn total_mass_kg(&self) -> f32 {
        self.blueprint.robot.description.mass_kg as f32 + self.state.variation.base_mass_offset_kg
    }

    /// Kinetic energy and vertical momentum, from the measurement: to check the work against.
    pub fn momentum(&self) -> Momentum {
        let links = world::links_with_rotors(&self.blueprint.robot, self.blueprint.engine.joints);
        let State { measurement, variation, .. } = &self.state;
        energy::momentum(&self.blueprint.robot, &links, measurement, variation.base_mass_offset_kg)
    }

    /// The robot this is a plant of.
    pub fn robot(&self) -> &Arc<RobotModel> {
        &self.blueprint.robot
    }

    /// Poses of all links in the world, the base first.
    pub fn link_poses(&self) -> impl Iterator<Item = BasePose> + '_ {
        self.blueprint.handles.links.iter().map(|handle| self.state.world.bodies[*handle].position().into())
    }

    /// Applies the torques in the measurement, steps the world and measures.
    fn advance(&mut self) {
        self.apply_torques();
        let world = &mut self.state.world;
        self.pipeline.step(
            Vector::new(0.0, 0.0, -GRAVITY_M_PER_S2),
            &self.blueprint.parameters,
            &mut world.islands,
            &mut world.broad_phase,
            &mut world.narrow_phase,
            &mut world.bodies,
            &mut world.colliders,
            &mut world.impulse_joints,
            &mut world.multibody_joints,
            &mut self.soft_bodies,
            &mut self.ccd,
            &(),
            &(),
        );
        self.velocity_before.copy_from_slice(&self.state.measurement.joint_velocity_rad_per_s);
        self.measure_motion();
        let State { measurement, work, .. } = &mut self.state;
        work.add_step(
            &measurement.joint_torque_nm,
            &self.velocity_before,
            &measurement.joint_velocity_rad_per_s,
        );
        self.measure_contacts();
    }

    /// +τ on the child, −τ on the parent, about the joint's axis in the world.
    fn apply_torques(&mut self) {
        let world = &mut self.state.world;
        self.torque_on_link.fill(Vector::ZERO);
        for (index, joint) in self.blueprint.robot.description.joints.iter().enumerate() {
            let rotation = world.bodies[self.blueprint.handles.links[index + 1]].rotation();
            let torque = rotation * world::vector(joint.axis) * self.state.measurement.joint_torque_nm[index];
            self.torque_on_link[index + 1] += torque;
            self.torque_on_link[parent_link(&self.blueprint.robot, index)] -= torque;
        }
        for (handle, torque) in self.blueprint.handles.links.iter().zip(&self.torque_on_link) {
            let body = &mut world.bodies[*handle];
            // Torques given by the user persist from step to step.
            body.reset_torques(false);
            body.add_torque(*torque, false);
        }
    }

    fn measure_motion(&mut self) {
        let State { world, measurement, .. } = &mut self.state;
        let mut motion = Motion {
            joint_position_rad: &mut measurement.joint_position_rad,
            joint_velocity_rad_per_s: &mut measurement.joint_velocity_rad_per_s,
            base_linear_in_world: [0.0; 3],
            base_angular_in_world: [0.0; 3],
        };
        let Handles { links, articulation, .. } = &self.blueprint.handles;
        articulation.read(world, &self.blueprint.robot, links, &mut motion);
        let (linear, angular) = (motion.base_linear_in_world, motion.base_angular_in_world);
        let pose: BasePose = world.bodies[links[0]].position().into();
        measurement.base = pose;
        measurement.base_linear_velocity = pose.vector_in_body(linear);
        measurement.base_angular_velocity = pose.vector_in_body(angular);
        measurement.projected_gravity = pose.vector_in_body([0.0, 0.0, -1.0]);
    }

    fn measure_contacts(&mut self) {
        let State { world, measurement, .. } = &mut self.state;
        measurement.foot_contact.fill(false);
        measurement.foot_stumble.fill(false);
        measurement.base_contact = false;
        measurement.nonfoot_contact = false;
        let part =
            |collider: ColliderHandle| self.blueprint.handles.parts[collider.into_raw_parts().0 as usize];
        for pair in world.narrow_phase.contact_pairs() {
            let mut pressing = false;
            let mut pressing_sideways = false;
            for manifold in pair.rigid().into_iter().flat_map(RigidPairContacts::solver_manifolds) {
                let presses = manifold.points.iter().any(|point| point.data.impulse > 0.0);
                pressing |= presses;
                pressing_sideways |= presses && manifold.data.normal.z.abs() < STEEP_NORMAL_Z;
            }
            if !pressing {
                continue;
            }
            let sides = [part(pair.collider1), part(pair.collider2)];
            let on_terrain = sides.contains(&Part::Terrain);
            for side in sides {
                match side {
                    Part::Robot(Role::Foot(foot)) => {
                        measurement.foot_contact[foot] |= on_terrain;
                        measurement.foot_stumble[foot] |= on_terrain && pressing_sideways;
                    }
                    Part::Robot(Role::Base) => {
                        measurement.base_contact = true;
                        measurement.nonfoot_contact = true;
                    }
                    Part::Robot(Role::Limb) => measurement.nonfoot_contact = true,
                    Part::Terrain => {}
                }
            }
        }
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

#[cfg(test)]
mod tests;
