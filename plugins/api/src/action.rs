//! What a policy's output means on a robot, and which output asks for a given torque.

use crate::contract::{Contract, ContractError, inside, number_by_name};
use crate::{JointTarget, RobotDescription};

/// Turns actions into joint targets by a contract, and torques back into actions.
///
/// ```text
/// q* = q_default + scale·clamp(a, ±clip)          τ = k·(q* − q) − d·q̇
/// ```
///
/// Actions are in the policy's order, all else in the robot's. `q*` is kept within the joint's range
/// widened by the angle that is worth the drive's whole effort, `effort / k`: beyond it a standing
/// drive saturates anyway, and hosts refuse such targets.
#[derive(Clone, Debug)]
pub struct ActionMap {
    clip: f32,
    rows: Vec<Row>,
}

/// One action: the joint it drives, and its numbers.
#[derive(Clone, Debug)]
struct Row {
    joint: usize,
    default_rad: f32,
    scale_rad: f32,
    stiffness_nm_per_rad: f32,
    damping_nms_per_rad: f32,
    least_rad: f32,
    greatest_rad: f32,
}

impl ActionMap {
    /// The map of a contract on `robot`.
    ///
    /// # Errors
    /// A joint that does not fit, or a number that is missing or outside its range.
    pub fn new(contract: &Contract, robot: &RobotDescription) -> Result<Self, ContractError> {
        let (joints, action, gains) = (&contract.joints, &contract.action, &contract.gains);
        let indices = contract.joints_on(robot)?;
        let clip = inside("action.clip", action.clip, 1e-3..=1e4)?;
        let defaults = number_by_name("action.default_position_rad", &action.default_position_rad, joints)?;
        let scales = action.scale.in_order("action.scale", joints)?;
        let (stiffness, damping) = ("gains.stiffness_nm_per_rad", "gains.damping_nms_per_rad");
        let stiffnesses = gains.stiffness_nm_per_rad.in_order(stiffness, joints)?;
        let dampings = gains.damping_nms_per_rad.in_order(damping, joints)?;
        let mut rows = Vec::with_capacity(indices.len());
        for (row, &joint) in indices.iter().enumerate() {
            let described = &robot.joints[joint];
            let field = format!("action.default_position_rad.{}", joints[row]);
            let (lower, upper) = (described.lower_rad, described.upper_rad);
            let default_rad = inside(field, defaults[row], lower..=upper)?;
            inside("action.scale", scales[row].abs(), 1e-3..=10.0)?;
            let stiffness = inside(stiffness, stiffnesses[row], 1.0..=1000.0)?;
            let damping = inside(damping, dampings[row], 0.01..=100.0)?;
            let folded = described.effort_nm / stiffness;
            rows.push(Row {
                joint,
                default_rad: default_rad as f32,
                scale_rad: scales[row] as f32,
                stiffness_nm_per_rad: stiffness as f32,
                damping_nms_per_rad: damping as f32,
                least_rad: (lower - folded) as f32,
                greatest_rad: (upper + folded) as f32,
            });
        }
        Ok(Self { clip: clip as f32, rows })
    }

    /// Number of actions, which is the number of joints.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is no action.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Clips `action` in place: what is kept as the last action, and what [`targets`](Self::targets)
    /// is given.
    pub fn clip(&self, action: &mut [f32]) {
        for value in action {
            *value = value.clamp(-self.clip, self.clip);
        }
    }

    /// The targets that `action`, clipped, asks for; `joints` in the robot's order, as many as it has.
    pub fn targets(&self, action: &[f32], joints: &mut [JointTarget]) {
        for (row, value) in self.rows.iter().zip(action) {
            let position_rad = row.default_rad + row.scale_rad * value;
            joints[row.joint] = JointTarget {
                // NaN stays NaN, for the host to notice.
                position_rad: position_rad.clamp(row.least_rad, row.greatest_rad),
                stiffness_nm_per_rad: row.stiffness_nm_per_rad,
                damping_nms_per_rad: row.damping_nms_per_rad,
                feed_forward_nm: 0.0,
            };
        }
    }

    /// The action that asks for the torque that `targets` ask for, at the present joint state: what an
    /// expert with gains of its own teaches.
    ///
    /// ```text
    /// a = (q + (τ + d·q̇)/k − q_default) / scale,   τ of [`JointTarget::torque_nm`]
    /// ```
    ///
    /// | argument | meaning | unit | shape |
    /// |---|---|---|---|
    /// | `targets` | of the expert | | `[joint]`, the robot's order |
    /// | `q_rad`, `qd_rad_per_s` | present position and velocity | rad, rad/s | `[joint]`, the robot's order |
    /// | `action` | clipped | 1 | `[joint]`, the policy's order |
    ///
    /// Exact at this instant; between ticks the torques part where the gains differ.
    pub fn action_of(
        &self,
        targets: &[JointTarget],
        q_rad: &[f32],
        qd_rad_per_s: &[f32],
        action: &mut [f32],
    ) {
        for (row, value) in self.rows.iter().zip(action.iter_mut()) {
            let (q, qd) = (q_rad[row.joint], qd_rad_per_s[row.joint]);
            let torque_nm = targets[row.joint].torque_nm(q, qd);
            let position_rad = q + (torque_nm + row.damping_nms_per_rad * qd) / row.stiffness_nm_per_rad;
            *value = (position_rad - row.default_rad) / row.scale_rad;
        }
        self.clip(action);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::tests::{contract, robot};

    fn map() -> ActionMap {
        ActionMap::new(&contract(), &robot()).unwrap()
    }

    #[test]
    fn an_action_moves_the_joint_of_its_name() {
        let mut joints = [JointTarget::default(); 4];
        map().targets(&[1.0, 2.0, -1.0, 0.5], &mut joints);
        let positions = joints.map(|joint| joint.position_rad);
        // L_HIP 0.1 + 0.25·2, L_KNEE 0.2 − 0.3, R_HIP −0.3 + 0.6·0.5, R_KNEE −0.4 + 0.5.
        for (found, wanted) in positions.iter().zip([0.6, -0.1, 0.0, 0.1]) {
            assert!((found - wanted).abs() < 1e-6, "{positions:?}");
        }
        assert_eq!(joints.map(|joint| joint.damping_nms_per_rad), [3.0, 4.0, 5.0, 2.0]);
        assert_eq!(joints.map(|joint| joint.stiffness_nm_per_rad), [80.0; 4]);
    }

    #[test]
    fn an_action_is_clipped_and_nan_stays_nan() {
        let mut action = [9.0, -9.0, 1.0, f32::NAN];
        map().clip(&mut action);
        assert_eq!(action[..3], [4.0, -4.0, 1.0]);
        let mut joints = [JointTarget::default(); 4];
        map().targets(&action, &mut joints);
        assert!(joints[2].position_rad.is_nan() && joints[0].position_rad.is_finite());
    }

    #[test]
    fn a_target_lies_no_further_out_than_the_drives_effort_is_worth() {
        let mut joints = [JointTarget::default(); 4];
        // L_HIP: 0.1 + 0.25·100 against an upper end of 1 rad and 80 N·m at 80 N·m/rad.
        map().targets(&[0.0, 100.0, 0.0, 0.0], &mut joints);
        assert!((joints[0].position_rad - 2.0).abs() < 1e-6, "{:?}", joints[0]);
    }

    #[test]
    fn the_action_of_a_torque_asks_for_that_torque() {
        let target = |position_rad, feed_forward_nm| JointTarget {
            position_rad,
            stiffness_nm_per_rad: 120.0,
            damping_nms_per_rad: 1.0,
            feed_forward_nm,
        };
        let expert = [target(0.3, 5.0), target(-0.2, 0.0), target(0.1, -8.0), target(0.0, 2.0)];
        let (q, qd) = ([0.2, -0.1, 0.15, 0.05], [1.0, -2.0, 0.5, 0.0]);
        let (mut action, mut joints) = ([0.0; 4], [JointTarget::default(); 4]);
        map().action_of(&expert, &q, &qd, &mut action);
        map().targets(&action, &mut joints);
        for joint in 0..4 {
            let found = joints[joint].torque_nm(q[joint], qd[joint]);
            let wanted = expert[joint].torque_nm(q[joint], qd[joint]);
            assert!((found - wanted).abs() < 1e-4, "joint {joint}: {found}, wanted {wanted} N·m");
        }
    }
}
