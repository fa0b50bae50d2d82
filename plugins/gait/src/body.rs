//! The body between and within ticks: attitude and velocity filtered from noisy measurements, and
//! what the terrain under it asks of it.

use nalgebra::{Matrix3, Rotation3, Vector3};
use vocaloco_plugin_api::RobotState;

use crate::{
    gait::TICK_S,
    ground::{Ground, Line},
    parameters::Parameters,
};

/// Largest error of the base's height that is acted on, m.
const LARGEST_HEIGHT_ERROR_M: f64 = 0.15;

/// What is remembered of the body between ticks.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Estimate {
    roll: f64,
    pitch: f64,
    velocity_in_base: Vector3<f64>,
}

/// What is known of the body this tick.
pub(crate) struct Body {
    /// Yaw-aligned frame from base frame.
    pub(crate) rotation: Rotation3<f64>,
    /// About x, rad.
    pub(crate) roll: f64,
    /// About y, rad: nose down is positive (REP-103).
    pub(crate) pitch: f64,
    /// Of the base origin, yaw-aligned frame, m/s.
    pub(crate) velocity: Vector3<f64>,
    /// Yaw-aligned frame, rad/s.
    pub(crate) rates: Vector3<f64>,
    /// The terrain under the body.
    pub(crate) line: Line,
}

impl Estimate {
    /// As measured, when there is nothing before it.
    pub(crate) fn of(state: &RobotState<'_>) -> Self {
        let (roll, pitch) = measured_attitude(state);
        Self { roll, pitch, velocity_in_base: state.base_linear_velocity_m_per_s.map(f64::from).into() }
    }

    /// Yaw-aligned frame from base frame.
    pub(crate) fn rotation(&self) -> Rotation3<f64> {
        attitude(self.roll, self.pitch)
    }

    /// One tick on: attitude by integrating the rates and leaning towards gravity, velocity by an
    /// exponential average.
    pub(crate) fn update(
        &mut self,
        state: &RobotState<'_>,
        ground: &Ground<'_>,
        parameters: &Parameters,
    ) -> Body {
        let p = parameters;
        let (roll, pitch) = measured_attitude(state);
        let rates_in_base = Vector3::from(state.base_angular_velocity_rad_per_s.map(f64::from));
        let turned = attitude(self.roll, self.pitch) * rates_in_base;
        let predicted = (self.roll + turned.x * TICK_S, self.pitch + turned.y * TICK_S);
        self.roll = predicted.0 + p.attitude_trust * (roll - predicted.0);
        self.pitch = predicted.1 + p.attitude_trust * (pitch - predicted.1);
        let rotation = attitude(self.roll, self.pitch);
        let measured = Vector3::from(state.base_linear_velocity_m_per_s.map(f64::from));
        self.velocity_in_base += p.velocity_trust * (measured - self.velocity_in_base);
        Body {
            rotation,
            roll: self.roll,
            pitch: self.pitch,
            velocity: rotation * self.velocity_in_base,
            rates: rotation * rates_in_base,
            line: ground.line(p.fit_ahead_m, p.fit_half_length_m),
        }
    }
}

impl Body {
    /// The pitch that follows the terrain: nose up where it rises.
    pub(crate) fn wanted_pitch_rad(&self, parameters: &Parameters) -> f64 {
        -parameters.pitch_follow * libm::atan(self.line.slope)
    }

    /// How much higher the base should be above the terrain.
    pub(crate) fn height_error_m(&self, parameters: &Parameters) -> f64 {
        (parameters.base_height_m + self.line.height_m).clamp(-LARGEST_HEIGHT_ERROR_M, LARGEST_HEIGHT_ERROR_M)
    }
}

/// Roll and pitch, rad, from the direction of gravity.
fn measured_attitude(state: &RobotState<'_>) -> (f64, f64) {
    let gravity = state.projected_gravity.map(f64::from);
    (libm::atan2(-gravity[1], -gravity[2]), libm::asin(gravity[0].clamp(-1.0, 1.0)))
}

/// Yaw-aligned frame from base frame.
pub(crate) fn attitude(roll: f64, pitch: f64) -> Rotation3<f64> {
    let (sr, cr, sp, cp) = (libm::sin(roll), libm::cos(roll), libm::sin(pitch), libm::cos(pitch));
    #[rustfmt::skip]
    let matrix = Matrix3::new(
        cp, sp * sr, sp * cr,
        0.0, cr, -sr,
        -sp, cp * sr, cp * cr,
    );
    Rotation3::from_matrix_unchecked(matrix)
}
