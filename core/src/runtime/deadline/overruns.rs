//! When calls over their budget take a skill out of service.

use crate::moves::Moves;

/// Calls over their budget within a second that take a skill out of service.
const WITHIN_A_SECOND: usize = 3;

/// The latest overruns of every skill.
#[derive(Clone, Debug)]
pub(crate) struct Overruns {
    ticks_per_second: u64,
    /// Ticks of the last overruns but this one, the oldest first.
    last: Vec<[Option<u64>; WITHIN_A_SECOND - 1]>,
}

impl Overruns {
    pub(crate) fn new(rate_hz: f64, skills: usize) -> Self {
        Self { ticks_per_second: rate_hz.round() as u64, last: vec![[None; WITHIN_A_SECOND - 1]; skills] }
    }

    /// Notes that a call of `skill` was too slow in `tick`, at most one a tick; whether it is the third
    /// within a second.
    pub(crate) fn note(&mut self, skill: usize, tick: u64) -> bool {
        let last = &mut self.last[skill];
        if last[WITHIN_A_SECOND - 2] == Some(tick) {
            return false;
        }
        let is_last = last[0].is_some_and(|oldest| tick - oldest < self.ticks_per_second);
        last.rotate_left(1);
        last[WITHIN_A_SECOND - 2] = Some(tick);
        is_last
    }

    /// Other skills from now on.
    pub(crate) fn adopt(&mut self, moves: &Moves) {
        self.last = moves.carry(std::mem::take(&mut self.last), |_| [None; WITHIN_A_SECOND - 1]).0;
    }

    /// Forgets them all.
    pub(crate) fn restart(&mut self) {
        self.last.fill([None; WITHIN_A_SECOND - 1]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_third_within_a_second_counts_and_one_a_second_apart_does_not() {
        let mut overruns = Overruns::new(50.0, 2);
        assert_eq!([7, 8, 9].map(|tick| overruns.note(1, tick)), [false, false, true]);
        let mut overruns = Overruns::new(50.0, 2);
        assert_eq!([0, 49, 50, 51].map(|tick| overruns.note(0, tick)), [false, false, false, true]);
        assert!(!overruns.note(1, 51), "skills count apart");
        let mut overruns = Overruns::new(50.0, 1);
        let twice_in_a_tick = [7, 7, 8, 8, 9].map(|tick| overruns.note(0, tick));
        assert_eq!(twice_in_a_tick, [false, false, false, false, true]);
        overruns.restart();
        assert_eq!([52, 53].map(|tick| overruns.note(0, tick)), [false, false]);
    }
}
