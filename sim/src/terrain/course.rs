//! The evaluation courses: flat, stairs, flat.

use super::{Area, TREAD_M, Terrain, tile};
use serde::{Deserialize, Serialize};

/// Length of the flat before and of the flat after the stairs, m.
pub const FLAT_M: f32 = 3.0;
/// Width of a course, its middle at y = 0, m.
pub const COURSE_WIDTH_M: f32 = 4.0;

/// The courses that selectors are evaluated on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CourseKind {
    /// Flat, stairs up, flat.
    StairsUp,
    /// Flat, stairs down, flat.
    StairsDown,
}

impl CourseKind {
    /// Every course.
    pub const ALL: [Self; 2] = [Self::StairsUp, Self::StairsDown];

    /// The id used on the command line.
    pub const fn id(self) -> &'static str {
        match self {
            Self::StairsUp => "stairs_up",
            Self::StairsDown => "stairs_down",
        }
    }

    /// The course with this id, if there is one.
    pub fn from_id(id: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.id() == id)
    }
}

pub(super) fn build(kind: CourseKind, rise_m: f32, steps: usize) -> Terrain {
    let length_m = 2.0 * FLAT_M + steps as f32 * TREAD_M;
    let map = Area { min_m: [0.0, -0.5 * COURSE_WIDTH_M], max_m: [length_m, 0.5 * COURSE_WIDTH_M] };
    let solids = match kind {
        CourseKind::StairsUp => tile::stairs_up(map, FLAT_M, rise_m, steps),
        CourseKind::StairsDown => tile::stairs_down(map, FLAT_M, rise_m, steps),
    };
    let first_flat = Area { min_m: [0.8, -0.5], max_m: [FLAT_M - 0.8, 0.5] };
    Terrain::new((kind.id().to_owned(), rise_m, 0), solids, map, first_flat, true)
}
