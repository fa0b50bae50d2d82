//! What a robot's depth cameras see of a terrain, by ray casting, and what forward filling makes of the
//! rest. The map remembers: a point once seen stays known. Legs hide nothing here.

use serde::{Deserialize, Serialize};
use vocaloco_core::heightfield::{CELLS, Heightfield, HeightfieldError, ROWS};

use crate::{
    plant::BasePose,
    terrain::{Terrain, Vantage},
};

/// What the predictors' field is made from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Occlusion {
    /// True heights everywhere.
    #[default]
    None,
    /// What the cameras have seen; the rest is unknown, and filled from behind as the method does.
    Camera,
    /// The same, but what is unknown is read as level with the ground under the base.
    CameraUnfilled,
}

/// A depth camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// In the base frame, m.
    pub position_in_base_m: [f32; 3],
    /// Where it looks, from ahead to the left, rad.
    pub yaw_rad: f32,
    /// How far it looks down, rad.
    pub down_rad: f32,
}

/// Two cameras along the body and one to each side, as on `ANYmal` D, all 30° down.
///
/// # Source
/// Places and tilt are our own, read off pictures of the robot.
pub const CAMERAS: [Camera; 4] = [
    Camera { position_in_base_m: [0.43, 0.0, 0.03], yaw_rad: 0.0, down_rad: DOWN_RAD },
    Camera { position_in_base_m: [-0.43, 0.0, 0.03], yaw_rad: std::f32::consts::PI, down_rad: DOWN_RAD },
    Camera {
        position_in_base_m: [0.0, 0.14, 0.05],
        yaw_rad: std::f32::consts::FRAC_PI_2,
        down_rad: DOWN_RAD,
    },
    Camera {
        position_in_base_m: [0.0, -0.14, 0.05],
        yaw_rad: -std::f32::consts::FRAC_PI_2,
        down_rad: DOWN_RAD,
    },
];

const DOWN_RAD: f32 = std::f32::consts::FRAC_PI_6;
/// Tangent of half the field of view, across and up: 87° × 58°, an Intel `RealSense` D435's.
const HALF_VIEW: [f32; 2] = [0.949, 0.554];
/// Depths that a camera gives, m.
const RANGE_M: [f32; 2] = [0.28, 4.0];
/// Spacing of the remembered points, m.
const SPACING_M: f32 = 0.05;
/// A ray looks at the terrain this often, m.
const STRIDE_M: f32 = 0.04;
/// The ground this near to where the robot starts is known, m.
const KNOWN_M: f32 = 1.2;
/// A hidden cell this far below what it was filled with is a hidden drop, m.
pub const DROP_M: f32 = 0.1;

/// How much the cameras had not seen, over the ticks of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Unseen {
    /// Ticks.
    pub ticks: u64,
    /// Mean share of the field's cells that no camera had seen.
    pub cell_share: f64,
    /// Ticks in which filling put [`DROP_M`] or more over the true ground in some cell.
    pub drop_ticks: u64,
    /// The deepest drop that filling hid, m.
    pub deepest_m: f32,
}

/// The map that the cameras have made so far.
#[derive(Clone, Debug)]
pub struct SeenMap {
    columns: usize,
    min_m: [f32; 2],
    seen: Vec<bool>,
    unseen: Unseen,
}

impl SeenMap {
    /// A map that knows the ground around a robot's start.
    pub fn new(terrain: &Terrain, start_m: [f32; 2]) -> Self {
        let count =
            |axis: usize| ((terrain.max_m[axis] - terrain.min_m[axis]) / SPACING_M).round() as usize + 1;
        let (rows, columns) = (count(0), count(1));
        let mut map = Self {
            columns,
            min_m: terrain.min_m,
            seen: vec![false; rows * columns],
            unseen: Unseen::default(),
        };
        for index in 0..map.seen.len() {
            let [x_m, y_m] = map.point(index);
            map.seen[index] = (x_m - start_m[0]).hypot(y_m - start_m[1]) <= KNOWN_M;
        }
        map
    }

    /// Looks around from a base pose: every point that a camera sees is known from now on.
    pub fn look(&mut self, terrain: &Terrain, base: &BasePose) {
        for index in 0..self.seen.len() {
            let [x_m, y_m] = self.point(index);
            let away_m = (x_m - base.position_m[0]).hypot(y_m - base.position_m[1]);
            if self.seen[index] || away_m > REACH_M {
                continue;
            }
            let target_m = [x_m, y_m, terrain.height_m(x_m, y_m)];
            self.seen[index] = CAMERAS.iter().any(|camera| camera.sees(terrain, base, target_m));
        }
    }

    /// The predictors' field from here: true heights where the map is known, NaN elsewhere; and counts what
    /// filling it hides.
    pub fn heightfield(&mut self, terrain: &Terrain, from: &Vantage) -> Heightfield {
        let whole = terrain.heightfield(from);
        let (sin, cos) = (libm::sinf(from.yaw_rad), libm::cosf(from.yaw_rad));
        let mut known = whole.clone();
        for row in 0..ROWS {
            for (column, cell) in known.cells_m[row].iter_mut().enumerate() {
                let [x_m, y_m] = Heightfield::point(row, column);
                let x_in_world = from.position_m[0] + cos * x_m - sin * y_m;
                let y_in_world = from.position_m[1] + sin * x_m + cos * y_m;
                if !self.knows(x_in_world, y_in_world) {
                    *cell = f32::NAN;
                }
            }
        }
        self.count(&known, &whole);
        known
    }

    /// What was not seen so far.
    pub fn unseen(&self) -> Unseen {
        let ticks = self.unseen.ticks.max(1) as f64;
        Unseen { cell_share: self.unseen.cell_share / ticks, ..self.unseen }
    }

    fn count(&mut self, known: &Heightfield, whole: &Heightfield) {
        self.unseen.ticks += 1;
        self.unseen.cell_share += known.unknown_cells() as f64 / CELLS as f64;
        let Ok(filled) = known.filled() else { return };
        let deepest_m = hidden_drop_m(&filled, whole);
        self.unseen.drop_ticks += u64::from(deepest_m >= DROP_M);
        self.unseen.deepest_m = self.unseen.deepest_m.max(deepest_m);
    }

    fn point(&self, index: usize) -> [f32; 2] {
        let [x_m, y_m] = self.min_m;
        [x_m + (index / self.columns) as f32 * SPACING_M, y_m + (index % self.columns) as f32 * SPACING_M]
    }

    fn knows(&self, x_m: f32, y_m: f32) -> bool {
        let row = ((x_m - self.min_m[0]) / SPACING_M).round();
        let column = ((y_m - self.min_m[1]) / SPACING_M).round();
        let inside = row >= 0.0 && column >= 0.0 && (column as usize) < self.columns;
        inside && self.seen.get(row as usize * self.columns + column as usize).copied().unwrap_or(false)
    }
}

/// Points further away than this are not looked at: the far corners of the field and a tick's walk, m.
const REACH_M: f32 = 2.3;

/// The deepest true ground below what a field was filled with, m; 0 where nothing is hidden.
fn hidden_drop_m(filled: &Heightfield, whole: &Heightfield) -> f32 {
    let cells = filled.cells_m.iter().flatten().zip(whole.cells_m.iter().flatten());
    cells.map(|(filled, whole)| filled - whole).filter(|drop| drop.is_finite()).fold(0.0, f32::max)
}

/// A field with the unknown cells level with the ground under the base.
///
/// # Errors
/// When that ground, or more than the method allows, is unknown.
pub fn levelled(field: &Heightfield) -> Result<Heightfield, HeightfieldError> {
    let filled = field.filled()?;
    let under_m = filled.cells_m[10][5];
    let mut levelled = field.clone();
    for cell in levelled.cells_m.iter_mut().flatten().filter(|cell| !cell.is_finite()) {
        *cell = under_m;
    }
    Ok(levelled)
}

impl Camera {
    /// Whether a point lies in the view and nothing of the terrain is in between.
    fn sees(&self, terrain: &Terrain, base: &BasePose, target_m: [f32; 3]) -> bool {
        let arm = base.vector_in_world(self.position_in_base_m);
        let eye_m: [f32; 3] = std::array::from_fn(|axis| base.position_m[axis] + arm[axis]);
        let ray: [f32; 3] = std::array::from_fn(|axis| target_m[axis] - eye_m[axis]);
        let [x, y, z] = base.vector_in_body(ray);
        let (sin_yaw, cos_yaw) = (libm::sinf(self.yaw_rad), libm::cosf(self.yaw_rad));
        let (sin_down, cos_down) = (libm::sinf(self.down_rad), libm::cosf(self.down_rad));
        let (ahead, left) = (cos_yaw * x + sin_yaw * y, cos_yaw * y - sin_yaw * x);
        let (depth, up) = (cos_down * ahead - sin_down * z, sin_down * ahead + cos_down * z);
        // Phrased as "is inside": a point without ground is not seen.
        let in_view = (RANGE_M[0]..=RANGE_M[1]).contains(&depth)
            && left.abs() <= HALF_VIEW[0] * depth
            && up.abs() <= HALF_VIEW[1] * depth;
        in_view && {
            let length_m = (ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]).sqrt();
            let pieces = (length_m / STRIDE_M).ceil().max(1.0);
            (1..pieces as usize).all(|piece| {
                let along = piece as f32 / pieces;
                let at: [f32; 3] = std::array::from_fn(|axis| eye_m[axis] + along * ray[axis]);
                // Outside the map there is nothing to hide a point; the slack keeps a plane in its own sight.
                let ground_m = terrain.height_m(at[0], at[1]);
                ground_m.is_nan() || ground_m <= at[2] + 0.005
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::{CourseKind, FLAT_M};

    fn looked(kind: CourseKind, rise_m: f32, x_m: f32) -> (Terrain, SeenMap, Vantage) {
        let terrain = Terrain::course(kind, rise_m, 3);
        let ground_m = terrain.height_m(x_m, 0.0);
        let base = BasePose::from_yaw([x_m, 0.0, ground_m + 0.55], 0.0);
        let mut map = SeenMap::new(&terrain, [x_m, 0.0]);
        map.look(&terrain, &base);
        (terrain, map, Vantage { position_m: base.position_m, yaw_rad: 0.0 })
    }

    #[test]
    fn the_ground_beyond_an_edge_is_hidden_and_filling_puts_floor_over_the_drop() {
        let (terrain, mut map, from) = looked(CourseKind::StairsDown, 0.3, FLAT_M - 1.5);
        let field = map.heightfield(&terrain, &from);
        assert!(field.cells_m[22][5].is_finite(), "1.2 m ahead, before the edge");
        assert!(field.cells_m[26][5].is_nan(), "1.6 m ahead, just below the edge");
        let unseen = map.unseen();
        assert_eq!((unseen.ticks, unseen.drop_ticks), (1, 1));
        assert!((0.29..0.95).contains(&unseen.deepest_m), "{unseen:?}");
    }

    #[test]
    fn risers_that_are_walked_up_to_hide_no_drop() {
        let (terrain, mut map, from) = looked(CourseKind::StairsUp, 0.15, FLAT_M - 1.0);
        let field = map.heightfield(&terrain, &from);
        assert!(field.cells_m[21][5].is_finite(), "the first tread, seen from above");
        assert_eq!(map.unseen().drop_ticks, 0);
    }

    #[test]
    fn a_point_once_seen_stays_known_when_the_robot_stands_over_it() {
        let (terrain, mut map, from) = looked(CourseKind::StairsUp, 0.1, 1.0);
        let ahead = Vantage { position_m: [2.2, 0.0, from.position_m[2]], ..from };
        assert!(map.heightfield(&terrain, &ahead).cells_m[10][5].is_finite(), "seen from 1.2 m behind it");
    }

    #[test]
    fn unknown_cells_are_levelled_with_the_ground_under_the_base() {
        let mut field = Heightfield { cells_m: [[-0.4; 11]; ROWS] };
        field.cells_m[10][5] = -0.5;
        field.cells_m[25][3] = f32::NAN;
        let level = levelled(&field).unwrap();
        assert_eq!((level.cells_m[25][3], level.cells_m[25][4]), (-0.5, -0.4));
    }
}
