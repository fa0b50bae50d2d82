//! The plant: one robot on one terrain, stepped at 200 Hz, in rapier3d or by dynamics of its own.
//!
//! Joints are in reduced coordinates, with rotor inertia, ranges and self-collision; drives are
//! modelled here, since the engine has none. The plant knows no skill and no clock: the same
//! calls give the same bytes, and a restored snapshot continues bit for bit.

mod articulation;
mod body;
mod energy;
mod measurement;
mod pose;
mod rapier;
mod reduced;
mod settings;
pub mod speed;
mod work;
mod world;

use std::sync::Arc;

use vocaloco_core::robot::{RobotModel, Role};
use vocaloco_plugin_api::JointTarget;

use crate::terrain::Terrain;
use articulation::Motion;
use body::{Body, Pattern, Stepper};
use world::{Part, Pressing};

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
    stepper: Stepper,
    state: State,
    velocity_before: Vec<f32>,
    steps_taken: u64,
}

/// What no step changes: shared by a plant and all its snapshots.
struct Blueprint {
    robot: Arc<RobotModel>,
    pattern: Pattern,
    engine: Engine,
}

/// Everything that a step changes and a snapshot keeps.
#[derive(Clone)]
struct State {
    body: Body,
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
        let pattern = Pattern::new(robot, terrain, engine);
        let pose = BasePose::from_yaw([0.0, 0.0, robot.description.stand_height_m as f32], 0.0);
        let stand = robot.stand_position_rad();
        let state = State {
            body: pattern.placed(robot, &pose, &stand),
            variation: Variation::default(),
            measurement: Measurement::at_rest(pose, &stand, robot.description.feet.len()),
            work: Work::default(),
        };
        let blueprint = Blueprint { robot: Arc::clone(robot), pattern, engine };
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
            velocity_before: vec![0.0; blueprint.robot.joint_count()],
            stepper: blueprint.pattern.stepper(),
            blueprint,
            state,
            steps_taken: 0,
        }
    }

    /// Sets the robot down at rest, forgetting its contacts; work counts from here, the variation stays.
    ///
    /// `joint_position_rad` is in the robot's joint order and within the joints' ranges.
    pub fn place(&mut self, pose: &BasePose, joint_position_rad: &[f32]) {
        debug_assert_eq!(joint_position_rad.len(), self.blueprint.robot.joint_count());
        let Blueprint { robot, pattern, .. } = &*self.blueprint;
        self.state.body = pattern.placed(robot, pose, joint_position_rad);
        self.state.measurement =
            Measurement::at_rest(*pose, joint_position_rad, self.blueprint.robot.description.feet.len());
        self.stepper.forget();
        self.reset_work();
        let variation = self.state.variation;
        self.vary(&variation);
    }

    /// Sets friction, base mass and motor strength from the next step on.
    pub fn vary(&mut self, variation: &Variation) {
        self.state.variation = *variation;
        let Blueprint { robot, pattern, .. } = &*self.blueprint;
        pattern.vary(&mut self.state.body, robot, variation);
    }

    /// Adds a velocity to the base at once, m/s in the world.
    pub fn push(&mut self, velocity_in_world: [f32; 3]) {
        self.blueprint.pattern.push(&mut self.state.body, velocity_in_world);
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
        if Arc::ptr_eq(&self.blueprint, &snapshot.blueprint) {
            self.stepper.forget();
        } else {
            self.blueprint = Arc::clone(&snapshot.blueprint);
            self.stepper = self.blueprint.pattern.stepper();
        }
        self.state.clone_from(&snapshot.state);
    }

    /// Physics steps that this plant has made since it was built, whatever it was restored to.
    pub fn steps_taken(&self) -> u64 {
        self.steps_taken
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
        self.blueprint.pattern.link_poses(&self.state.body).into_iter()
    }

    /// Applies the torques in the measurement, steps the world and measures.
    fn advance(&mut self) {
        self.steps_taken += 1;
        let State { body, measurement, variation, .. } = &mut self.state;
        let Blueprint { robot, pattern, .. } = &*self.blueprint;
        self.stepper.step(pattern, body, robot, &measurement.joint_torque_nm, variation);
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

    fn measure_motion(&mut self) {
        let State { body, measurement, .. } = &mut self.state;
        let mut motion = Motion {
            joint_position_rad: &mut measurement.joint_position_rad,
            joint_velocity_rad_per_s: &mut measurement.joint_velocity_rad_per_s,
            base_linear_in_world: [0.0; 3],
            base_angular_in_world: [0.0; 3],
        };
        let pose = self.blueprint.pattern.read(body, &self.blueprint.robot, &mut motion);
        let (linear, angular) = (motion.base_linear_in_world, motion.base_angular_in_world);
        measurement.base = pose;
        measurement.base_linear_velocity = pose.vector_in_body(linear);
        measurement.base_angular_velocity = pose.vector_in_body(angular);
        measurement.projected_gravity = pose.vector_in_body([0.0, 0.0, -1.0]);
    }

    fn measure_contacts(&mut self) {
        let State { body, measurement, .. } = &mut self.state;
        measurement.foot_contact.fill(false);
        measurement.foot_stumble.fill(false);
        measurement.base_contact = false;
        measurement.nonfoot_contact = false;
        self.blueprint.pattern.for_each_pressing(body, |Pressing { sides, steep }| {
            let on_terrain = sides.contains(&Part::Terrain);
            for side in sides {
                match side {
                    Part::Robot(Role::Foot(foot)) => {
                        measurement.foot_contact[foot] |= on_terrain;
                        measurement.foot_stumble[foot] |= on_terrain && steep;
                    }
                    Part::Robot(Role::Base) => {
                        measurement.base_contact = true;
                        measurement.nonfoot_contact = true;
                    }
                    Part::Robot(Role::Limb) => measurement.nonfoot_contact = true,
                    Part::Terrain => {}
                }
            }
        });
    }
}

#[cfg(test)]
mod tests;
