//! Heightfields and elevation patches, sampled from the true geometry.

use super::Terrain;
use vocaloco_core::{
    elevation::Elevation,
    heightfield::{Heightfield, ROWS},
};
use vocaloco_plugin_api::TerrainPatch;

/// Where heights are taken from: a point and a direction, yaw-aligned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vantage {
    /// Base origin in the world; heights are relative to its z.
    pub position_m: [f32; 3],
    /// Yaw of the base.
    pub yaw_rad: f32,
}

impl Vantage {
    /// Height of the ground `x_m` ahead and `y_m` to the left, relative to the base origin.
    fn height_m(&self, terrain: &Terrain, [cos, sin]: [f32; 2], x_m: f32, y_m: f32) -> f32 {
        let [base_x, base_y, base_z] = self.position_m;
        let x_in_world = base_x + cos * x_m - sin * y_m;
        let y_in_world = base_y + sin * x_m + cos * y_m;
        terrain.height_m(x_in_world, y_in_world) - base_z
    }

    fn cos_sin(&self) -> [f32; 2] {
        [libm::cosf(self.yaw_rad), libm::sinf(self.yaw_rad)]
    }
}

impl Terrain {
    /// The field of the predictors as seen from a base: true heights relative to the base origin,
    /// NaN outside the map.
    pub fn heightfield(&self, from: &Vantage) -> Heightfield {
        let mut field = Heightfield::unknown();
        let turn = from.cos_sin();
        for row in 0..ROWS {
            for (column, cell) in field.cells_m[row].iter_mut().enumerate() {
                let [x_m, y_m] = Heightfield::point(row, column);
                *cell = from.height_m(self, turn, x_m, y_m);
            }
        }
        field
    }

    /// The heights that a plugin asks for, row-major, rows back to front, columns left to right:
    /// true heights relative to the base origin, NaN outside the map. Fills as much of `out` as the
    /// patch has points.
    pub fn patch(&self, from: &Vantage, patch: &TerrainPatch, out: &mut [f32]) {
        let turn = from.cos_sin();
        for (row, heights) in out.chunks_mut(patch.columns()).take(patch.rows()).enumerate() {
            let x_m = row as f64 * patch.resolution_m - patch.back_m;
            for (column, height) in heights.iter_mut().enumerate() {
                let y_m = patch.half_width_m - column as f64 * patch.resolution_m;
                *height = from.height_m(self, turn, x_m as f32, y_m as f32);
            }
        }
    }

    /// An elevation map of the given extents, as a robot's own perception would hand it over.
    pub fn elevation(&self, from: &Vantage, extents: &TerrainPatch, t_s: f64) -> Elevation {
        let mut height_m = vec![f32::NAN; extents.rows() * extents.columns()];
        self.patch(from, extents, &mut height_m);
        Elevation {
            t_s,
            resolution_m: extents.resolution_m,
            back_m: extents.back_m,
            front_m: extents.front_m,
            half_width_m: extents.half_width_m,
            height_m,
        }
    }
}
