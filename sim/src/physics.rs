//! What a driver and a rollout ask of a physics engine: one robot on one terrain, stepped at 200 Hz.
//! The reference is [`Plant`]; a second simulator stands behind the same calls.

use std::sync::Arc;

use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::JointTarget;

use crate::plant::{Measurement, Plant, Variation};

/// One robot on one terrain.
pub trait Physics {
    /// The robot.
    fn robot(&self) -> &Arc<RobotModel>;

    /// The measurement after the last step or placement.
    fn measure(&self) -> &Measurement;

    /// Sets friction, base mass and motor strength from the next step on.
    fn vary(&mut self, variation: &Variation);

    /// Adds a velocity to the base at once, m/s in the world.
    fn push(&mut self, velocity_in_world: [f32; 3]);

    /// One step of 5 ms with every drive following its target; `targets` is in the robot's joint order.
    fn step(&mut self, targets: &[JointTarget]);

    /// Work of the driving joints since [`reset_work`](Self::reset_work), J.
    fn positive_work_j(&self) -> f64;

    /// The same with braking counted negative, J.
    fn signed_work_j(&self) -> f64;

    /// Starts counting work anew.
    fn reset_work(&mut self);

    /// Mass with the variation, kg.
    fn total_mass_kg(&self) -> f32;
}

impl Physics for Plant {
    fn robot(&self) -> &Arc<RobotModel> {
        Self::robot(self)
    }

    fn measure(&self) -> &Measurement {
        Self::measure(self)
    }

    fn vary(&mut self, variation: &Variation) {
        Self::vary(self, variation);
    }

    fn push(&mut self, velocity_in_world: [f32; 3]) {
        Self::push(self, velocity_in_world);
    }

    fn step(&mut self, targets: &[JointTarget]) {
        Self::step(self, targets);
    }

    fn positive_work_j(&self) -> f64 {
        Self::positive_work_j(self)
    }

    fn signed_work_j(&self) -> f64 {
        Self::signed_work_j(self)
    }

    fn reset_work(&mut self) {
        Self::reset_work(self);
    }

    fn total_mass_kg(&self) -> f32 {
        Self::total_mass_kg(self)
    }
}
