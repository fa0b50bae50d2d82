//! Where a swinging foot should land: near its nominal place, away from edges.

use nalgebra::Vector3;

use crate::{ground::Ground, parameters::Parameters};

/// Height difference between neighbouring points that counts as an edge. Above what ±2 cm of sensor
/// noise makes of flat ground.
const EDGE_M: f64 = 0.05;
const STEP_M: f64 = 0.02;
const PROBE_M: f64 = 0.02;
/// Distances in the cost are counted in this length.
const UNIT_M: f64 = 0.1;

/// How far a leg gets when its foot comes down.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    /// What the leg hangs from, by then, in the yaw-aligned frame, m.
    pub(crate) hip: Vector3<f64>,
    /// From there to the centre of the foot, m.
    pub(crate) longest_m: f64,
    pub(crate) foot_radius_m: f64,
}

impl Reach {
    /// How far a foot on the ground at a point would be out of reach, m.
    fn missing_m(&self, ground: &Ground<'_>, [x, y]: [f64; 2]) -> f64 {
        let foot = Vector3::new(x, y, ground.height_m(x, y) + self.foot_radius_m);
        ((foot - self.hip).norm() - self.longest_m).max(0.0)
    }
}

/// The foothold with the lowest cost around `nominal`:
///
/// ```text
/// cost = |p − nominal|²/u² + keep_weight·|p − previous|²/u² + reach_weight·missing²/u²
///      + edge_weight·Σ max(0, 1 − distance/margin)
/// ```
///
/// over edges that drop (ahead, behind, beside) and risers (ahead, behind); u = 0.1 m. All points in
/// the yaw-aligned frame, metres.
pub(crate) fn choose(
    ground: &Ground<'_>,
    parameters: &Parameters,
    fore: bool,
    nominal: [f64; 2],
    reach: &Reach,
    previous: Option<[f64; 2]>,
) -> [f64; 2] {
    let steps = (parameters.search_m / STEP_M).floor() as i32;
    let mut best = nominal;
    let mut lowest = f64::INFINITY;
    for along in -steps..=steps {
        for across in [0, -2, 2] {
            let point = [nominal[0] + f64::from(along) * STEP_M, nominal[1] + f64::from(across) * STEP_M];
            let mut cost = squared(point, nominal);
            if let Some(previous) = previous {
                cost += parameters.keep_weight * squared(point, previous);
            }
            if cost < lowest && parameters.reach_weight > 0.0 {
                let missing = reach.missing_m(ground, point) / UNIT_M;
                cost += parameters.reach_weight * missing * missing;
            }
            if cost < lowest {
                cost += parameters.edge_weight * edges(ground, parameters, fore, point);
            }
            if cost < lowest {
                lowest = cost;
                best = point;
            }
        }
    }
    best
}

fn squared(a: [f64; 2], b: [f64; 2]) -> f64 {
    ((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])) / (UNIT_M * UNIT_M)
}

fn edges(ground: &Ground<'_>, parameters: &Parameters, fore: bool, [x, y]: [f64; 2]) -> f64 {
    let p = parameters;
    let (riser_margin_m, heel_margin_m) = if fore {
        (p.riser_margin_m, p.heel_margin_m)
    } else {
        (p.hind_riser_margin_m, p.hind_heel_margin_m)
    };
    let height = ground.height_m(x, y);
    let drop = |dx: f64, dy: f64| {
        nearest(p.drop_margin_m, |d| ground.height_m(x + dx * d, y + dy * d) < height - EDGE_M)
    };
    let riser = |dx: f64, margin: f64| nearest(margin, |d| ground.height_m(x + dx * d, y) > height + EDGE_M);
    drop(1.0, 0.0)
        + drop(-1.0, 0.0)
        + drop(0.0, 1.0)
        + drop(0.0, -1.0)
        + riser(1.0, riser_margin_m)
        + riser(-1.0, heel_margin_m)
}

/// 1 for an edge at the point itself, falling to 0 at `margin`.
fn nearest(margin: f64, is_edge: impl Fn(f64) -> bool) -> f64 {
    let probes = (margin / PROBE_M).ceil() as i32;
    for probe in 1..=probes {
        let distance = (f64::from(probe) * PROBE_M).min(margin);
        if is_edge(distance) {
            return (1.0 - (distance - PROBE_M) / margin.max(PROBE_M)).max(0.0);
        }
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::PATCH;

    const ANYWHERE: Reach = Reach { hip: Vector3::new(0.3, 0.2, 0.5), longest_m: 9.0, foot_radius_m: 0.03 };

    fn stairs(riser_at: f64, step: f64) -> Vec<f32> {
        (0..PATCH.rows() * PATCH.columns())
            .map(|index| {
                let x = -PATCH.back_m + (index / PATCH.columns()) as f64 * PATCH.resolution_m;
                if x > riser_at { step as f32 } else { 0.0 }
            })
            .collect()
    }

    #[test]
    fn flat_ground_keeps_the_nominal_foothold() {
        let heights = stairs(9.0, 0.0);
        let ground = Ground::new(&heights, 0.0).unwrap();
        let [x, y] = choose(&ground, &Parameters::default(), true, [0.4, 0.2], &ANYWHERE, None);
        assert!((x - 0.4).abs() < 1e-9 && (y - 0.2).abs() < 1e-9, "{x} {y}");
    }

    #[test]
    fn a_foothold_moves_away_from_a_riser_and_from_a_drop() {
        let heights = stairs(0.45, 0.2);
        let ground = Ground::new(&heights, 0.0).unwrap();
        let before = choose(&ground, &Parameters::default(), true, [0.40, 0.2], &ANYWHERE, None);
        assert!(before[0] < 0.39, "{before:?}");
        let after = choose(&ground, &Parameters::default(), true, [0.50, 0.2], &ANYWHERE, None);
        assert!(after[0] > 0.51, "{after:?}");
    }

    /// A foot that was sent two treads down, farther than its leg could get, slipped off the edge between.
    #[test]
    fn a_foothold_that_the_leg_will_not_reach_gives_way_to_a_nearer_one() {
        let heights = stairs(0.35, -0.3);
        let ground = Ground::new(&heights, 0.0).unwrap();
        let reach = Reach { longest_m: 0.6, ..ANYWHERE };
        let chosen = |reach_weight| {
            let parameters = Parameters { reach_weight, ..Parameters::default() };
            choose(&ground, &parameters, true, [0.42, 0.2], &reach, None)
        };
        assert!(chosen(0.0)[0] > 0.35, "{:?}", chosen(0.0));
        assert!(chosen(10.0)[0] < 0.35, "{:?}", chosen(10.0));
    }
}
