//! The way of a swinging foot: up, over, down.

use nalgebra::Vector3;

use crate::{ground::Ground, parameters::Parameters};

/// Spacing of the points at which the ground on the way is looked at.
const PROBE_M: f64 = 0.02;
/// Steps lower than this are no obstacle on the way: above what ± 2 cm of sensor noise makes of flat ground.
const OBSTACLE_M: f64 = 0.06;
/// A way longer than a leg can go is looked at no further.
const MOST_PROBES: i32 = 64;

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
    /// `target` held back by the ground that the foot has yet to clear.
    ///
    /// A leg lags behind what it is asked: a foot that is still below the edge of a step would be
    /// driven into its riser, and one still above the step it leaves onto its edge. So the target
    /// travels no further than where the ground rises above the foot as it is at `place`, less
    /// `gate_m`, and does not sink below ground that is still between the foot and its foothold.
    pub(crate) fn gated(
        &self,
        target: &Vector3<f64>,
        place: &Vector3<f64>,
        radius_m: f64,
        ground: &Ground<'_>,
        parameters: &Parameters,
    ) -> Vector3<f64> {
        let (way, length) = {
            let way = (target - self.from).xy();
            (way, way.norm())
        };
        let mut gated = *target;
        let reach_m = place.z - radius_m - parameters.gate_m;
        let start_m = ground.height_m(self.from.x, self.from.y) + OBSTACLE_M;
        if length > PROBE_M {
            let ahead = way / length;
            let probes = ((length + radius_m) / PROBE_M).ceil() as i32;
            for probe in 1..=probes.min(MOST_PROBES) {
                let distance = f64::from(probe) * PROBE_M;
                let point = self.from.xy() + ahead * distance;
                let height = ground.height_m(point.x, point.y);
                if height > start_m && height > reach_m {
                    let held = (distance - PROBE_M - radius_m).clamp(0.0, length);
                    let at = self.from.xy() + ahead * held;
                    gated.x = at.x;
                    gated.y = at.y;
                    break;
                }
            }
        }
        let between_m = ground.highest_between([place.x, place.y], [self.to.x, self.to.y]);
        if between_m + radius_m > self.to.z + OBSTACLE_M {
            gated.z = gated.z.max(between_m + radius_m + parameters.gate_m.max(0.0));
        }
        gated
    }

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
    use crate::ground::PATCH;

    fn riser_at_0_4(height_m: f32) -> Vec<f32> {
        (0..PATCH.rows() * PATCH.columns())
            .map(|index| {
                let x = -PATCH.back_m + (index / PATCH.columns()) as f64 * PATCH.resolution_m;
                if x > 0.4 { height_m } else { -0.5 }
            })
            .collect()
    }

    #[test]
    fn a_foot_below_an_edge_waits_before_it_and_one_above_it_travels_on() {
        let parameters = Parameters::default();
        let heights = riser_at_0_4(-0.3);
        let ground = Ground::new(&heights, -0.5).unwrap();
        let swing = Swing {
            from: Vector3::new(0.2, 0.3, -0.47),
            to: Vector3::new(0.5, 0.3, -0.27),
            highest_m: -0.27,
        };
        let target = Vector3::new(0.48, 0.3, -0.2);
        let low = swing.gated(&target, &Vector3::new(0.25, 0.3, -0.4), 0.03, &ground, &parameters);
        assert!(low.x < 0.39 && low.z == target.z, "{low}");
        let high = swing.gated(&target, &Vector3::new(0.3, 0.3, -0.2), 0.03, &ground, &parameters);
        assert_eq!(high, target);
    }

    #[test]
    fn a_foot_over_the_step_it_leaves_does_not_sink_onto_its_edge() {
        let parameters = Parameters::default();
        let heights = riser_at_0_4(-0.7);
        let ground = Ground::new(&heights, -0.5).unwrap();
        let swing = Swing {
            from: Vector3::new(0.3, 0.3, -0.47),
            to: Vector3::new(0.6, 0.3, -0.67),
            highest_m: -0.47,
        };
        let target = Vector3::new(0.6, 0.3, -0.6);
        let over = swing.gated(&target, &Vector3::new(0.36, 0.3, -0.4), 0.03, &ground, &parameters);
        assert!(over.z >= -0.47 && over.x == target.x, "{over}");
        let past = swing.gated(&target, &Vector3::new(0.5, 0.3, -0.4), 0.03, &ground, &parameters);
        assert_eq!(past, target);
    }

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
