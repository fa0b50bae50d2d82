//! What a robot measures that walks towards stairs, without any physics: input for a loop that is timed.

use vocaloco_core::elevation::Elevation;
use vocaloco_core::observation::Observation;
use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::Command;

/// Ticks after which the stairs are as far away as at the start.
pub(super) const APPROACH_TICKS: usize = 64;

/// The robot before stairs that come nearer.
pub(super) fn approach(robot: &RobotModel) -> Vec<Observation> {
    (0..APPROACH_TICKS).map(|tick| observation(robot, 0.8 - 0.012 * tick as f64)).collect()
}

/// The robot as it stands, told that it walks, before stairs of 12 cm that begin `nearest_m` ahead.
pub(super) fn observation(robot: &RobotModel, nearest_m: f64) -> Observation {
    Observation {
        t_s: 0.0,
        joint_position_rad: robot.stand_position_rad(),
        joint_velocity_rad_per_s: vec![0.0; robot.joint_count()],
        joint_torque_nm: Some(vec![0.0; robot.joint_count()]),
        foot_contact: Some(vec![true; robot.description.feet.len()]),
        base_linear_velocity: [0.6, 0.0, 0.0],
        base_angular_velocity: [0.0; 3],
        projected_gravity: [0.0, 0.0, -1.0],
        base_in_odom: None,
        elevation: Some(stairs(nearest_m, robot.description.stand_height_m)),
        command: Command::velocity(0.6, 0.0, 0.0),
        field_noise: None,
        heightfield: None,
    }
}

/// Four steps up of 12 cm, 30 cm deep, the first `nearest_m` ahead of a base `height_m` over the floor.
pub(super) fn stairs(nearest_m: f64, height_m: f64) -> Elevation {
    let mut elevation = Elevation {
        t_s: 0.0,
        resolution_m: 0.05,
        back_m: 1.2,
        front_m: 2.2,
        half_width_m: 0.7,
        height_m: Vec::new(),
    };
    let (rows, columns) = (elevation.rows(), elevation.columns());
    for row in 0..rows {
        let x_m = row as f64 * elevation.resolution_m - elevation.back_m;
        let steps = ((x_m - nearest_m) / 0.3 + 1.0).floor().clamp(0.0, 4.0);
        elevation.height_m.extend(std::iter::repeat_n((0.12 * steps - height_m) as f32, columns));
    }
    elevation
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stairs_of_the_patch_are_sound_and_come_nearer() {
        let (far, near) = (stairs(0.8, 0.55), stairs(0.2, 0.55));
        for elevation in [&far, &near] {
            elevation.check().unwrap();
            assert!((elevation.height_m(0.0, 0.0) + 0.55).abs() < 1e-6);
        }
        assert!(near.height_m(0.5, 0.3) > far.height_m(0.5, 0.3) + 0.1);
    }
}
