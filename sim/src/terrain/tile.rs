//! The tiles: one function a kind. Boxes reach deep, and steps are boxes nested in one another, so
//! that no foot meets a seam in a floor or the underside of anything.

use rand_chacha::ChaCha8Rng;

use super::{Area, GAP_FLOOR_M, Solid, TREAD_M, Terrain, TerrainKind};
use crate::stream::{stream, uniform};

/// Where every box ends below, m.
const BOTTOM_M: f32 = -2.5;
/// A rollout of 1.5 m from its far end brings the front feet to the obstacle.
const FLAT_BEFORE_M: f32 = 1.8;
/// On its far end the hind feet have just left the obstacle.
const FLAT_AFTER_M: f32 = 0.6;
const HALF_WIDTH_M: f32 = 1.0;
/// Room around the part on which robots are spawned, m.
const MARGIN_M: f32 = 4.0;
const STEPS: usize = 8;
const GRID_SPACING_M: f32 = 0.1;
/// Spacing of the random heights of rough terrain in grid cells, as in `legged_gym`.
const ROUGH_CELLS: usize = 2;
const SLOPE_SPACING_M: f32 = 0.5;
/// `legged_gym` has 20 boxes on 8 × 8 m.
const BOXES_PER_M2: f32 = 20.0 / 64.0;

pub(super) fn build(kind: TerrainKind, size_m: f32, wall_depth_m: f32, seed: u64) -> Terrain {
    let mut rng = stream(seed, "terrain", &[]);
    let lane = |obstacle_m: f32| Area {
        min_m: [0.0, -HALF_WIDTH_M],
        max_m: [FLAT_BEFORE_M + obstacle_m + FLAT_AFTER_M, HALF_WIDTH_M],
    };
    let square = Area { min_m: [-2.0, -2.0], max_m: [2.0, 2.0] };
    let spawn = match kind {
        TerrainKind::Flat | TerrainKind::Rough | TerrainKind::Discrete => square,
        TerrainKind::Slope => Area { min_m: [-4.0, -1.0], max_m: [4.0, 1.0] },
        TerrainKind::StairsUp | TerrainKind::StairsDown => lane(STEPS as f32 * TREAD_M),
        TerrainKind::Wall => lane(wall_depth_m),
        TerrainKind::Gap => lane(size_m),
    };
    let map = spawn.grown_by(MARGIN_M);
    let start_m = FLAT_BEFORE_M;
    let solids = match kind {
        TerrainKind::Flat => vec![block(map, 0.0)],
        TerrainKind::Rough => vec![rough(map, size_m, &mut rng)],
        TerrainKind::Slope => vec![slope(map, size_m)],
        TerrainKind::Discrete => discrete(map, size_m, &mut rng),
        TerrainKind::StairsUp => stairs_up(map, start_m, size_m, STEPS),
        TerrainKind::StairsDown => stairs_down(map, start_m, size_m, STEPS),
        TerrainKind::Wall => {
            vec![block(map, 0.0), block(across(map, start_m, start_m + wall_depth_m), size_m)]
        }
        TerrainKind::Gap => vec![
            block(map, GAP_FLOOR_M),
            block(across(map, map.min_m[0], start_m), 0.0),
            block(across(map, start_m + size_m, map.max_m[0]), 0.0),
        ],
    };
    let obstacle_x_m = kind.is_directed().then_some(start_m);
    let identity = (kind.id().to_owned(), size_m, seed);
    Terrain { obstacle_x_m, ..Terrain::new(identity, solids, map, spawn, kind.is_directed()) }
}

/// Steps from height 0 up, the first riser at `start_m`; each step reaches to the end of the map.
pub(super) fn stairs_up(map: Area, start_m: f32, rise_m: f32, steps: usize) -> Vec<Solid> {
    let step =
        |i: usize| block(across(map, start_m + i as f32 * TREAD_M, map.max_m[0]), (i + 1) as f32 * rise_m);
    std::iter::once(block(map, 0.0)).chain((0..steps).map(step)).collect()
}

/// Steps down to height 0, the first edge at `start_m`; each step reaches back to the start of the map.
pub(super) fn stairs_down(map: Area, start_m: f32, rise_m: f32, steps: usize) -> Vec<Solid> {
    let step = |i: usize| {
        block(across(map, map.min_m[0], start_m + i as f32 * TREAD_M), (steps - i) as f32 * rise_m)
    };
    std::iter::once(block(map, 0.0)).chain((0..steps).map(step)).collect()
}

pub(super) fn across(map: Area, from_x_m: f32, to_x_m: f32) -> Area {
    Area { min_m: [from_x_m, map.min_m[1]], max_m: [to_x_m, map.max_m[1]] }
}

pub(super) fn block(area: Area, top_m: f32) -> Solid {
    Solid::between([area.min_m[0], area.min_m[1], BOTTOM_M], [area.max_m[0], area.max_m[1], top_m])
}

fn points(map: Area, axis: usize, spacing_m: f32) -> usize {
    ((map.max_m[axis] - map.min_m[axis]) / spacing_m).round() as usize + 1
}

fn rough(map: Area, size_m: f32, rng: &mut ChaCha8Rng) -> Solid {
    let (rows, columns) = (points(map, 0, GRID_SPACING_M), points(map, 1, GRID_SPACING_M));
    let coarse_columns = columns / ROUGH_CELLS + 2;
    let coarse: Vec<f32> =
        (0..(rows / ROUGH_CELLS + 2) * coarse_columns).map(|_| uniform(rng, -size_m, size_m)).collect();
    let at = |row: usize, column: usize| {
        let (i, j) = (row / ROUGH_CELLS, column / ROUGH_CELLS);
        let u = (row % ROUGH_CELLS) as f32 / ROUGH_CELLS as f32;
        let v = (column % ROUGH_CELLS) as f32 / ROUGH_CELLS as f32;
        let h = |i: usize, j: usize| coarse[i * coarse_columns + j];
        (1.0 - u) * ((1.0 - v) * h(i, j) + v * h(i, j + 1))
            + u * ((1.0 - v) * h(i + 1, j) + v * h(i + 1, j + 1))
    };
    let heights_m = (0..rows * columns).map(|k| at(k / columns, k % columns)).collect();
    Solid::Grid { origin_m: map.min_m, spacing_m: GRID_SPACING_M, rows, columns, heights_m }
}

fn slope(map: Area, rise_per_m: f32) -> Solid {
    let (rows, columns) = (points(map, 0, SLOPE_SPACING_M), points(map, 1, SLOPE_SPACING_M));
    let height_m = |x_m: f32| rise_per_m * (3.5 - x_m.abs()).clamp(0.0, 3.0);
    let heights_m = (0..rows * columns)
        .map(|k| height_m(map.min_m[0] + (k / columns) as f32 * SLOPE_SPACING_M))
        .collect();
    Solid::Grid { origin_m: map.min_m, spacing_m: SLOPE_SPACING_M, rows, columns, heights_m }
}

fn discrete(map: Area, size_m: f32, rng: &mut ChaCha8Rng) -> Vec<Solid> {
    let extent_m = [map.max_m[0] - map.min_m[0], map.max_m[1] - map.min_m[1]];
    let count = (BOXES_PER_M2 * extent_m[0] * extent_m[1]).round() as usize;
    let mut solids = vec![block(map, 0.0)];
    for _ in 0..count {
        let mut interval = |axis: usize| {
            let length_m = uniform(rng, 1.0, 2.0);
            let from_m = uniform(rng, map.min_m[axis], map.max_m[axis] - length_m);
            [from_m, from_m + length_m]
        };
        let (x_m, y_m) = (interval(0), interval(1));
        let top_m = if uniform(rng, 0.0, 1.0) < 0.5 { 0.5 * size_m } else { size_m };
        solids.push(block(Area { min_m: [x_m[0], y_m[0]], max_m: [x_m[1], y_m[1]] }, top_m));
    }
    solids
}
