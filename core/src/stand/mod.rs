//! The core's own controller: the robot stands, whatever happens to skills, sensors or commands.
//!
//! From where the joints are it brings each leg to the stand pose, on a straight line in joint space
//! and no faster than the foot may be lowered; then it holds. It begins with the torque that the
//! joints carry at that moment, so that taking over is no jolt and the robot does not sag.

mod legs;

use std::sync::Arc;

use vocaloco_plugin_api::JointTarget;

use crate::robot::RobotModel;
use legs::{Leg, dot};

/// A foot moves no faster than this many times the lowering speed: sideways it may go quicker than
/// down, but not jump.
const FOOT_SPEED_FACTOR: f64 = 2.0;
/// The way to the stand pose takes at least this long, s.
const LEAST_S: f64 = 0.2;
/// A joint that belongs to no leg moves at this speed, rad/s.
const OTHER_JOINTS_RAD_PER_S: f64 = 1.0;
/// Within this of the stand pose at the start of the loop the robot is taken to stand already, rad.
const STANDING_ALREADY_RAD: f32 = 0.1;

/// What is known of the joints when the stand takes over.
#[derive(Clone, Copy, Debug)]
pub struct Handover<'a> {
    /// Measured positions, rad; none when the measurement cannot be used.
    pub position_rad: Option<&'a [f32]>,
    /// Measured torques, N·m, where known.
    pub torque_nm: Option<&'a [f32]>,
    /// What the drives were last told; none at the start of the loop.
    pub last: Option<&'a [JointTarget]>,
}

/// The stand of one robot.
#[derive(Clone, Debug)]
pub struct Stand {
    robot: Arc<RobotModel>,
    legs: Vec<Leg>,
    /// Joints of no leg.
    others: Vec<usize>,
    start_rad: Vec<f64>,
    goal_rad: Vec<f64>,
    now_rad: Vec<f64>,
    /// How far each leg has come, 0 to 1.
    progress: Vec<f64>,
}

impl Stand {
    /// A stand at rest in its pose.
    pub fn new(robot: Arc<RobotModel>) -> Self {
        let legs = Leg::all(&robot.description);
        let goal_rad: Vec<f64> = robot.description.joints.iter().map(|joint| joint.stand_rad).collect();
        let in_legs: Vec<usize> = legs.iter().flat_map(Leg::joints).collect();
        Self {
            others: (0..goal_rad.len()).filter(|joint| !in_legs.contains(joint)).collect(),
            progress: vec![1.0; legs.len()],
            start_rad: goal_rad.clone(),
            now_rad: goal_rad.clone(),
            goal_rad,
            legs,
            robot,
        }
    }

    /// Takes over the joints.
    ///
    /// A joint starts at the target at which its drive, with the stand's stiffness, gives the torque
    /// it was giving: `q + τ/k`, with τ measured or as the last target asks for it.
    pub fn begin(&mut self, from: Handover<'_>) {
        let stiffness = f64::from(self.robot.stand.stiffness_nm_per_rad);
        for (index, joint) in self.robot.description.joints.iter().enumerate() {
            let measured = from.position_rad.map(|positions| positions[index]);
            let last = from.last.map(|targets| targets[index]);
            let torque_nm = match (from.torque_nm, last, measured) {
                (Some(torques), ..) => torques[index],
                (None, Some(last), Some(measured)) => {
                    last.stiffness_nm_per_rad * (last.position_rad - measured) + last.feed_forward_nm
                }
                _ => 0.0,
            };
            let torque_nm = f64::from(torque_nm).clamp(-joint.effort_nm, joint.effort_nm);
            let position = measured.or(last.map(|last| last.position_rad)).map_or(joint.stand_rad, f64::from);
            self.start_rad[index] = position.clamp(joint.lower_rad, joint.upper_rad) + torque_nm / stiffness;
        }
        let standing = from.last.is_none()
            && from.position_rad.is_none_or(|positions| {
                positions
                    .iter()
                    .zip(&self.goal_rad)
                    .all(|(position, goal)| (position - *goal as f32).abs() < STANDING_ALREADY_RAD)
            });
        if standing {
            self.start_rad.copy_from_slice(&self.goal_rad);
        }
        self.now_rad.copy_from_slice(&self.start_rad);
        self.progress.fill(0.0);
    }

    /// One tick of `dt_s`: fills `joints`. `gravity` is its unit vector in the base frame.
    pub fn step(&mut self, dt_s: f64, gravity: [f32; 3], joints: &mut [JointTarget]) {
        let gravity = gravity.map(f64::from);
        for index in 0..self.legs.len() {
            self.advance(index, dt_s, gravity);
        }
        for &joint in &self.others {
            let reach = OTHER_JOINTS_RAD_PER_S * dt_s;
            let left = self.goal_rad[joint] - self.now_rad[joint];
            self.now_rad[joint] += left.clamp(-reach, reach);
        }
        for (target, position) in joints.iter_mut().zip(&self.now_rad) {
            *target = JointTarget {
                position_rad: *position as f32,
                stiffness_nm_per_rad: self.robot.stand.stiffness_nm_per_rad,
                damping_nms_per_rad: self.robot.stand.damping_nms_per_rad,
                feed_forward_nm: 0.0,
            };
        }
    }

    /// Whether every leg has reached the stand pose.
    pub fn is_settled(&self) -> bool {
        self.progress.iter().all(|&progress| progress >= 1.0)
    }

    fn advance(&mut self, index: usize, dt_s: f64, gravity: [f64; 3]) {
        let progress = self.progress[index];
        if progress >= 1.0 {
            return;
        }
        let leg = &self.legs[index];
        let (start, goal) = (&self.start_rad, &self.goal_rad);
        let foot_at = |progress: f64| {
            leg.foot_in_base_m(|joint| start[joint] + progress * (goal[joint] - start[joint]))
        };
        let lowered_m = f64::from(self.robot.stand.lowering_speed_m_per_s) * dt_s;
        let here = foot_at(progress);
        let mut step = (dt_s / LEAST_S).min(1.0 - progress);
        // A leg's foot path is smooth, so a few halvings find a step that is slow enough; should
        // they not, the last one is 1/4096 of the whole way, which is slow enough for any leg.
        for _ in 0..12 {
            let there = foot_at(progress + step);
            let moved: [f64; 3] = std::array::from_fn(|axis| there[axis] - here[axis]);
            let down_m = dot(moved, gravity);
            if down_m <= lowered_m && dot(moved, moved) <= (FOOT_SPEED_FACTOR * lowered_m).powi(2) {
                break;
            }
            step *= 0.5;
        }
        let progress = if progress + step > 1.0 - 1e-9 { 1.0 } else { progress + step };
        self.progress[index] = progress;
        for joint in leg.joints() {
            self.now_rad[joint] = start[joint] + progress * (goal[joint] - start[joint]);
        }
    }
}

#[cfg(test)]
mod tests;
