//! Terrain heights as a policy sees them.

use serde::{Deserialize, Serialize};

use crate::TerrainPatch;
use crate::contract::{ContractError, inside};

/// A grid of points around the base, yaw-aligned, and how it is flattened.
///
/// ```text
/// value = −offset − h,   h = z_terrain − z_base
/// ```
///
/// With an offset of 0.5 m, clip 1 and scale 5 this is `legged_gym`'s
/// `clip(z_base − 0.5 − h, ±1)·5`. An
/// unknown height takes the last known one behind it in its column (same y), as the predictors' field
/// does; before the first known one, that one; a column without any has the value 0, ground at
/// `offset_m` below the base.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeightPatch {
    /// Distance behind the base, m, at most 1.
    pub back_m: f64,
    /// Distance ahead of the base, m, at most 2.
    pub front_m: f64,
    /// Distance to the left and to the right, m, at most 0.5.
    pub half_width_m: f64,
    /// Spacing of the points in both directions, m.
    pub resolution_m: f64,
    /// How far below the base origin the ground's value is 0, m.
    pub offset_m: f64,
    /// The order of the points.
    #[serde(default)]
    pub order: HeightOrder,
}

/// The order in which a grid of heights is flattened. x forward, y left.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeightOrder {
    /// x slow, from the back; y fast, from the right: `legged_gym`.
    #[default]
    RowsFromRight,
    /// x slow, from the back; y fast, from the left: this project's patches.
    RowsFromLeft,
    /// y slow, from the right; x fast, from the back: Isaac Lab's grid pattern, ordering "xy".
    ColumnsFromRight,
}

impl HeightPatch {
    /// The patch that the host is asked for.
    pub fn terrain(&self) -> TerrainPatch {
        TerrainPatch {
            back_m: self.back_m,
            front_m: self.front_m,
            half_width_m: self.half_width_m,
            resolution_m: self.resolution_m,
        }
    }

    pub(crate) fn check(&self, field: &str) -> Result<(), ContractError> {
        // What every source of elevation covers: beyond it nothing would be known, ever.
        for (part, length_m, most_m) in [
            ("back_m", self.back_m, 1.0),
            ("front_m", self.front_m, 2.0),
            ("half_width_m", self.half_width_m, 0.5),
        ] {
            inside(format!("{field}.{part}"), length_m, 0.0..=most_m)?;
        }
        inside(format!("{field}.resolution_m"), self.resolution_m, 0.01..=0.2)?;
        inside(format!("{field}.offset_m"), self.offset_m, -5.0..=5.0)?;
        for (part, extent_m) in
            [("front_m", self.back_m + self.front_m), ("half_width_m", 2.0 * self.half_width_m)]
        {
            let points = extent_m / self.resolution_m;
            if (points - points.round()).abs() > 1e-6 {
                let wanted = format!("an extent of whole steps of {} m", self.resolution_m);
                return Err(ContractError::new(format!("{field}.{part}"), extent_m, wanted));
            }
        }
        Ok(())
    }

    /// Values of the points into `out`, in the patch's order, neither clipped nor scaled.
    ///
    /// | argument | meaning | unit | shape |
    /// |---|---|---|---|
    /// | `terrain_m` | heights relative to the base origin, NaN unknown | m | `[row][column]`, back to front, left to right |
    /// | `out` | −offset − h | m | one for each point |
    pub(crate) fn write(&self, terrain_m: &[f32], out: &mut [f32]) {
        let patch = self.terrain();
        let (rows, columns) = (patch.rows(), patch.columns());
        let offset_m = self.offset_m as f32;
        for column in 0..columns {
            let height = |row: usize| terrain_m[row * columns + column];
            let first = (0..rows).map(height).find(|height| height.is_finite());
            let mut known = first.unwrap_or(-offset_m);
            for row in 0..rows {
                let found = height(row);
                if found.is_finite() {
                    known = found;
                }
                let from_right = columns - 1 - column;
                let index = match self.order {
                    HeightOrder::RowsFromRight => row * columns + from_right,
                    HeightOrder::RowsFromLeft => row * columns + column,
                    HeightOrder::ColumnsFromRight => from_right * rows + row,
                };
                out[index] = -offset_m - known;
            }
        }
    }
}
