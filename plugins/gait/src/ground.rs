//! The terrain patch as the gait reads it: heights in the yaw-aligned frame, relative to the base origin.

use vocaloco_plugin_api::TerrainPatch;

/// The patch that the gait asks for: what its legs can reach, and a stride ahead.
pub(crate) const PATCH: TerrainPatch =
    TerrainPatch { back_m: 0.84, front_m: 1.04, half_width_m: 0.48, resolution_m: 0.04 };

/// Half a cell at a time across the whole patch and back.
const MOST_STEPS: f64 = 256.0;

/// A line through the terrain under the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Line {
    /// Height of the line under the base origin, m, relative to it.
    pub(crate) height_m: f64,
    /// Rise per metre ahead.
    pub(crate) slope: f64,
}

/// A view of one tick's heights.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ground<'a> {
    heights: &'a [f32],
    rows: usize,
    columns: usize,
    /// Height taken where the terrain is unknown.
    fallback_m: f64,
}

impl<'a> Ground<'a> {
    /// A view of `heights` as [`PATCH`] lays them out; `None` when there are too few or many.
    pub(crate) fn new(heights: &'a [f32], fallback_m: f64) -> Option<Self> {
        let (rows, columns) = (PATCH.rows(), PATCH.columns());
        (heights.len() == rows * columns).then_some(Self { heights, rows, columns, fallback_m })
    }

    /// Height of the grid point nearest to (`x`, `y`).
    pub(crate) fn height_m(&self, x: f64, y: f64) -> f64 {
        let row = ((x + PATCH.back_m) / PATCH.resolution_m).round().clamp(0.0, (self.rows - 1) as f64);
        let column =
            ((PATCH.half_width_m - y) / PATCH.resolution_m).round().clamp(0.0, (self.columns - 1) as f64);
        let height = f64::from(self.heights[row as usize * self.columns + column as usize]);
        if height.is_finite() { height } else { self.fallback_m }
    }

    /// Least-squares line along x through the strip under the body.
    pub(crate) fn line(&self, centre_m: f64, half_length_m: f64) -> Line {
        let steps = (half_length_m / PATCH.resolution_m).round().max(1.0) as i32;
        let centre_m = (centre_m / PATCH.resolution_m).round() * PATCH.resolution_m;
        let (mut count, mut sum_x, mut sum_z, mut sum_xx, mut sum_xz) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for step in -steps..=steps {
            let x = centre_m + f64::from(step) * PATCH.resolution_m;
            for y in [-0.2, -0.1, 0.1, 0.2] {
                let z = self.height_m(x, y);
                count += 1.0;
                sum_x += x;
                sum_z += z;
                sum_xx += x * x;
                sum_xz += x * z;
            }
        }
        let slope = (count * sum_xz - sum_x * sum_z) / (count * sum_xx - sum_x * sum_x);
        Line { height_m: (sum_z - slope * sum_x) / count, slope }
    }

    /// Highest ground on the straight way between two points.
    pub(crate) fn highest_between(&self, from: [f64; 2], to: [f64; 2]) -> f64 {
        let length = libm::hypot(to[0] - from[0], to[1] - from[1]);
        // Bounded, so that a foot that is said to be a mile away costs no more than one at the edge.
        let steps = (length / (0.5 * PATCH.resolution_m)).ceil().clamp(1.0, MOST_STEPS);
        let mut highest = f64::NEG_INFINITY;
        for step in 0..=steps as usize {
            let share = step as f64 / steps;
            let x = from[0] + share * (to[0] - from[0]);
            let y = from[1] + share * (to[1] - from[1]);
            highest = highest.max(self.height_m(x, y));
        }
        highest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patch(height: impl Fn(f64, f64) -> f64) -> Vec<f32> {
        let mut heights = Vec::new();
        for row in 0..PATCH.rows() {
            for column in 0..PATCH.columns() {
                let x = -PATCH.back_m + row as f64 * PATCH.resolution_m;
                let y = PATCH.half_width_m - column as f64 * PATCH.resolution_m;
                heights.push(height(x, y) as f32);
            }
        }
        heights
    }

    #[test]
    fn heights_are_read_where_they_were_written() {
        let heights = patch(|x, y| 0.3 * x - 0.2 * y);
        let ground = Ground::new(&heights, 0.0).unwrap();
        assert!((ground.height_m(0.4, 0.2) - 0.08).abs() < 1e-6);
        assert!((ground.height_m(-0.4, -0.2) + 0.08).abs() < 1e-6);
    }

    #[test]
    fn the_line_through_a_slope_is_the_slope() {
        let heights = patch(|x, _| 0.25 * x - 0.5);
        let line = Ground::new(&heights, 0.0).unwrap().line(0.1, 0.36);
        assert!((line.slope - 0.25).abs() < 1e-5 && (line.height_m + 0.5).abs() < 1e-5, "{line:?}");
    }

    #[test]
    fn a_way_of_any_length_is_walked_in_bounded_time() {
        let heights = patch(|_, _| -0.5);
        let ground = Ground::new(&heights, 0.0).unwrap();
        for far in [1e30, f64::INFINITY, f64::NAN] {
            assert!((ground.highest_between([0.0, 0.0], [far, 0.0]) + 0.5).abs() < 1e-6);
        }
    }

    #[test]
    fn unknown_ground_takes_the_fallback() {
        let heights = patch(|x, _| if x > 0.5 { f64::NAN } else { -0.5 });
        let ground = Ground::new(&heights, -0.6).unwrap();
        assert!((ground.height_m(0.8, 0.0) + 0.6).abs() < 1e-9);
    }
}
