//! The core's own controller: the robot stands, whatever happens to skills, sensors or commands.
//!
//! A foot on the ground stays where it is; a foot in the air is lowered, no faster than the robot's
//! file says, to where it catches the robot's motion. Each leg that touches carries its share of the
//! weight by its target, so that PD alone neither sags nor jolts. Feet are never dragged into a pose:
//! that pushes a robot stopped in mid-stride on, and it falls.

mod legs;

use std::sync::Arc;

use vocaloco_plugin_api::JointTarget;

use crate::robot::RobotModel;
use legs::{Leg, dot};

const GRAVITY_M_PER_S2: f64 = 9.81;
/// Time constant with which a leg takes on its share of the weight, s.
const LOAD_S: f64 = 0.1;
/// A foot is lowered at most this far below the deepest one that touches, m: beyond is a hole.
const DEEPEST_BELOW_M: f64 = 0.2;
/// Without contact sensing a foot this close to the deepest one is taken to touch, m.
const TOUCHING_M: f64 = 0.015;
/// While it brakes, the legs are this much stiffer and more damped than in the stand: at the stand's
/// own gains a robot stopped at 0.7 m/s tips over its yielding front legs in half of the gait's
/// phases (measured in the simulator, see `tests/a_stop_keeps_its_feet.rs`).
const BRAKING_STIFFNESS: f64 = 2.5;
const BRAKING_DAMPING: f64 = 3.0;
/// Time constant with which that fades once every foot touches, s.
const BRAKING_S: f64 = 1.0;
/// Faster than this on four feet the robot was pushed, and brakes again; wholly at twice as much, m/s.
const PUSHED_M_PER_S: f64 = 0.15;
/// A foot in the air goes sideways at no more than this, m/s.
const ASIDE_M_PER_S: f64 = 1.5;
/// A foot is set down at most this far from below its hip, m.
const MOST_AHEAD_M: f64 = 0.25;
/// Damping of the inverse that lowers a foot, m/rad: a stretched leg moves little rather than fast.
const INVERSE_DAMPING: f64 = 0.03;

/// What is known of the robot in a tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sensed<'a> {
    /// Measured positions, rad; none when the measurement cannot be used.
    pub position_rad: Option<&'a [f32]>,
    /// Measured torques, N·m, where known.
    pub torque_nm: Option<&'a [f32]>,
    /// Which feet touch, where known.
    pub contact: Option<&'a [bool]>,
    /// Unit vector of gravity in the base frame, where known.
    pub gravity: Option<[f32; 3]>,
    /// Velocity of the base in its own frame, where known, m/s.
    pub velocity_m_per_s: Option<[f32; 3]>,
}

impl Sensed<'_> {
    /// 0 at rest, 1 at twice the speed from which on a standing robot counts as pushed.
    fn pushed(&self) -> f64 {
        let velocity = self.velocity_m_per_s.unwrap_or_default().map(f64::from);
        (dot(velocity, velocity).sqrt() / PUSHED_M_PER_S - 1.0).clamp(0.0, 1.0)
    }

    fn down(&self) -> [f64; 3] {
        let gravity = self.gravity.unwrap_or([0.0, 0.0, -1.0]).map(f64::from);
        let length = dot(gravity, gravity).sqrt();
        if length > 0.1 { gravity.map(|component| component / length) } else { [0.0, 0.0, -1.0] }
    }
}

/// The stand of one robot.
#[derive(Clone, Debug)]
pub struct Stand {
    robot: Arc<RobotModel>,
    legs: Vec<Leg>,
    landed: Vec<bool>,
    /// Where each foot is in the stand pose, base frame, m.
    home_m: Vec<[f64; 3]>,
    /// Where each joint is held, rad.
    held_rad: Vec<f64>,
    /// The torque that each joint is asked for there, N·m.
    load_nm: Vec<f64>,
    /// 1 while the robot is brought to rest, fading to 0 in the stand.
    braking: f64,
}

impl Stand {
    /// A stand at rest in the robot's stand pose.
    pub fn new(robot: Arc<RobotModel>) -> Self {
        let legs = Leg::all(&robot.description);
        let held_rad: Vec<f64> = robot.description.joints.iter().map(|joint| joint.stand_rad).collect();
        let mut stand = Self {
            landed: vec![true; legs.len()],
            home_m: legs.iter().map(|leg| leg.foot_in_base_m(&held_rad)).collect(),
            held_rad,
            load_nm: vec![0.0; robot.joint_count()],
            braking: 0.0,
            legs,
            robot,
        };
        stand.load(1.0, [0.0, 0.0, -1.0]);
        stand
    }

    /// Takes over the joints where they are; `last` is what their drives were told, none at the start
    /// of the loop.
    ///
    /// A leg on the ground begins with the torques that it has, measured or as last asked for.
    /// Without any measurement the joints are held at their last targets, or at the stand pose.
    pub fn begin(&mut self, sensed: Sensed<'_>, last: Option<&[JointTarget]>) {
        for (index, joint) in self.robot.description.joints.iter().enumerate() {
            let measured = sensed.position_rad.map(|positions| positions[index]);
            let last = last.map(|targets| targets[index]);
            let torque_nm = match (sensed.torque_nm, last, measured) {
                (Some(torques), ..) => torques[index],
                (None, Some(last), Some(measured)) => {
                    last.stiffness_nm_per_rad * (last.position_rad - measured) + last.feed_forward_nm
                }
                _ => 0.0,
            };
            self.load_nm[index] = f64::from(torque_nm).clamp(-joint.effort_nm, joint.effort_nm);
            let position = measured.or(last.map(|last| last.position_rad)).map_or(joint.stand_rad, f64::from);
            self.held_rad[index] = position.clamp(joint.lower_rad, joint.upper_rad);
        }
        self.braking = if last.is_some() { 1.0 } else { 0.0 };
        let down = sensed.down();
        let depths = self.depths_m(down);
        let deepest_m = depths.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for (leg, depth_m) in depths.into_iter().enumerate() {
            self.landed[leg] = match sensed.contact {
                Some(contact) => contact[leg],
                None => depth_m > deepest_m - TOUCHING_M,
            };
            if !self.landed[leg] {
                self.legs[leg].joints().for_each(|joint| self.load_nm[joint] = 0.0);
            }
        }
        // At the start of the loop there is nothing to take over from: the weight is there already.
        if last.is_none() && sensed.torque_nm.is_none() {
            self.load(1.0, down);
        }
    }

    /// The stand pose itself at stand gains: what a robot is told of which nothing is known.
    pub fn pose(&self, joints: &mut [JointTarget]) {
        let stand = &self.robot.stand;
        for (target, joint) in joints.iter_mut().zip(&self.robot.description.joints) {
            *target = JointTarget {
                position_rad: joint.stand_rad as f32,
                stiffness_nm_per_rad: stand.stiffness_nm_per_rad,
                damping_nms_per_rad: stand.damping_nms_per_rad,
                feed_forward_nm: 0.0,
            };
        }
    }

    /// One tick of `dt_s`: fills `joints`.
    pub fn step(&mut self, dt_s: f64, sensed: Sensed<'_>, joints: &mut [JointTarget]) {
        let down = sensed.down();
        let depths = self.depths_m(down);
        let landed = depths.iter().zip(&self.landed).filter(|(_, landed)| **landed).map(|(depth, _)| *depth);
        let deepest_m = landed.fold(f64::NEG_INFINITY, f64::max);
        for (leg, depth_m) in depths.into_iter().enumerate() {
            if self.landed[leg] {
                continue;
            }
            let touches = match sensed.contact {
                Some(contact) => contact[leg],
                None => depth_m >= deepest_m - 0.001,
            };
            if touches {
                self.landed[leg] = true;
                self.hold(leg, sensed.position_rad);
            } else if depth_m < deepest_m.max(self.stand_depth_m()) + DEEPEST_BELOW_M {
                let lowered_m = f64::from(self.robot.stand.lowering_speed_m_per_s) * dt_s;
                let aside = self.aside_m(leg, &sensed, down);
                let reach = (ASIDE_M_PER_S * dt_s / dot(aside, aside).sqrt().max(1e-9)).min(1.0);
                let step = std::array::from_fn(|axis| lowered_m * down[axis] + reach * aside[axis]);
                self.move_foot(leg, step);
            }
        }
        self.load((dt_s / LOAD_S).min(1.0), down);
        if self.is_settled() {
            self.braking *= 1.0 - (dt_s / BRAKING_S).min(1.0);
            self.braking = self.braking.max(sensed.pushed());
        }
        let stand = &self.robot.stand;
        let stiffer = 1.0 + self.braking * (BRAKING_STIFFNESS - 1.0);
        let more_damped = 1.0 + self.braking * (BRAKING_DAMPING - 1.0);
        let stiffness_nm_per_rad = f64::from(stand.stiffness_nm_per_rad) * stiffer;
        for (target, (held_rad, load_nm)) in joints.iter_mut().zip(self.held_rad.iter().zip(&self.load_nm)) {
            *target = JointTarget {
                position_rad: (held_rad + load_nm / stiffness_nm_per_rad) as f32,
                stiffness_nm_per_rad: stiffness_nm_per_rad as f32,
                damping_nms_per_rad: stand.damping_nms_per_rad * more_damped as f32,
                feed_forward_nm: 0.0,
            };
        }
    }

    /// Whether every foot has touched.
    pub fn is_settled(&self) -> bool {
        self.landed.iter().all(|&landed| landed)
    }

    /// What a foot in the air still has to go sideways: to below its place in the stand pose, and by the
    /// distance ahead at which a robot of this height and speed comes to rest, `v·√(h/g)`.
    fn aside_m(&self, leg: usize, sensed: &Sensed<'_>, down: [f64; 3]) -> [f64; 3] {
        let Some(velocity) = sensed.velocity_m_per_s else { return [0.0; 3] };
        let rest_s = (self.robot.description.stand_height_m / GRAVITY_M_PER_S2).sqrt();
        let foot = self.legs[leg].foot_in_base_m(&self.held_rad);
        let home = self.home_m[leg];
        let wanted: [f64; 3] = std::array::from_fn(|axis| {
            let ahead = (f64::from(velocity[axis]) * rest_s).clamp(-MOST_AHEAD_M, MOST_AHEAD_M);
            home[axis] + ahead - foot[axis]
        });
        let along = dot(wanted, down);
        std::array::from_fn(|axis| wanted[axis] - along * down[axis])
    }

    /// How far each foot is below the base, along gravity, m.
    fn depths_m(&self, down: [f64; 3]) -> Vec<f64> {
        self.legs.iter().map(|leg| dot(leg.foot_in_base_m(&self.held_rad), down)).collect()
    }

    fn stand_depth_m(&self) -> f64 {
        let radius_m = self.robot.description.feet.first().map_or(0.0, |foot| foot.radius_m);
        self.robot.description.stand_height_m - radius_m
    }

    /// Holds a leg where it is measured to be.
    fn hold(&mut self, leg: usize, position_rad: Option<&[f32]>) {
        let Some(positions) = position_rad else { return };
        for index in self.legs[leg].joints() {
            let joint = &self.robot.description.joints[index];
            self.held_rad[index] = f64::from(positions[index]).clamp(joint.lower_rad, joint.upper_rad);
        }
    }

    /// Moves a foot by `step_m`: `Δq = Jᵀ·(J·Jᵀ + λ²)⁻¹·Δp`, solved for the three
    /// directions together.
    fn move_foot(&mut self, leg: usize, step_m: [f64; 3]) {
        let leg = &self.legs[leg];
        let rows: [Vec<f64>; 3] = std::array::from_fn(|axis| {
            let mut direction = [0.0; 3];
            direction[axis] = 1.0;
            leg.moves_foot(&self.held_rad, direction)
        });
        let product = nalgebra::Matrix3::from_fn(|i, j| {
            let damping = if i == j { INVERSE_DAMPING * INVERSE_DAMPING } else { 0.0 };
            rows[i].iter().zip(&rows[j]).map(|(a, b)| a * b).sum::<f64>() + damping
        });
        let wanted = nalgebra::Vector3::from(step_m);
        let Some(weights) = product.cholesky().map(|factor| factor.solve(&wanted)) else { return };
        let mut moved_rad = self.held_rad.clone();
        for (column, index) in leg.joints().enumerate() {
            let joint = &self.robot.description.joints[index];
            let change: f64 = (0..3).map(|axis| rows[axis][column] * weights[axis]).sum();
            moved_rad[index] = (moved_rad[index] + change).clamp(joint.lower_rad, joint.upper_rad);
        }
        // At the end of its reach or range a leg would swing elsewhere instead; there it stays.
        let (from, to) = (leg.foot_in_base_m(&self.held_rad), leg.foot_in_base_m(&moved_rad));
        let moved_m: [f64; 3] = std::array::from_fn(|axis| to[axis] - from[axis]);
        if dot(moved_m, step_m) > 0.1 * dot(step_m, step_m) {
            self.held_rad = moved_rad;
        }
    }

    /// Brings every leg's torques by `share` of the way to what its part of the weight asks for:
    /// `τ = −Jᵀ·f` with f the weight over the number of legs, upward; none for a leg in the air.
    fn load(&mut self, share: f64, down: [f64; 3]) {
        let weight_n = self.robot.description.mass_kg * GRAVITY_M_PER_S2 / self.legs.len().max(1) as f64;
        for (leg, landed) in self.legs.iter().zip(&self.landed) {
            let along_down = leg.moves_foot(&self.held_rad, down);
            for (index, moved) in leg.joints().zip(along_down) {
                let effort_nm = self.robot.description.joints[index].effort_nm;
                // Against an upward force on the foot the joint must push it down.
                let wanted_nm = if *landed { (moved * weight_n).clamp(-effort_nm, effort_nm) } else { 0.0 };
                self.load_nm[index] += share * (wanted_nm - self.load_nm[index]);
            }
        }
    }
}

#[cfg(test)]
mod tests;
