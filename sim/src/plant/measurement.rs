//! What the plant measures after every physics step.

use vocaloco_core::robot::Drive;
use vocaloco_plugin_api::JointTarget;

use super::BasePose;

/// The robot as measured after a physics step; nothing is noisy here.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// By the robot's joint order, rad.
    pub joint_position_rad: Vec<f32>,
    /// By the robot's joint order, rad/s.
    pub joint_velocity_rad_per_s: Vec<f32>,
    /// As the drives gave it over the last step, N·m.
    pub joint_torque_nm: Vec<f32>,
    /// The base in the world.
    pub base: BasePose,
    /// Of the base origin, in the base frame, m/s.
    pub base_linear_velocity: [f32; 3],
    /// In the base frame, rad/s.
    pub base_angular_velocity: [f32; 3],
    /// Unit vector of gravity in the base frame.
    pub projected_gravity: [f32; 3],
    /// By the robot's feet: pressing on the ground in the last step.
    pub foot_contact: Vec<bool>,
    /// By the robot's feet: pressing on something steeper than 60°, such as a riser, in the last step.
    pub foot_stumble: Vec<bool>,
    /// A base shape pressed on anything in the last step.
    pub base_contact: bool,
    /// A shape other than a foot pressed on anything in the last step.
    pub nonfoot_contact: bool,
}

impl Measurement {
    /// Sets the torques that drives of strength `strength` give when following `targets`, held over the
    /// next physics step.
    ///
    /// ```text
    /// τ = strength · limit(k·(q* − q) − d·q̇ + τ_ff, q̇)
    /// ```
    ///
    /// with q and q̇ as measured before the step, and the drive's
    /// [`limit`](vocaloco_core::robot::Drive::limit).
    pub(crate) fn drive(&mut self, drive: &Drive, strength: f32, targets: &[JointTarget]) {
        debug_assert_eq!(targets.len(), self.joint_position_rad.len());
        for (joint, target) in targets.iter().enumerate() {
            let velocity = self.joint_velocity_rad_per_s[joint];
            let error = target.position_rad - self.joint_position_rad[joint];
            let asked = target.stiffness_nm_per_rad * error - target.damping_nms_per_rad * velocity
                + target.feed_forward_nm;
            self.joint_torque_nm[joint] = strength * drive.limit(asked, velocity);
        }
    }

    pub(crate) fn at_rest(base: BasePose, joint_position_rad: &[f32], feet: usize) -> Self {
        let joints = joint_position_rad.len();
        Self {
            joint_position_rad: joint_position_rad.to_vec(),
            joint_velocity_rad_per_s: vec![0.0; joints],
            joint_torque_nm: vec![0.0; joints],
            base,
            base_linear_velocity: [0.0; 3],
            base_angular_velocity: [0.0; 3],
            projected_gravity: base.vector_in_body([0.0, 0.0, -1.0]),
            foot_contact: vec![false; feet],
            foot_stumble: vec![false; feet],
            base_contact: false,
            nonfoot_contact: false,
        }
    }
}
