//! Whether an instance keeps the promise that the same inputs since a reset give the same bytes.

use std::path::Path;

use vocaloco_plugin_api::{Command, JointTarget, RobotDescription};

use super::{PluginInstance, StateBuffer};
use crate::manifest::{CommandRange, Finding};

/// Ticks of each round: about a cycle of a gait.
const TICKS: usize = 25;

/// Drives the instance twice from a reset through the same inputs, the robot in its stand on flat
/// ground, and compares every target.
///
/// # Errors
/// The first target that differs, or the plugin fails at this.
pub(crate) fn check(
    file: &Path,
    instance: &mut PluginInstance,
    robot: &RobotDescription,
    range: &CommandRange,
) -> Result<(), Finding> {
    let mut rounds = [Vec::new(), Vec::new()];
    for round in &mut rounds {
        drive(instance, robot, range, round)
            .map_err(|line| Finding::new(file, "act", line, "targets in the stand on flat ground"))?;
    }
    let [first, second] = rounds;
    for (index, (one, other)) in first.iter().zip(&second).enumerate() {
        let bits = |it: &JointTarget| {
            [it.position_rad, it.stiffness_nm_per_rad, it.damping_nms_per_rad, it.feed_forward_nm]
                .map(f32::to_bits)
        };
        if bits(one) != bits(other) {
            let (tick, joint) = (index / robot.joints.len(), &robot.joints[index % robot.joints.len()].name);
            let found = format!("{other:?} for {joint} in tick {tick} after the second reset");
            return Err(Finding::new(file, "act", found, format!("{one:?}, as after the first")));
        }
    }
    Ok(())
}

fn drive(
    instance: &mut PluginInstance,
    robot: &RobotDescription,
    range: &CommandRange,
    round: &mut Vec<JointTarget>,
) -> Result<(), String> {
    let needs = *instance.needs();
    let points = needs.terrain.as_ref().map_or(0, |patch| patch.rows() * patch.columns());
    let [least, greatest] = range.forward_m_per_s;
    let command = Command {
        kind: range.kind,
        target: [range.target_distance_m.unwrap_or(0.0) as f32, 0.0, 0.0, 4.0],
        ..Command::velocity((0.5 * (least + greatest)) as f32, 0.0, 0.1)
    };
    let mut state = StateBuffer {
        time_s: 0.0,
        joint_position_rad: robot.joints.iter().map(|joint| joint.stand_rad as f32).collect(),
        joint_velocity_rad_per_s: vec![0.0; robot.joints.len()],
        joint_torque_nm: vec![0.0; robot.joints.len()],
        base_linear_velocity_m_per_s: [0.0; 3],
        base_angular_velocity_rad_per_s: [0.0; 3],
        projected_gravity: [0.0, 0.0, -1.0],
        foot_contact: vec![1; robot.feet.len()],
        terrain_m: vec![-robot.stand_height_m as f32; points],
    };
    instance.reset(&state.state()).map_err(|error| format!("reset: {error}"))?;
    let mut joints = vec![JointTarget::default(); robot.joints.len()];
    for tick in 0..TICKS {
        state.time_s = 0.02 * tick as f64;
        for (index, velocity) in state.joint_velocity_rad_per_s.iter_mut().enumerate() {
            *velocity = 0.01 * (tick * 3 + index) as f32;
        }
        instance.act(&state.state(), &command, &mut joints).map_err(|error| format!("act: {error}"))?;
        round.extend_from_slice(&joints);
    }
    Ok(())
}
