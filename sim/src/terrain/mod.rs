//! Terrain as exact solids: what the physics collides with and what heightfields are sampled from.
//!
//! Tiles are named by (kind, size in metres, seed), courses by (kind, size, number of steps). A hole
//! has a floor and is a finite height; only what lies outside the map is unknown (NaN).

mod course;
mod lookup;
mod sensing;
mod solid;
mod tile;

#[cfg(test)]
mod tests;

pub use course::{COURSE_WIDTH_M, Course, CourseKind, FLAT_M, OBSTACLES_RISE_M, Obstacle, UnknownCourse};
pub use sensing::Vantage;
pub use solid::Solid;

use lookup::HeightLookup;
use serde::{Deserialize, Serialize};

/// Height of the floor of a gap, below where [`Heightfield`](vocaloco_core::heightfield::Heightfield)
/// clips, m.
pub const GAP_FLOOR_M: f32 = -1.5;
/// Depth of a stair's tread, m (docs/method.md).
pub const TREAD_M: f32 = 0.31;

/// Length of a wall's top along the way, m.
pub const WALL_DEPTH_M: f32 = 1.5;

/// The terrains that skills are collected and evaluated on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TerrainKind {
    /// A plane.
    Flat,
    /// Random heights of ± size every 0.2 m, in straight lines between.
    Rough,
    /// A ramp up, a plateau and a ramp down; size is the rise per metre.
    Slope,
    /// Boxes of 1 to 2 m, half as high as size or as high.
    Discrete,
    /// Eight steps up along +x; size is the height of a step.
    StairsUp,
    /// Eight steps down along +x; size is the height of a step.
    StairsDown,
    /// A block across the way; size is its height.
    Wall,
    /// A trench across the way; size is its width.
    Gap,
}

impl TerrainKind {
    /// Every kind, in the order of their ids in data sets.
    pub const ALL: [Self; 8] = [
        Self::Flat,
        Self::Rough,
        Self::Slope,
        Self::Discrete,
        Self::StairsUp,
        Self::StairsDown,
        Self::Wall,
        Self::Gap,
    ];

    /// The id used on the command line and in data sets.
    pub const fn id(self) -> &'static str {
        match self {
            Self::Flat => "flat",
            Self::Rough => "rough",
            Self::Slope => "slope",
            Self::Discrete => "discrete",
            Self::StairsUp => "stairs_up",
            Self::StairsDown => "stairs_down",
            Self::Wall => "wall",
            Self::Gap => "gap",
        }
    }

    /// The kind with this id, if there is one.
    pub fn from_id(id: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.id() == id)
    }

    /// Sizes that data are collected over, m (docs/method.md).
    pub const fn range_m(self) -> [f32; 2] {
        match self {
            Self::Flat => [0.0, 0.0],
            Self::Rough => [0.0, 0.15],
            Self::Slope => [0.0, 0.5],
            Self::Discrete => [0.0, 0.3],
            Self::StairsUp | Self::StairsDown => [0.02, 0.45],
            Self::Wall => [0.0, 0.8],
            Self::Gap => [0.0, 0.9],
        }
    }

    /// Size at a difficulty from 0 to 1.
    pub fn size_m(self, difficulty: f32) -> f32 {
        let [low, high] = self.range_m();
        low + difficulty * (high - low)
    }

    /// Difficulty of a size: 0 to 1 inside [`range_m`](Self::range_m), 0 on flat ground.
    pub fn difficulty(self, size_m: f32) -> f32 {
        let [low, high] = self.range_m();
        if high > low { (size_m - low) / (high - low) } else { 0.0 }
    }

    /// Whether the terrain has a direction of travel (+x).
    pub const fn is_directed(self) -> bool {
        matches!(self, Self::StairsUp | Self::StairsDown | Self::Wall | Self::Gap)
    }
}

impl std::fmt::Display for TerrainKind {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(self.id())
    }
}

/// A piece of world, z up, of fixed solids.
#[derive(Clone, Debug)]
pub struct Terrain {
    /// Id of the tile's or course's kind.
    pub kind: String,
    /// Its one size, m (slope: rise per metre).
    pub size_m: f32,
    /// Seed of its random part.
    pub seed: u64,
    /// What the physics collides with.
    pub solids: Vec<Solid>,
    /// Corner of the map with the smallest x and y, m.
    pub min_m: [f32; 2],
    /// Corner of the map with the largest x and y, m.
    pub max_m: [f32; 2],
    /// Corner of the part on which robots are spawned, m.
    pub spawn_min_m: [f32; 2],
    /// Opposite corner of the part on which robots are spawned, m.
    pub spawn_max_m: [f32; 2],
    /// Where along x the obstacle of a directed tile begins, m.
    pub obstacle_x_m: Option<f32>,
    /// Direction of travel on directed terrain.
    pub heading_rad: Option<f32>,
    lookup: HeightLookup,
}

impl Terrain {
    /// A tile: the same arguments always give the same solids.
    ///
    /// Directed kinds are lanes along +x: 1.8 m of flat, the obstacle, 0.6 m of flat, on which robots
    /// are spawned, with 4 m of room on every side, for a rollout of 2.6 m and the view ahead of it.
    pub fn tile(kind: TerrainKind, size_m: f32, seed: u64) -> Self {
        tile::build(kind, size_m, WALL_DEPTH_M, seed)
    }

    /// A tile whose wall, if it is one, has a top of `depth_m` along the way instead of [`WALL_DEPTH_M`].
    pub fn deep_tile(kind: TerrainKind, size_m: f32, depth_m: f32, seed: u64) -> Self {
        tile::build(kind, size_m, depth_m, seed)
    }

    /// An evaluation [`Course`], its flights of `steps` steps (docs/method.md), from x = 0 on, centred on y = 0.
    pub fn course(kind: CourseKind, size_m: f32, steps: usize) -> Self {
        Course { kind, size_m, steps }.build()
    }

    /// Height of the ground, the top of the highest solid there, m; NaN outside the map.
    ///
    /// Exactly the surface that the physics collides with: boxes are flat, a grid's cells are the two
    /// triangles of [`Solid::shape`]. An edge belongs to the higher side.
    #[expect(clippy::inline_always, reason = "a plugin's patch is a thousand of these a tick")]
    #[inline(always)]
    pub fn height_m(&self, x_m: f32, y_m: f32) -> f32 {
        let [min, max] = [self.min_m, self.max_m];
        let inside = x_m >= min[0] && x_m <= max[0] && y_m >= min[1] && y_m <= max[1];
        if inside { self.lookup.height_m(&self.solids, x_m, y_m) } else { f32::NAN }
    }

    fn new(identity: (String, f32, u64), solids: Vec<Solid>, map: Area, spawn: Area, directed: bool) -> Self {
        let lookup = HeightLookup::new(&solids, map.min_m, map.max_m);
        let (kind, size_m, seed) = identity;
        Self {
            kind,
            size_m,
            seed,
            solids,
            min_m: map.min_m,
            max_m: map.max_m,
            spawn_min_m: spawn.min_m,
            spawn_max_m: spawn.max_m,
            obstacle_x_m: None,
            heading_rad: directed.then_some(0.0),
            lookup,
        }
    }
}

/// A rectangle of the world's xy plane.
#[derive(Clone, Copy, Debug)]
struct Area {
    min_m: [f32; 2],
    max_m: [f32; 2],
}

impl Area {
    fn grown_by(self, margin_m: f32) -> Self {
        Self { min_m: self.min_m.map(|v| v - margin_m), max_m: self.max_m.map(|v| v + margin_m) }
    }
}
