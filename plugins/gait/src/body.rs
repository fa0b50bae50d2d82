//! The body between and within ticks: attitude and velocity filtered from noisy measurements, and
//! what the terrain under it asks of it.

use nalgebra::{Matrix3, Rotation3, Vector3};
use vocaloco_plugin_api::RobotState;

use crate::{
    gait::TICK_S,
    ground::{Ground, Line},
    parameters::Parameters,
};

/// Spacing and width of the points below the base at which its distance to the ground is looked at.
const BELLY_PROBE_M: f64 = 0.06;
const BELLY_HALF_WIDTH_M: f64 = 0.1;
/// Largest pitch that makes up for a want of distance.
const LARGEST_LIFT_RAD: f64 = 0.4;
/// Largest error of the base's height that is acted on, m.
const LARGEST_HEIGHT_ERROR_M: f64 = 0.15;

/// What is remembered of the body between ticks.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Estimate {
    roll: f64,
    pitch: f64,
    velocity_in_base: Vector3<f64>,
    /// The terrain under the body as last estimated.
    line: Option<Line>,
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
    /// How much too near the ground the base is.
    lack: Lack,
}

/// How far the base's fore and hind half would have to rise for the distance that the parameters ask, m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[expect(clippy::struct_field_names, reason = "all of them are metres, and names end in their unit")]
struct Lack {
    fore_m: f64,
    hind_m: f64,
    /// From the middle of one half to that of the other.
    length_m: f64,
}

impl Estimate {
    /// As measured, when there is nothing before it.
    pub(crate) fn of(state: &RobotState<'_>) -> Self {
        let (roll, pitch) = measured_attitude(state);
        let velocity_in_base = state.base_linear_velocity_m_per_s.map(f64::from).into();
        Self { roll, pitch, velocity_in_base, line: None }
    }

    /// Yaw-aligned frame from base frame.
    pub(crate) fn rotation(&self) -> Rotation3<f64> {
        attitude(self.roll, self.pitch)
    }

    /// One tick on: attitude by integrating the rates and leaning towards gravity, velocity by an
    /// exponential average.
    ///
    /// `hip_x_m` is how far the hips are from the base's origin.
    pub(crate) fn update(
        &mut self,
        state: &RobotState<'_>,
        ground: &Ground<'_>,
        hip_x_m: f64,
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
        let velocity = rotation * self.velocity_in_base;
        let fitted = ground.line(p.fit_ahead_m, p.fit_half_length_m);
        let line = self.line.map_or(fitted, |last| last.moved(&velocity).towards(&fitted, p.line_trust));
        self.line = Some(line);
        Body {
            rotation,
            roll: self.roll,
            pitch: self.pitch,
            lack: lack(ground, self.pitch, hip_x_m, p),
            velocity,
            rates: rotation * rates_in_base,
            line,
        }
    }
}

impl Line {
    /// The same line a tick later, seen from a base that moves.
    fn moved(self, velocity: &Vector3<f64>) -> Self {
        let rise_m = (self.slope * velocity.x - velocity.z) * TICK_S;
        Self { height_m: self.height_m + rise_m, slope: self.slope }
    }

    fn towards(self, other: &Self, share: f64) -> Self {
        Self {
            height_m: self.height_m + share * (other.height_m - self.height_m),
            slope: self.slope + share * (other.slope - self.slope),
        }
    }
}

impl Body {
    /// The pitch that follows the terrain: nose up where it rises.
    pub(crate) fn wanted_pitch_rad(&self, parameters: &Parameters) -> f64 {
        let Lack { fore_m, hind_m, length_m } = self.lack;
        let lifted = parameters.belly_pitch * (fore_m - hind_m) / length_m.max(0.1);
        -parameters.pitch_follow * libm::atan(self.line.slope)
            - lifted.clamp(-LARGEST_LIFT_RAD, LARGEST_LIFT_RAD)
    }

    /// How much higher the base should be above the terrain.
    pub(crate) fn height_error_m(&self, parameters: &Parameters) -> f64 {
        let above_line = parameters.base_height_m + self.line.height_m;
        let lack = 0.5 * (self.lack.fore_m + self.lack.hind_m);
        let error = if lack > 0.0 { above_line.max(lack) } else { above_line };
        error.clamp(-LARGEST_HEIGHT_ERROR_M, LARGEST_HEIGHT_ERROR_M)
    }
}

/// How near the base is to the ground below it and before it.
fn lack(ground: &Ground<'_>, pitch: f64, hip_x_m: f64, parameters: &Parameters) -> Lack {
    let p = parameters;
    let slope = libm::tan(pitch.clamp(-1.0, 1.0));
    let mut found = Lack { length_m: hip_x_m, ..Lack::default() };
    let ahead_m = hip_x_m + p.belly_ahead_m;
    let probes = ((hip_x_m + ahead_m) / BELLY_PROBE_M).ceil() as i32;
    for probe in 0..=probes {
        let x = f64::from(probe) * BELLY_PROBE_M - hip_x_m;
        for y in [-BELLY_HALF_WIDTH_M, 0.0, BELLY_HALF_WIDTH_M] {
            let lack_m = ground.height_m(x, y) + p.belly_m + slope * x;
            let half = if x > 0.0 { &mut found.fore_m } else { &mut found.hind_m };
            *half = half.max(lack_m);
        }
    }
    found
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
