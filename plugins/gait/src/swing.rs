//! The way of a swinging foot: up, over, down.

use nalgebra::Vector3;

use crate::parameters::Parameters;

/// One swing, in the yaw-aligned frame, metres, of the foot's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Swing {
    /// Where the foot left the ground.
    pub(crate) from: Vector3<f64>,
    /// Where it should stand.
    pub(crate) to: Vector3<f64>,
    /// Highest centre of a foot standing anywhere on the way.
    pub(crate) highest_m: f64,
}

impl Swing {
    /// Position at `share` 0 to 1 of the swing. Past 1 it stays at the end, `press_m` below `to`.
    pub(crate) fn at(&self, share: f64, parameters: &Parameters) -> Vector3<f64> {
        let apex = self.highest_m.max(self.from.z).max(self.to.z) + parameters.clearance_m;
        let travelled =
            smooth((share - parameters.travel_start) / (parameters.travel_end - parameters.travel_start));
        let lowering = 1.0 - parameters.lower_share;
        let z = if share < lowering {
            self.from.z + (apex - self.from.z) * smooth(share / parameters.lift_share)
        } else {
            let end = self.to.z - parameters.press_m;
            apex + (end - apex) * smooth((share - lowering) / parameters.lower_share)
        };
        Vector3::new(
            self.from.x + travelled * (self.to.x - self.from.x),
            self.from.y + travelled * (self.to.y - self.from.y),
            z,
        )
    }
}

/// 0 to 1 with no velocity at either end.
fn smooth(share: f64) -> f64 {
    let share = share.clamp(0.0, 1.0);
    share * share * (3.0 - 2.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_swing_starts_and_ends_where_it_should_and_clears_what_is_between() {
        let parameters = Parameters::default();
        let swing =
            Swing { from: Vector3::new(0.2, 0.3, -0.5), to: Vector3::new(0.6, 0.25, -0.3), highest_m: -0.25 };
        assert!((swing.at(0.0, &parameters) - swing.from).norm() < 1e-9);
        let end = swing.at(1.0, &parameters);
        assert!((end.xy() - swing.to.xy()).norm() < 1e-9);
        assert!((end.z - (swing.to.z - parameters.press_m)).abs() < 1e-9);
        assert!(swing.at(0.5, &parameters).z > swing.highest_m + 0.9 * parameters.clearance_m);
    }
}
