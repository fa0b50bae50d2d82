//! Where a body is.

use rapier3d::math::{Pose, Rotation, Vector};
use vocaloco_core::observation::BaseInOdom;

/// Position and orientation of a link's frame in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BasePose {
    /// Origin in the world, m.
    pub position_m: [f32; 3],
    /// Orientation, world from body, quaternion x, y, z, w.
    pub orientation_xyzw: [f32; 4],
}

impl From<&BasePose> for BaseInOdom {
    /// The world is the odometry frame.
    fn from(base: &BasePose) -> Self {
        Self {
            position_m: base.position_m.map(f64::from),
            orientation_xyzw: base.orientation_xyzw.map(f64::from),
        }
    }
}

impl BasePose {
    /// Upright at a position, turned by `yaw_rad` about the vertical.
    pub fn from_yaw(position_m: [f32; 3], yaw_rad: f32) -> Self {
        let half = 0.5 * yaw_rad;
        Self { position_m, orientation_xyzw: [0.0, 0.0, libm::sinf(half), libm::cosf(half)] }
    }

    /// Turned by roll about x, then pitch about y, then yaw about z, all about the world's axes.
    pub fn from_roll_pitch_yaw(position_m: [f32; 3], roll_rad: f32, pitch_rad: f32, yaw_rad: f32) -> Self {
        let about = |axis: Vector, angle: f32| {
            let sine = libm::sinf(0.5 * angle);
            Rotation::from_xyzw(axis.x * sine, axis.y * sine, axis.z * sine, libm::cosf(0.5 * angle))
        };
        let rotation = about(Vector::Z, yaw_rad) * about(Vector::Y, pitch_rad) * about(Vector::X, roll_rad);
        Self { position_m, orientation_xyzw: rotation.normalize().to_array() }
    }

    /// Heading of the body's x axis about the vertical, rad, −π to π.
    pub fn yaw(&self) -> f32 {
        let forward = self.vector_in_world([1.0, 0.0, 0.0]);
        libm::atan2f(forward[1], forward[0])
    }

    /// A vector given in the body's frame, in the world's.
    pub fn vector_in_world(&self, vector_in_body: [f32; 3]) -> [f32; 3] {
        (self.rotation() * Vector::from_array(vector_in_body)).to_array()
    }

    /// A vector given in the world's frame, in the body's.
    pub fn vector_in_body(&self, vector_in_world: [f32; 3]) -> [f32; 3] {
        (self.rotation().inverse() * Vector::from_array(vector_in_world)).to_array()
    }

    fn rotation(&self) -> Rotation {
        let [x, y, z, w] = self.orientation_xyzw;
        Rotation::from_xyzw(x, y, z, w)
    }
}

impl From<&BasePose> for Pose {
    fn from(pose: &BasePose) -> Self {
        Self::from_parts(Vector::from_array(pose.position_m), pose.rotation())
    }
}

impl From<&Pose> for BasePose {
    fn from(pose: &Pose) -> Self {
        Self { position_m: pose.translation.to_array(), orientation_xyzw: pose.rotation.to_array() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn yaw_survives_roll_and_pitch() {
        for yaw in [-3.0_f32, -0.4, 0.0, 1.2, 2.9] {
            let pose = BasePose::from_roll_pitch_yaw([1.0, 2.0, 3.0], 0.2, -0.3, yaw);
            assert!((pose.yaw() - yaw).abs() < 1e-5, "{} for {yaw}", pose.yaw());
        }
    }

    #[test]
    fn positive_pitch_lowers_the_nose_and_positive_roll_the_right_side() {
        let pose = BasePose::from_roll_pitch_yaw([0.0; 3], 0.0, 0.3, 0.7);
        assert!(pose.vector_in_world([1.0, 0.0, 0.0])[2] < -0.2);
        let pose = BasePose::from_roll_pitch_yaw([0.0; 3], 0.3, 0.0, 0.7);
        assert!(pose.vector_in_world([0.0, -1.0, 0.0])[2] < -0.2);
    }

    #[test]
    fn world_and_body_are_inverse() {
        let pose = BasePose::from_roll_pitch_yaw([0.0; 3], 0.3, -0.5, 1.9);
        let back = pose.vector_in_body(pose.vector_in_world([0.1, -0.7, 0.4]));
        for (found, wanted) in back.iter().zip([0.1, -0.7, 0.4]) {
            assert!((found - wanted).abs() < 1e-6);
        }
    }
}
