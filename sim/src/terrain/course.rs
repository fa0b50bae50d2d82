//! The evaluation courses: flat, stairs, flat; one that goes up and down again; and one with every obstacle.

use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Area, GAP_FLOOR_M, Solid, TREAD_M, Terrain, TerrainKind, tile};

/// Length of every flat of a course, before, between and after obstacles, m.
pub const FLAT_M: f32 = 3.0;
/// Width of a course, its middle at y = 0, m.
pub const COURSE_WIDTH_M: f32 = 4.0;
/// Height of the steps on the course of obstacles, as in the paper's deployment, m.
pub const OBSTACLES_RISE_M: f32 = 0.12;

/// The courses that selectors are evaluated on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CourseKind {
    /// Flat, stairs up, flat.
    #[default]
    StairsUp,
    /// Flat, stairs down, flat.
    StairsDown,
    /// Flat, stairs up, flat, stairs down, flat: where energy is compared.
    Mixed,
    /// Flat, stairs up, flat, stairs down, flat, a wall, flat, a gap, flat. Its steps are of
    /// [`OBSTACLES_RISE_M`]; its size is the height of the wall and the width of the gap.
    Obstacles,
}

impl CourseKind {
    /// Every course.
    pub const ALL: [Self; 4] = [Self::StairsUp, Self::StairsDown, Self::Mixed, Self::Obstacles];

    /// The id used on the command line.
    pub const fn id(self) -> &'static str {
        match self {
            Self::StairsUp => "stairs_up",
            Self::StairsDown => "stairs_down",
            Self::Mixed => "mixed",
            Self::Obstacles => "obstacles",
        }
    }

    /// Its size in the demo: the paper's steps of 12 cm, and a wall and a gap of half a metre.
    pub const fn demo_size_m(self) -> f32 {
        match self {
            Self::StairsUp | Self::StairsDown | Self::Mixed => 0.12,
            Self::Obstacles => 0.5,
        }
    }

    /// What lies across the way, in order.
    const fn obstacles(self) -> &'static [TerrainKind] {
        use TerrainKind::{Gap, StairsDown, StairsUp, Wall};
        match self {
            Self::StairsUp => &[StairsUp],
            Self::StairsDown => &[StairsDown],
            Self::Mixed => &[StairsUp, StairsDown],
            Self::Obstacles => &[StairsUp, StairsDown, Wall, Gap],
        }
    }
}

/// No course has this id.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("found {0:?}, wanted one of {ids}", ids = CourseKind::ALL.map(CourseKind::id).join(" "))]
pub struct UnknownCourse(String);

impl FromStr for CourseKind {
    type Err = UnknownCourse;

    fn from_str(id: &str) -> Result<Self, UnknownCourse> {
        Self::ALL.into_iter().find(|kind| kind.id() == id).ok_or_else(|| UnknownCourse(id.to_owned()))
    }
}

/// A course of one size, laid out along x from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Course {
    /// Which one.
    pub kind: CourseKind,
    /// Its size: the height of a step, or of the wall as well as the width of the gap, m.
    pub size_m: f32,
    /// Steps of a flight.
    pub steps: usize,
}

/// What lies across the way of a course.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstacle {
    /// What it is.
    pub kind: TerrainKind,
    /// Height of a step or of the wall, or the width of the gap, m.
    pub size_m: f32,
    /// x of its first and of its last edge, m.
    pub edges_m: [f32; 2],
}

impl Course {
    /// From the start to the end of the far flat, m.
    pub fn length_m(&self) -> f32 {
        self.far_flat_from_m() + FLAT_M
    }

    /// Where the far flat begins, m.
    pub fn far_flat_from_m(&self) -> f32 {
        self.kind.obstacles().iter().map(|kind| FLAT_M + self.extent_m(*kind)).sum()
    }

    /// Height of the far flat, m.
    pub fn far_flat_m(&self) -> f32 {
        match self.kind {
            CourseKind::StairsUp => self.steps as f32 * self.size_m,
            CourseKind::StairsDown | CourseKind::Mixed => 0.0,
            CourseKind::Obstacles => self.size_m,
        }
    }

    /// What lies across the way, in order, each [`FLAT_M`] after the one before it.
    pub fn obstacles(&self) -> Vec<Obstacle> {
        let mut before_m = 0.0;
        let obstacle = |kind: &TerrainKind| {
            let first_m = FLAT_M + before_m;
            before_m += FLAT_M + self.extent_m(*kind);
            let edges_apart_m = match kind {
                TerrainKind::StairsUp | TerrainKind::StairsDown => {
                    self.steps.saturating_sub(1) as f32 * TREAD_M
                }
                _ => self.extent_m(*kind),
            };
            let edges_m = [first_m, first_m + edges_apart_m];
            Obstacle { kind: *kind, size_m: self.size_of(*kind), edges_m }
        };
        self.kind.obstacles().iter().map(obstacle).collect()
    }

    /// What lies under the predictors' field of a base at `x_m`: of the obstacles with an edge in it the one
    /// further ahead, else flat ground.
    pub fn under_field(&self, x_m: f32) -> TerrainKind {
        let seen_m = [x_m - FIELD_BACK_M, x_m + FIELD_FRONT_M];
        let obstacles = self.obstacles();
        let in_view = |obstacle: &&Obstacle| {
            let [first_m, last_m] = obstacle.edges_m;
            first_m <= seen_m[1] && last_m >= seen_m[0]
        };
        obstacles.iter().rev().find(in_view).map_or(TerrainKind::Flat, |obstacle| obstacle.kind)
    }

    /// How far an obstacle reaches along the way, up to the flat after it, m.
    fn extent_m(&self, kind: TerrainKind) -> f32 {
        match kind {
            TerrainKind::StairsUp | TerrainKind::StairsDown => self.steps as f32 * TREAD_M,
            TerrainKind::Gap => self.size_of(kind),
            _ => 0.0,
        }
    }

    fn size_of(&self, kind: TerrainKind) -> f32 {
        match (self.kind, kind) {
            (CourseKind::Obstacles, TerrainKind::StairsUp | TerrainKind::StairsDown) => OBSTACLES_RISE_M,
            _ => self.size_m,
        }
    }

    pub(super) fn build(&self) -> Terrain {
        let half_width_m = 0.5 * COURSE_WIDTH_M;
        let map = Area { min_m: [0.0, -half_width_m], max_m: [self.length_m(), half_width_m] };
        let solids = match self.kind {
            CourseKind::StairsUp => tile::stairs_up(map, FLAT_M, self.size_m, self.steps),
            CourseKind::StairsDown => tile::stairs_down(map, FLAT_M, self.size_m, self.steps),
            CourseKind::Mixed => self.up_and_down(map, map),
            CourseKind::Obstacles => self.all(map),
        };
        let first_flat = Area { min_m: [0.8, -0.5], max_m: [FLAT_M - 0.8, 0.5] };
        Terrain::new((self.kind.id().to_owned(), self.size_m, 0), solids, map, first_flat, true)
    }

    /// Steps up to a plateau and down again on `ground`: blocks lying on one another, the lowest the longest.
    fn up_and_down(&self, map: Area, ground: Area) -> Vec<Solid> {
        let obstacles = self.obstacles();
        let block = |step: usize| {
            let aside_m = step as f32 * TREAD_M;
            let along_m = [obstacles[0].edges_m[0] + aside_m, obstacles[1].edges_m[1] - aside_m];
            tile::block(tile::across(map, along_m[0], along_m[1]), (step + 1) as f32 * obstacles[0].size_m)
        };
        std::iter::once(tile::block(ground, 0.0)).chain((0..self.steps).map(block)).collect()
    }

    /// After the steps the wall, whose top reaches to the gap, and beyond it as high.
    fn all(&self, map: Area) -> Vec<Solid> {
        let [wall_m, gap_m] = [2, 3].map(|index: usize| self.obstacles()[index].edges_m);
        let before_the_gap = tile::across(map, map.min_m[0], gap_m[0]);
        let mut solids = self.up_and_down(map, before_the_gap);
        solids.push(tile::block(tile::across(map, gap_m[0], gap_m[1]), self.size_m + GAP_FLOOR_M));
        solids.push(tile::block(tile::across(map, wall_m[0], gap_m[0]), self.size_m));
        solids.push(tile::block(tile::across(map, gap_m[1], map.max_m[0]), self.size_m));
        solids
    }
}

/// Extent of the predictors' field behind and ahead of the base, m.
const FIELD_BACK_M: f32 = 1.0;
const FIELD_FRONT_M: f32 = 2.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn course(kind: CourseKind, size_m: f32) -> Course {
        Course { kind, size_m, steps: 3 }
    }

    fn assert_heights(course: Course, heights: &[(f32, f32)]) {
        let terrain = course.build();
        for (x_m, wanted_m) in heights {
            let found_m = terrain.height_m(*x_m, 0.3);
            assert!((found_m - wanted_m).abs() < 1e-5, "{found_m} at {x_m} m, wanted {wanted_m}");
        }
    }

    #[test]
    fn the_mixed_course_climbs_to_a_plateau_and_comes_down_to_where_it_began() {
        let mixed = course(CourseKind::Mixed, 0.1);
        let [up_m, down_m] = [FLAT_M, 2.0 * FLAT_M + 3.0 * TREAD_M];
        assert_heights(
            mixed,
            &[
                (up_m - 0.01, 0.0),
                (up_m + 0.01, 0.1),
                (up_m + TREAD_M + 0.01, 0.2),
                (up_m + 2.0 * TREAD_M + 0.01, 0.3),
                (down_m - 0.01, 0.3),
                (down_m + 0.01, 0.2),
                (down_m + 2.0 * TREAD_M - 0.01, 0.1),
                (down_m + 2.0 * TREAD_M + 0.01, 0.0),
                (mixed.far_flat_from_m(), 0.0),
            ],
        );
        assert!((mixed.length_m() - (9.0 + 6.0 * TREAD_M)).abs() < 1e-5);
    }

    #[test]
    fn the_course_of_obstacles_has_stairs_a_wall_and_a_gap_with_a_flat_between_each() {
        let obstacles = course(CourseKind::Obstacles, 0.5);
        let [_, down, wall, gap] = obstacles.obstacles().try_into().unwrap();
        assert_eq!([wall.kind, gap.kind], [TerrainKind::Wall, TerrainKind::Gap]);
        assert_eq!([down.size_m, wall.size_m, gap.size_m], [OBSTACLES_RISE_M, 0.5, 0.5]);
        assert!((wall.edges_m[0] - down.edges_m[1] - TREAD_M - FLAT_M).abs() < 1e-5);
        assert_heights(
            obstacles,
            &[
                (FLAT_M - 0.01, 0.0),
                (FLAT_M + 0.01, 0.12),
                (down.edges_m[0] - 0.01, 0.36),
                (down.edges_m[1] + 0.01, 0.0),
                (wall.edges_m[0] - 0.01, 0.0),
                (wall.edges_m[0] + 0.01, 0.5),
                (gap.edges_m[0] - 0.01, 0.5),
                (gap.edges_m[0] + 0.01, 0.5 + GAP_FLOOR_M),
                (gap.edges_m[1] - 0.01, 0.5 + GAP_FLOOR_M),
                (gap.edges_m[1] + 0.01, 0.5),
                (obstacles.far_flat_from_m() + 0.01, obstacles.far_flat_m()),
            ],
        );
        assert!((gap.edges_m[0] - wall.edges_m[1] - FLAT_M).abs() < 1e-5);
        assert!((obstacles.far_flat_from_m() - gap.edges_m[1]).abs() < 1e-5);
    }

    #[test]
    fn however_high_the_wall_the_way_to_it_stays_where_it_is() {
        let obstacles = course(CourseKind::Obstacles, 2.0);
        let gap_m = obstacles.obstacles()[3].edges_m;
        assert_heights(obstacles, &[(1.0, 0.0), (FLAT_M + 0.01, 0.12), (gap_m[0] + 0.01, 2.0 + GAP_FLOOR_M)]);
    }

    #[test]
    fn under_the_field_lies_the_obstacle_ahead_rather_than_the_one_behind() {
        let mixed = course(CourseKind::Mixed, 0.1);
        let under = |x_m: f32| mixed.under_field(x_m);
        assert_eq!(under(0.99), TerrainKind::Flat, "the first edge is 2.01 m ahead");
        assert_eq!(under(1.01), TerrainKind::StairsUp);
        let last_up_m = FLAT_M + 2.0 * TREAD_M;
        assert_eq!(under(last_up_m + 0.99), TerrainKind::StairsUp, "the last edge is 0.99 m behind");
        let first_down_m = 2.0 * FLAT_M + 3.0 * TREAD_M;
        assert_eq!(under(first_down_m - 1.99), TerrainKind::StairsDown);
        assert_eq!(under(first_down_m + 2.0 * TREAD_M + 1.01), TerrainKind::Flat);
    }
}
