//! A state that owns its arrays, for calls that outlive the tick or leave the process.

use vocaloco_plugin_api::RobotState;

/// An owned [`RobotState`], filled anew each tick without allocating once its arrays have their size.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct StateBuffer {
    pub(crate) time_s: f64,
    pub(crate) joint_position_rad: Vec<f32>,
    pub(crate) joint_velocity_rad_per_s: Vec<f32>,
    pub(crate) joint_torque_nm: Vec<f32>,
    pub(crate) base_linear_velocity_m_per_s: [f32; 3],
    pub(crate) base_angular_velocity_rad_per_s: [f32; 3],
    pub(crate) projected_gravity: [f32; 3],
    pub(crate) foot_contact: Vec<u8>,
    pub(crate) terrain_m: Vec<f32>,
}

impl StateBuffer {
    /// Takes over every value of `state`.
    pub(crate) fn copy_from(&mut self, state: &RobotState<'_>) {
        self.time_s = state.time_s;
        refill(&mut self.joint_position_rad, state.joint_position_rad.as_slice());
        refill(&mut self.joint_velocity_rad_per_s, state.joint_velocity_rad_per_s.as_slice());
        refill(&mut self.joint_torque_nm, state.joint_torque_nm.as_slice());
        self.base_linear_velocity_m_per_s = state.base_linear_velocity_m_per_s;
        self.base_angular_velocity_rad_per_s = state.base_angular_velocity_rad_per_s;
        self.projected_gravity = state.projected_gravity;
        refill(&mut self.foot_contact, state.foot_contact.as_slice());
        refill(&mut self.terrain_m, state.terrain_m.as_slice());
    }

    /// The state, as a plugin reads it.
    pub(crate) fn state(&self) -> RobotState<'_> {
        RobotState {
            time_s: self.time_s,
            joint_position_rad: self.joint_position_rad.as_slice().into(),
            joint_velocity_rad_per_s: self.joint_velocity_rad_per_s.as_slice().into(),
            joint_torque_nm: self.joint_torque_nm.as_slice().into(),
            base_linear_velocity_m_per_s: self.base_linear_velocity_m_per_s,
            base_angular_velocity_rad_per_s: self.base_angular_velocity_rad_per_s,
            projected_gravity: self.projected_gravity,
            foot_contact: self.foot_contact.as_slice().into(),
            terrain_m: self.terrain_m.as_slice().into(),
        }
    }
}

fn refill<T: Copy>(into: &mut Vec<T>, from: &[T]) {
    into.clear();
    into.extend_from_slice(from);
}
