//! Angles on the circle.

use std::f32::consts::{PI, TAU};

/// The same direction, from −π to π.
pub(crate) fn wrapped_rad(angle_rad: f32) -> f32 {
    angle_rad - TAU * ((angle_rad + PI) / TAU).floor()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_short_way_round_is_taken() {
        for (angle_rad, wanted_rad) in [(0.1, 0.1), (3.5, 3.5 - TAU), (-3.5, TAU - 3.5), (7.0, 7.0 - TAU)] {
            assert!((wrapped_rad(angle_rad) - wanted_rad).abs() < 1e-5, "{angle_rad}");
        }
    }
}
