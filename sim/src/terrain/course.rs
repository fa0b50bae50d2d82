//! The evaluation courses: flat, stairs, flat; and one that goes up and down again.

use super::{Area, Solid, TREAD_M, Terrain, TerrainKind, tile};
use serde::{Deserialize, Serialize};

/// Length of every flat of a course, before, between and after stairs, m.
pub const FLAT_M: f32 = 3.0;
/// Width of a course, its middle at y = 0, m.
pub const COURSE_WIDTH_M: f32 = 4.0;

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
}

impl CourseKind {
    /// Every course.
    pub const ALL: [Self; 3] = [Self::StairsUp, Self::StairsDown, Self::Mixed];

    /// The id used on the command line.
    pub const fn id(self) -> &'static str {
        match self {
            Self::StairsUp => "stairs_up",
            Self::StairsDown => "stairs_down",
            Self::Mixed => "mixed",
        }
    }

    /// The course with this id, if there is one.
    pub fn from_id(id: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.id() == id)
    }

    /// From the start to the end of the far flat, m.
    pub fn length_m(self, steps: usize) -> f32 {
        self.far_flat_from_m(steps) + FLAT_M
    }

    /// Where the far flat begins, m.
    pub fn far_flat_from_m(self, steps: usize) -> f32 {
        let flights = self.flights(steps);
        flights.len() as f32 * (FLAT_M + steps as f32 * TREAD_M)
    }

    /// Height of the far flat with steps of `rise_m`, m.
    pub fn far_flat_m(self, rise_m: f32, steps: usize) -> f32 {
        match self {
            Self::StairsUp => steps as f32 * rise_m,
            Self::StairsDown | Self::Mixed => 0.0,
        }
    }

    /// Each flight of stairs: up or down, and the x of its first and last edge, m.
    pub fn flights(self, steps: usize) -> Vec<(TerrainKind, [f32; 2])> {
        let ways: &[TerrainKind] = match self {
            Self::StairsUp => &[TerrainKind::StairsUp],
            Self::StairsDown => &[TerrainKind::StairsDown],
            Self::Mixed => &[TerrainKind::StairsUp, TerrainKind::StairsDown],
        };
        let tread = |count: usize| count as f32 * TREAD_M;
        let flight = |(index, way): (usize, &TerrainKind)| {
            let first_m = FLAT_M + index as f32 * (FLAT_M + tread(steps));
            (*way, [first_m, first_m + tread(steps.saturating_sub(1))])
        };
        ways.iter().enumerate().map(flight).collect()
    }

    /// What lies under the predictors' field of a base at `x_m`: of the flights with an edge in it the one
    /// further ahead, else flat ground.
    pub fn under_field(self, steps: usize, x_m: f32) -> TerrainKind {
        let seen_m = [x_m - FIELD_BACK_M, x_m + FIELD_FRONT_M];
        let flights = self.flights(steps);
        let seen =
            flights.iter().rev().find(|(_, edges_m)| edges_m[0] <= seen_m[1] && edges_m[1] >= seen_m[0]);
        seen.map_or(TerrainKind::Flat, |(way, _)| *way)
    }
}

/// Extent of the predictors' field behind and ahead of the base, m.
const FIELD_BACK_M: f32 = 1.0;
const FIELD_FRONT_M: f32 = 2.0;

pub(super) fn build(kind: CourseKind, rise_m: f32, steps: usize) -> Terrain {
    let half_width_m = 0.5 * COURSE_WIDTH_M;
    let map = Area { min_m: [0.0, -half_width_m], max_m: [kind.length_m(steps), half_width_m] };
    let solids = match kind {
        CourseKind::StairsUp => tile::stairs_up(map, FLAT_M, rise_m, steps),
        CourseKind::StairsDown => tile::stairs_down(map, FLAT_M, rise_m, steps),
        CourseKind::Mixed => over(map, kind, rise_m, steps),
    };
    let first_flat = Area { min_m: [0.8, -0.5], max_m: [FLAT_M - 0.8, 0.5] };
    Terrain::new((kind.id().to_owned(), rise_m, 0), solids, map, first_flat, true)
}

/// Steps up to a plateau and down again: blocks lying on one another, the lowest the longest.
fn over(map: Area, kind: CourseKind, rise_m: f32, steps: usize) -> Vec<Solid> {
    let flights = kind.flights(steps);
    let edges_m = |flight: usize| flights[flight].1;
    let block = |step: usize| {
        let aside_m = step as f32 * TREAD_M;
        let along_m = [edges_m(0)[0] + aside_m, edges_m(1)[1] - aside_m];
        tile::block(tile::across(map, along_m[0], along_m[1]), (step + 1) as f32 * rise_m)
    };
    std::iter::once(tile::block(map, 0.0)).chain((0..steps).map(block)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mixed_course_climbs_to_a_plateau_and_comes_down_to_where_it_began() {
        let course = Terrain::course(CourseKind::Mixed, 0.1, 3);
        let height_m = |x_m: f32| course.height_m(x_m, 0.3);
        let [up_m, down_m] = [FLAT_M, 2.0 * FLAT_M + 3.0 * TREAD_M];
        for (x_m, wanted_m) in [
            (up_m - 0.01, 0.0),
            (up_m + 0.01, 0.1),
            (up_m + TREAD_M + 0.01, 0.2),
            (up_m + 2.0 * TREAD_M + 0.01, 0.3),
            (down_m - 0.01, 0.3),
            (down_m + 0.01, 0.2),
            (down_m + 2.0 * TREAD_M - 0.01, 0.1),
            (down_m + 2.0 * TREAD_M + 0.01, 0.0),
            (CourseKind::Mixed.far_flat_from_m(3), 0.0),
        ] {
            assert!((height_m(x_m) - wanted_m).abs() < 1e-5, "{} at {x_m} m", height_m(x_m));
        }
        assert!((CourseKind::Mixed.length_m(3) - (9.0 + 6.0 * TREAD_M)).abs() < 1e-5);
    }

    #[test]
    fn under_the_field_lies_the_flight_ahead_rather_than_the_one_behind() {
        let under = |x_m: f32| CourseKind::Mixed.under_field(3, x_m);
        assert_eq!(under(0.99), TerrainKind::Flat, "the first edge is 2.01 m ahead");
        assert_eq!(under(1.01), TerrainKind::StairsUp);
        let last_up_m = FLAT_M + 2.0 * TREAD_M;
        assert_eq!(under(last_up_m + 0.99), TerrainKind::StairsUp, "the last edge is 0.99 m behind");
        let first_down_m = 2.0 * FLAT_M + 3.0 * TREAD_M;
        assert_eq!(under(first_down_m - 1.99), TerrainKind::StairsDown);
        assert_eq!(under(first_down_m + 2.0 * TREAD_M + 1.01), TerrainKind::Flat);
    }
}
