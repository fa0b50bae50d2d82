//! The elevation patch around the robot as a source hands it over, and what is sampled from it:
//! the predictors' [`Heightfield`] and the terrain patch that a plugin declares.
//!
//! Sampling takes the nearest point: interpolation would put half steps into stairs and spread an
//! unknown cell over its neighbours.

use thiserror::Error;
use vocaloco_plugin_api::TerrainPatch;

use crate::heightfield::{COLUMNS, Heightfield};

/// Terrain heights around the base, yaw-aligned with it.
///
/// Row i lies at x = −`back_m` + i·`resolution_m`, column j at y = `half_width_m` −
/// j·`resolution_m`, yaw-aligned base frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Elevation {
    /// When it was measured, s, on the clock of the observations.
    pub t_s: f64,
    /// Spacing of the points in both directions, m: 0.02 to 0.1.
    pub resolution_m: f64,
    /// Extent behind the base, m.
    pub back_m: f64,
    /// Extent ahead of the base, m.
    pub front_m: f64,
    /// Extent to the left and to the right, m.
    pub half_width_m: f64,
    /// Heights relative to the base origin, m; row-major, rows back to front, columns left to
    /// right; NaN is unknown.
    pub height_m: Vec<f32>,
}

/// A patch that breaks its own description, or is smaller than the predictors' field.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("elevation: {field} is {found}, {wanted} wanted")]
pub struct ElevationError {
    /// The field at fault.
    pub field: &'static str,
    /// What it holds.
    pub found: String,
    /// What it should hold.
    pub wanted: String,
}

/// Slack when extents are compared and points are counted, m.
const SLACK_M: f64 = 1e-6;
/// Largest extent taken in any direction, m: keeps a hostile patch from asking for the memory of
/// a continent.
const MAX_EXTENT_M: f64 = 20.0;

impl Elevation {
    /// Number of rows that the extents ask for.
    pub fn rows(&self) -> usize {
        points(self.back_m + self.front_m, self.resolution_m)
    }

    /// Number of columns that the extents ask for.
    pub fn columns(&self) -> usize {
        points(2.0 * self.half_width_m, self.resolution_m)
    }

    /// Checks resolution, extents, number of heights and time.
    ///
    /// # Errors
    /// The first field that is wrong.
    pub fn check(&self) -> Result<(), ElevationError> {
        let inside = |field, found: f64, low: f64, high: f64| {
            if found >= low - SLACK_M && found <= high + SLACK_M {
                return Ok(());
            }
            Err(ElevationError { field, found: found.to_string(), wanted: format!("{low} to {high} m") })
        };
        inside("resolution_m", self.resolution_m, 0.02, 0.1)?;
        inside("back_m", self.back_m, 1.0, MAX_EXTENT_M)?;
        inside("front_m", self.front_m, 2.0, MAX_EXTENT_M)?;
        inside("half_width_m", self.half_width_m, 0.5, MAX_EXTENT_M)?;
        if !self.t_s.is_finite() {
            return Err(ElevationError {
                field: "t_s",
                found: self.t_s.to_string(),
                wanted: "a finite number of seconds".into(),
            });
        }
        let (rows, columns) = (self.rows(), self.columns());
        if self.height_m.len() != rows * columns {
            return Err(ElevationError {
                field: "height_m",
                found: match self.height_m.len() {
                    // Heights in rows of another length are another map, and none of this one.
                    0 => format!("0 heights in rows of {columns}"),
                    heights => format!("{heights} heights"),
                },
                wanted: format!("{rows} rows of {columns}"),
            });
        }
        Ok(())
    }

    /// The predictors' field, sampled at its 31 × 11 points.
    ///
    /// # Errors
    /// When [`check`](Self::check) fails.
    pub fn heightfield(&self) -> Result<Heightfield, ElevationError> {
        self.check()?;
        let mut field = Heightfield::unknown();
        let width = self.columns();
        let columns: [Option<usize>; COLUMNS] =
            std::array::from_fn(|j| self.column_at((5.0 - j as f64) * 0.1));
        for (i, cells) in field.cells_m.iter_mut().enumerate() {
            let row = self.row_at((i as f64 - 10.0) * 0.1);
            for (cell, column) in cells.iter_mut().zip(&columns) {
                *cell = self.cell_m(row, *column, width);
            }
        }
        Ok(field)
    }

    /// Fills `out` with the heights that a plugin's `patch` asks for, row-major, rows back to
    /// front, columns left to right; NaN where the elevation does not reach or does not know.
    /// Values beyond the shorter of `out` and the patch are left alone.
    pub fn patch(&self, patch: &TerrainPatch, out: &mut [f32]) {
        let (width, columns) = (self.columns(), patch.columns().max(1));
        for (i, heights) in out.chunks_mut(columns).take(patch.rows()).enumerate() {
            let row = self.row_at(i as f64 * patch.resolution_m - patch.back_m);
            for (j, height) in heights.iter_mut().enumerate() {
                let column = self.column_at(patch.half_width_m - j as f64 * patch.resolution_m);
                *height = self.cell_m(row, column, width);
            }
        }
    }

    /// Height at the known point nearest to (x, y), m, yaw-aligned base frame; NaN when the point
    /// lies more than half a cell outside or the height is unknown or not finite.
    pub fn height_m(&self, x_m: f64, y_m: f64) -> f32 {
        self.cell_m(self.row_at(x_m), self.column_at(y_m), self.columns())
    }

    fn cell_m(&self, row: Option<usize>, column: Option<usize>, width: usize) -> f32 {
        let cell = row.zip(column).and_then(|(row, column)| self.height_m.get(row * width + column));
        cell.copied().filter(|height| height.is_finite()).unwrap_or(f32::NAN)
    }

    fn row_at(&self, x_m: f64) -> Option<usize> {
        nearest((x_m + self.back_m) / self.resolution_m, self.rows())
    }

    fn column_at(&self, y_m: f64) -> Option<usize> {
        nearest((self.half_width_m - y_m) / self.resolution_m, self.columns())
    }
}

/// The one of `count` points that is nearest to `place`, in points from the first; none outside them.
fn nearest(place: f64, count: usize) -> Option<usize> {
    // The nudge makes a place half-way between two points fall on the same one whatever the rounding
    // of the extents.
    let nearest = (place + 1e-6).round();
    // Phrased as "is inside", so NaN is outside.
    (nearest >= 0.0 && nearest < count as f64).then_some(nearest as usize)
}

fn points(extent_m: f64, resolution_m: f64) -> usize {
    ((extent_m / resolution_m).clamp(0.0, 1e5) + 1e-6).round() as usize + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Higher to the front and, less so, to the left.
    fn tilted(resolution_m: f64, back_m: f64, front_m: f64, half_width_m: f64) -> Elevation {
        let mut elevation =
            Elevation { t_s: 0.0, resolution_m, back_m, front_m, half_width_m, height_m: Vec::new() };
        for i in 0..elevation.rows() {
            for j in 0..elevation.columns() {
                let x = i as f64 * resolution_m - back_m;
                let y = half_width_m - j as f64 * resolution_m;
                elevation.height_m.push((0.3 * x + 0.1 * y - 0.55) as f32);
            }
        }
        elevation
    }

    #[test]
    fn the_field_is_sampled_with_x_forward_and_y_left() {
        // At 3 cm the nearest point is up to 1.5 cm off in each direction.
        for (resolution_m, half_width_m, off_m) in
            [(0.1, 0.7, 1e-6), (0.05, 0.7, 1e-6), (0.02, 0.7, 1e-6), (0.03, 0.72, 0.0061)]
        {
            let field = tilted(resolution_m, 1.2, 2.4, half_width_m).heightfield().unwrap();
            for (i, row) in field.cells_m.iter().enumerate() {
                for (j, height) in row.iter().enumerate() {
                    let [x, y] = Heightfield::point(i, j);
                    let wanted = 0.3 * x + 0.1 * y - 0.55;
                    assert!((height - wanted).abs() < off_m, "{resolution_m} m, cell {i},{j}: {height}");
                }
            }
        }
    }

    #[test]
    fn a_plugins_patch_is_sampled_with_x_forward_and_y_left() {
        let patch = TerrainPatch { back_m: 0.3, front_m: 0.5, half_width_m: 0.2, resolution_m: 0.1 };
        let mut out = vec![0.0; patch.rows() * patch.columns()];
        tilted(0.05, 1.2, 2.2, 0.7).patch(&patch, &mut out);
        assert_eq!((patch.rows(), patch.columns()), (9, 5));
        assert!((out[0] - (-0.09 + 0.02 - 0.55)).abs() < 1e-6, "behind, left");
        assert!((out[4] - (-0.09 - 0.02 - 0.55)).abs() < 1e-6, "behind, right");
        assert!((out[8 * 5] - (0.15 + 0.02 - 0.55)).abs() < 1e-6, "ahead, left");
    }

    #[test]
    fn beyond_the_patch_is_unknown() {
        let elevation = tilted(0.05, 1.2, 2.2, 0.7);
        assert!(elevation.height_m(2.2, 0.7).is_finite());
        for (x, y) in [(2.3, 0.0), (-1.3, 0.0), (0.0, 0.8), (0.0, -0.8), (f64::NAN, 0.0)] {
            assert!(elevation.height_m(x, y).is_nan(), "{x} {y}");
        }
    }

    #[test]
    fn an_infinite_height_is_read_as_unknown() {
        let mut elevation = tilted(0.1, 1.0, 2.0, 0.5);
        elevation.height_m[10 * 11 + 5] = f32::INFINITY;
        assert!(elevation.heightfield().unwrap().cells_m[10][5].is_nan());
    }

    #[test]
    fn a_patch_smaller_than_the_field_is_refused_by_name() {
        let refused = |elevation: Elevation| elevation.heightfield().unwrap_err().field;
        assert_eq!(refused(tilted(0.1, 0.9, 2.0, 0.5)), "back_m");
        assert_eq!(refused(tilted(0.1, 1.0, 1.9, 0.5)), "front_m");
        assert_eq!(refused(tilted(0.1, 1.0, 2.0, 0.4)), "half_width_m");
        assert_eq!(refused(tilted(0.2, 1.0, 2.0, 0.6)), "resolution_m");
        assert_eq!(refused(Elevation { front_m: f64::NAN, ..tilted(0.1, 1.0, 2.0, 0.5) }), "front_m");
        assert_eq!(refused(Elevation { t_s: f64::NAN, ..tilted(0.1, 1.0, 2.0, 0.5) }), "t_s");
    }

    #[test]
    fn a_patch_of_the_wrong_size_is_refused() {
        let mut elevation = tilted(0.1, 1.0, 2.0, 0.5);
        assert!(elevation.check().is_ok());
        elevation.height_m.pop();
        assert_eq!(elevation.check().unwrap_err().field, "height_m");
        elevation.height_m.clear();
        assert_eq!(elevation.heightfield().unwrap_err().field, "height_m");
    }
}
