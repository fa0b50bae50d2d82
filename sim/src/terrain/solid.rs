//! The fixed bodies of a terrain, and the collision shapes made of them.

use rapier3d::{
    math::{Pose, Rotation, Vector},
    parry::utils::Array2,
    prelude::SharedShape,
};

/// A fixed body.
#[derive(Clone, Debug, PartialEq)]
pub enum Solid {
    /// A box along the world's axes.
    Box {
        /// Its centre.
        centre_m: [f32; 3],
        /// Half its extent in x, y, z.
        half_extents_m: [f32; 3],
    },
    /// Heights on a regular grid with two triangles a cell, split from (row + 1, column) to
    /// (row, column + 1).
    Grid {
        /// x, y of the first point.
        origin_m: [f32; 2],
        /// Distance of neighbouring points.
        spacing_m: f32,
        /// Number of points along x.
        rows: usize,
        /// Number of points along y.
        columns: usize,
        /// Heights, `[row][column]`, row-major.
        heights_m: Vec<f32>,
    },
}

impl Solid {
    /// A box from its corners.
    pub(super) fn between(min_m: [f32; 3], max_m: [f32; 3]) -> Self {
        let half = |i: usize| 0.5 * (max_m[i] - min_m[i]);
        let centre = |i: usize| 0.5 * (max_m[i] + min_m[i]);
        Self::Box { centre_m: [centre(0), centre(1), centre(2)], half_extents_m: [half(0), half(1), half(2)] }
    }

    /// The collision shape and its pose in the world.
    ///
    /// parry's heightfields have y up, rows along z and columns along x; the pose turns them so that
    /// rows run along the world's x, columns along y, and z is up.
    pub fn shape(&self) -> (SharedShape, Pose) {
        match self {
            Self::Box { centre_m, half_extents_m: [hx, hy, hz] } => {
                let shape = SharedShape::cuboid(*hx, *hy, *hz);
                (shape, Pose::from_parts(Vector::from_array(*centre_m), Rotation::IDENTITY))
            }
            Self::Grid { origin_m, spacing_m, rows, columns, heights_m } => {
                let column_major =
                    (0..rows * columns).map(|k| heights_m[(k % rows) * columns + k / rows]).collect();
                let extent_m = [(*rows - 1) as f32 * spacing_m, (*columns - 1) as f32 * spacing_m];
                let shape = SharedShape::heightfield(
                    Array2::new(*rows, *columns, column_major),
                    Vector::new(extent_m[1], 1.0, extent_m[0]),
                );
                let centre =
                    Vector::new(origin_m[0] + 0.5 * extent_m[0], origin_m[1] + 0.5 * extent_m[1], 0.0);
                // A third of a turn about (1, 1, 1): x → y → z → x.
                (shape, Pose::from_parts(centre, Rotation::from_xyzw(0.5, 0.5, 0.5, 0.5)))
            }
        }
    }

    /// Height of the top at a point, or −∞ where the solid is not below it.
    pub(super) fn height_m(&self, x_m: f32, y_m: f32) -> f32 {
        match self {
            Self::Box { centre_m, half_extents_m } => {
                let below = (x_m - centre_m[0]).abs() <= half_extents_m[0]
                    && (y_m - centre_m[1]).abs() <= half_extents_m[1];
                if below { centre_m[2] + half_extents_m[2] } else { f32::NEG_INFINITY }
            }
            Self::Grid { origin_m, spacing_m, rows, columns, heights_m } => {
                let u = (x_m - origin_m[0]) / spacing_m;
                let v = (y_m - origin_m[1]) / spacing_m;
                let last = [(*rows - 1) as f32, (*columns - 1) as f32];
                if !(u >= 0.0 && u <= last[0] && v >= 0.0 && v <= last[1]) {
                    return f32::NEG_INFINITY;
                }
                let row = (u as usize).min(rows - 2);
                let column = (v as usize).min(columns - 2);
                let at = |i: usize, j: usize| heights_m[(row + i) * columns + column + j];
                let (u, v) = (u - row as f32, v - column as f32);
                if u + v <= 1.0 {
                    at(0, 0) + u * (at(1, 0) - at(0, 0)) + v * (at(0, 1) - at(0, 0))
                } else {
                    at(1, 1) + (1.0 - u) * (at(0, 1) - at(1, 1)) + (1.0 - v) * (at(1, 0) - at(1, 1))
                }
            }
        }
    }

    /// Height of the highest point, m.
    pub(super) fn top_m(&self) -> f32 {
        match self {
            Self::Box { centre_m, half_extents_m } => centre_m[2] + half_extents_m[2],
            Self::Grid { heights_m, .. } => heights_m.iter().copied().fold(f32::NEG_INFINITY, f32::max),
        }
    }

    /// Smallest and largest x and y, m.
    pub(super) fn extent_m(&self) -> [[f32; 2]; 2] {
        match self {
            Self::Box { centre_m, half_extents_m } => [
                [centre_m[0] - half_extents_m[0], centre_m[1] - half_extents_m[1]],
                [centre_m[0] + half_extents_m[0], centre_m[1] + half_extents_m[1]],
            ],
            Self::Grid { origin_m, spacing_m, rows, columns, .. } => [
                *origin_m,
                [
                    origin_m[0] + (*rows - 1) as f32 * spacing_m,
                    origin_m[1] + (*columns - 1) as f32 * spacing_m,
                ],
            ],
        }
    }
}
