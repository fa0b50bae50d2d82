//! Where an environment goes after an episode: harder, easier, or the same again.

use super::config::CurriculumRules;

/// What came of an episode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Travel {
    /// Displacement of the base along the path, m.
    pub(super) distance_m: f32,
    /// Commanded velocity times the time that the episode had, m.
    pub(super) commanded_m: f32,
    /// The base touched something.
    pub(super) fell: bool,
    /// The robot walked to the tile's end before time was up.
    pub(super) left_the_tile: bool,
}

/// The level after an episode on `level` of `levels`.
///
/// One up when at least `up_share` of the commanded distance was made, or the tile left beyond
/// `down_share` of it, without a fall; past the last level a random one, by `draw` from 0 to 1. One
/// down when less than `down_share` was made.
///
/// # Source
/// `legged_gym`'s terrain curriculum (docs/method.md), which moves up at half the tile's length.
pub(super) fn next_level(level: u32, levels: u32, travel: &Travel, rules: CurriculumRules, draw: f32) -> u32 {
    let share = travel.distance_m / travel.commanded_m;
    let far = share >= rules.up_share || (travel.left_the_tile && share >= rules.down_share);
    if far && !travel.fell {
        let random = ((draw * levels as f32) as u32).min(levels - 1);
        return if level + 1 < levels { level + 1 } else { random };
    }
    // Phrased as "is inside", so that a distance of NaN leads down.
    if share >= rules.down_share { level } else { level.saturating_sub(1) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(level: u32, distance_m: f32, fell: bool, left_the_tile: bool) -> u32 {
        let travel = Travel { distance_m, commanded_m: 5.0, fell, left_the_tile };
        next_level(level, 10, &travel, CurriculumRules::default(), 0.35)
    }

    #[test]
    fn far_enough_is_a_level_up_and_less_than_half_a_level_down() {
        for (distance_m, wanted) in
            [(5.2, 4), (4.0, 4), (3.9, 3), (2.5, 3), (2.4, 2), (-1.0, 2), (f32::NAN, 2)]
        {
            assert_eq!(after(3, distance_m, false, false), wanted, "{distance_m} m of 5 m");
        }
    }

    #[test]
    fn the_end_of_the_tile_is_far_enough() {
        assert_eq!(after(3, 3.0, false, true), 4);
        assert_eq!(after(3, 2.0, false, true), 2, "over its near end");
    }

    #[test]
    fn who_falls_does_not_rise() {
        assert_eq!(after(3, 4.9, true, false), 3);
        assert_eq!(after(3, 1.0, true, false), 2);
    }

    #[test]
    fn past_the_last_level_a_random_one_and_below_the_first_the_first() {
        assert_eq!(after(9, 5.0, false, false), 3);
        assert_eq!(after(0, 0.0, true, false), 0);
    }
}
