//! What crosses the border every tick.

use abi_stable::{StableAbi, std_types::RSlice};

use crate::CommandKind;

/// The robot as measured this tick.
///
/// | field | meaning | unit | frame, shape |
/// |---|---|---|---|
/// | `time_s` | time of the measurement, monotonic | s | |
/// | `joint_*` | by [`RobotDescription::joints`](crate::RobotDescription) | rad, rad/s, N·m | `[joint]`; torque empty if not provided |
/// | `base_linear_velocity`, `base_angular_velocity` | of the base origin | m/s, rad/s | base frame |
/// | `projected_gravity` | unit vector of gravity | 1 | base frame |
/// | `foot_contact` | 1 touching, 0 not | | `[foot]`, empty if not provided |
/// | `terrain` | heights relative to the base origin, NaN unknown | m | row-major `[row][column]`, rows back to front, columns left to right, yaw-aligned; the patch that the plugin asked for |
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug)]
#[allow(missing_docs, reason = "the table above says it once")]
pub struct RobotState<'a> {
    pub time_s: f64,
    pub joint_position_rad: RSlice<'a, f32>,
    pub joint_velocity_rad_per_s: RSlice<'a, f32>,
    pub joint_torque_nm: RSlice<'a, f32>,
    pub base_linear_velocity_m_per_s: [f32; 3],
    pub base_angular_velocity_rad_per_s: [f32; 3],
    pub projected_gravity: [f32; 3],
    pub foot_contact: RSlice<'a, u8>,
    pub terrain_m: RSlice<'a, f32>,
}

/// What the robot is asked to do this tick.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Which of the fields below counts.
    pub kind: CommandKind,
    /// Forward m/s, left m/s, yaw rate rad/s, in the yaw-aligned base frame.
    pub velocity: [f32; 3],
    /// Target x m, y m, heading rad in the yaw-aligned base frame, and the time left, s.
    pub target: [f32; 4],
}

impl Command {
    /// A velocity command: forward m/s, left m/s, yaw rate rad/s.
    pub const fn velocity(forward: f32, left: f32, yaw_rate: f32) -> Self {
        Self { kind: CommandKind::Velocity, velocity: [forward, left, yaw_rate], target: [0.0; 4] }
    }
}

/// What one joint's drive should do until the next tick: torque is
/// `stiffness·(position − q) − damping·q̇ + feed_forward`, evaluated by the plant at 200 Hz or more.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug, Default, PartialEq)]
pub struct JointTarget {
    /// Target position, rad.
    pub position_rad: f32,
    /// Stiffness, N·m/rad.
    pub stiffness_nm_per_rad: f32,
    /// Damping, N·m·s/rad.
    pub damping_nms_per_rad: f32,
    /// Torque added to the PD law, N·m.
    pub feed_forward_nm: f32,
}

impl JointTarget {
    /// Torque that the drive is asked for at position `q_rad` and velocity `qd_rad_per_s`, N·m, before
    /// its limits.
    pub fn torque_nm(&self, q_rad: f32, qd_rad_per_s: f32) -> f32 {
        self.stiffness_nm_per_rad * (self.position_rad - q_rad) - self.damping_nms_per_rad * qd_rad_per_s
            + self.feed_forward_nm
    }
}
