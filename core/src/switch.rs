//! The sliding window between the selector's choices and the skill that walks.
//!
//! All of the window must agree before anything changes, which a run length expresses: the window
//! agrees when the same choice came that many times in a row.

use crate::moves::Moves;
use crate::selector::Choice;

/// Lengths of the windows, ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Windows {
    /// Choices that must agree before the robot switches.
    pub switch: usize,
    /// Choices that must agree before it stops, and ticks for which the active skill may be
    /// unviable while the choices alternate.
    pub stop: usize,
    /// Choices that must agree before a stop is left.
    pub resume: usize,
}

/// Who drives the joints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Active {
    /// The core's own stand.
    Stand,
    /// This skill, by its place in the deployment.
    Skill(usize),
}

/// The window and what it decided last.
#[derive(Clone, Debug)]
pub struct SwitchFilter {
    windows: Windows,
    active: Active,
    stopped: bool,
    last: Option<Choice>,
    run: usize,
    unviable: usize,
    /// While it stands or the active skill is unviable: one that won and has been viable since, and for how
    /// many ticks.
    steady: Option<(usize, usize)>,
}

impl SwitchFilter {
    /// A filter at the start of the loop, which stands.
    pub const fn new(windows: Windows) -> Self {
        Self { windows, active: Active::Stand, stopped: false, last: None, run: 0, unviable: 0, steady: None }
    }

    /// Who drives.
    pub const fn active(&self) -> Active {
        self.active
    }

    /// Whether it stands because of a stop, which one skill must win `resume` times to leave.
    pub const fn is_stopped(&self) -> bool {
        self.stopped
    }

    /// The windows.
    pub const fn windows(&self) -> Windows {
        self.windows
    }

    /// How often the latest choice came in a row, and how often it must before it takes effect.
    pub const fn agreement(&self) -> (usize, usize) {
        let wanted = match self.last {
            Some(Choice::Stop) => self.windows.stop,
            _ if self.stopped => self.windows.resume,
            _ => self.windows.switch,
        };
        (self.run, wanted)
    }

    /// The skill that won while it stood, or while the active one was unviable, and has been viable since; and
    /// for how many ticks.
    pub const fn steady(&self) -> Option<(usize, usize)> {
        self.steady
    }

    /// One tick: the selector's choice, and which skills are viable.
    ///
    /// # Source
    /// Wu et al. (2025), selection step 5. Our own: that an active skill unviable for the stop window is left
    /// whatever the choices do, for a winner that has been viable for half the switch window, else for the stand,
    /// which a winner of the last moment puts off by at most that half;
    /// the resume window; and that winners who alternate while it stands do not hold it for ever: it leaves with
    /// one that has been viable for twice the window.
    pub fn step(&mut self, choice: Choice, is_viable: impl Fn(usize) -> bool) -> Active {
        self.count(choice, is_viable);
        let (run, wanted) = self.agreement();
        match choice {
            Choice::Stop if run >= wanted => self.stop(),
            Choice::Skill(skill) if run >= wanted || self.may_leave_the_stand(skill, 2 * wanted) => {
                self.take(skill);
            }
            _ if self.unviable >= self.windows.stop => match self.steady {
                Some((skill, ticks)) if 2 * ticks >= self.windows.switch => self.take(skill),
                Some(_) if 2 * (self.unviable - self.windows.stop) < self.windows.switch => {}
                _ => self.stop(),
            },
            _ => {}
        }
        self.active
    }

    /// One tick in which nothing may change: it counts, and what all of the window agrees on takes effect with
    /// the first [`step`](Self::step) after.
    pub fn count(&mut self, choice: Choice, is_viable: impl Fn(usize) -> bool) {
        self.run = if self.last == Some(choice) { self.run.saturating_add(1) } else { 1 };
        self.last = Some(choice);
        self.unviable = match self.active {
            Active::Skill(active) if !is_viable(active) => self.unviable + 1,
            _ => 0,
        };
        let looks_for_another = self.active == Active::Stand || self.unviable > 0;
        self.steady = match (choice, self.steady) {
            (Choice::Skill(_), Some((skill, ticks))) if looks_for_another && is_viable(skill) => {
                Some((skill, ticks.saturating_add(1)))
            }
            (Choice::Skill(winner), _) if looks_for_another => Some((winner, 1)),
            _ => None,
        };
    }

    fn take(&mut self, skill: usize) {
        if self.active != Active::Skill(skill) {
            self.unviable = 0;
        }
        self.active = Active::Skill(skill);
        self.stopped = false;
    }

    fn may_leave_the_stand(&self, skill: usize, wanted: usize) -> bool {
        self.active == Active::Stand
            && self.steady.is_some_and(|(steady, ticks)| steady == skill && ticks >= wanted)
    }

    /// Other skills from now on. A choice of one that is gone counts no more; when it is the active one, it
    /// stops.
    pub(crate) fn adopt(&mut self, moves: &Moves) {
        if let Some(Choice::Skill(skill)) = self.last {
            self.last = moves.to(skill).map(Choice::Skill);
            self.run = if self.last.is_some() { self.run } else { 0 };
        }
        self.steady = self.steady.and_then(|(skill, ticks)| Some((moves.to(skill)?, ticks)));
        if let Active::Skill(skill) = self.active {
            if let Some(skill) = moves.to(skill) {
                self.active = Active::Skill(skill);
            } else {
                self.stop_now();
            }
        }
    }

    /// Stops now: a fault waits for no window. Counting starts anew.
    pub const fn stop_now(&mut self) {
        self.last = None;
        self.run = 0;
        self.steady = None;
        self.stop();
    }

    /// Stands now because nothing is asked for. Choices count anew once something is.
    pub const fn stand_now(&mut self) {
        self.last = None;
        self.run = 0;
        self.unviable = 0;
        self.steady = None;
        self.active = Active::Stand;
    }

    const fn stop(&mut self) {
        self.unviable = 0;
        self.active = Active::Stand;
        self.stopped = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WALK: Choice = Choice::Skill(0);
    const ASCEND: Choice = Choice::Skill(1);
    const DESCEND: Choice = Choice::Skill(2);

    fn filter(stop: usize) -> SwitchFilter {
        SwitchFilter::new(Windows { switch: 10, stop, resume: 25 })
    }

    /// Ticks of `choice` until the active one is `wanted`; at most 100.
    fn ticks_until(filter: &mut SwitchFilter, choice: Choice, viable: bool, wanted: Active) -> usize {
        (1..=100).find(|_| filter.step(choice, |_| viable) == wanted).unwrap_or(usize::MAX)
    }

    fn walking(stop: usize) -> SwitchFilter {
        let mut filter = filter(stop);
        ticks_until(&mut filter, WALK, true, Active::Skill(0));
        filter
    }

    #[test]
    fn it_starts_standing_and_switches_when_ten_agree() {
        let mut filter = filter(10);
        assert_eq!(filter.active(), Active::Stand);
        assert_eq!(ticks_until(&mut filter, WALK, true, Active::Skill(0)), 10);
        assert_eq!(ticks_until(&mut filter, ASCEND, true, Active::Skill(1)), 10);
    }

    #[test]
    fn one_dissenting_tick_starts_the_count_anew() {
        let mut filter = walking(10);
        for _ in 0..9 {
            filter.step(ASCEND, |_| true);
        }
        filter.step(WALK, |_| true);
        assert_eq!(ticks_until(&mut filter, ASCEND, true, Active::Skill(1)), 10);
    }

    #[test]
    fn a_stop_goes_through_its_own_window() {
        assert_eq!(ticks_until(&mut walking(10), Choice::Stop, false, Active::Stand), 10);
        assert_eq!(ticks_until(&mut walking(4), Choice::Stop, false, Active::Stand), 4);
        assert_eq!(ticks_until(&mut walking(1), Choice::Stop, false, Active::Stand), 1, "1 stops at once");
    }

    #[test]
    fn a_stop_is_left_when_one_skill_has_won_the_resume_window() {
        let mut filter = walking(10);
        ticks_until(&mut filter, Choice::Stop, false, Active::Stand);
        assert!(filter.is_stopped());
        for _ in 0..24 {
            assert_eq!(filter.step(WALK, |_| true), Active::Stand);
        }
        for _ in 0..24 {
            assert_eq!(filter.step(ASCEND, |_| true), Active::Stand, "another skill counts anew");
        }
        assert_eq!(filter.step(ASCEND, |_| true), Active::Skill(1));
        assert!(!filter.is_stopped());
        assert_eq!(ticks_until(&mut filter, WALK, true, Active::Skill(0)), 10, "the usual window again");
    }

    #[test]
    fn alternating_winners_still_stop() {
        let mut filter = walking(10);
        // Half a window later than if nothing had won.
        for tick in 1..15 {
            let choice = if tick % 2 == 0 { ASCEND } else { DESCEND };
            assert_eq!(filter.step(choice, |_| false), Active::Skill(0), "tick {tick}");
        }
        assert_eq!(filter.step(ASCEND, |_| false), Active::Stand);
        assert!(filter.is_stopped());
    }

    #[test]
    fn alternating_winners_hand_over_to_the_one_that_is_viable_throughout() {
        let mut filter = walking(10);
        for tick in 1..10 {
            // Ascend is cheaper and viable now and then; descend always is.
            let choice = if tick % 3 == 1 { ASCEND } else { DESCEND };
            let active = filter.step(choice, |skill| skill == 2 || skill == 1 && tick % 3 == 1);
            assert_eq!(active, Active::Skill(0), "tick {tick}");
        }
        assert_eq!(filter.step(ASCEND, |skill| skill != 0), Active::Skill(2), "not a stop on the stairs");
        assert!(!filter.is_stopped());
    }

    #[test]
    fn a_winner_of_the_last_moment_saves_from_a_stop_only_if_it_goes_on_winning() {
        for (goes_on, wanted) in [(true, Active::Skill(1)), (false, Active::Stand)] {
            let mut filter = walking(10);
            for _ in 1..8 {
                filter.step(Choice::Stop, |_| false);
            }
            for _ in 8..12 {
                assert_eq!(filter.step(ASCEND, |skill| skill == 1), Active::Skill(0));
            }
            let last = if goes_on { ASCEND } else { Choice::Stop };
            assert_eq!(filter.step(last, |skill| goes_on && skill == 1), wanted);
        }
    }

    #[test]
    fn alternating_winners_leave_a_viable_skill_alone() {
        let mut filter = walking(10);
        for tick in 0..100 {
            let choice = if tick % 2 == 0 { ASCEND } else { DESCEND };
            assert_eq!(filter.step(choice, |_| true), Active::Skill(0));
        }
    }

    #[test]
    fn an_active_skill_that_is_viable_now_and_then_does_not_stop() {
        let mut filter = walking(10);
        for tick in 0..100 {
            let choice = if tick % 2 == 0 { ASCEND } else { DESCEND };
            assert_eq!(filter.step(choice, |_| tick % 9 == 0), Active::Skill(0));
        }
    }

    #[test]
    fn a_new_skill_is_not_blamed_for_the_old_ones_unviable_ticks() {
        let mut filter = SwitchFilter::new(Windows { switch: 10, stop: 15, resume: 25 });
        ticks_until(&mut filter, WALK, true, Active::Skill(0));
        assert_eq!(ticks_until(&mut filter, ASCEND, false, Active::Skill(1)), 10);
        for _ in 0..14 {
            assert_eq!(filter.step(ASCEND, |_| false), Active::Skill(1));
        }
    }

    #[test]
    fn a_fault_stops_at_once_and_the_resume_window_counts_from_there() {
        let mut filter = walking(10);
        filter.stop_now();
        assert_eq!(filter.active(), Active::Stand);
        assert_eq!(ticks_until(&mut filter, WALK, true, Active::Skill(0)), 25);
    }

    #[test]
    fn a_zero_command_stands_at_once_and_is_left_by_the_switch_window() {
        let mut filter = walking(10);
        filter.stand_now();
        assert_eq!(filter.active(), Active::Stand);
        assert!(!filter.is_stopped());
        assert_eq!(ticks_until(&mut filter, WALK, true, Active::Skill(0)), 10);
    }

    /// Choices of walk and ascend by turns while only ascend is viable throughout; the tick that leaves the stand.
    fn turns_until_it_goes(filter: &mut SwitchFilter) -> Option<usize> {
        (1..=200).find(|tick| {
            let walk_wins = tick % 3 == 1;
            let choice = if walk_wins { WALK } else { ASCEND };
            filter.step(choice, |skill| skill == 1 || walk_wins) == Active::Skill(1)
        })
    }

    #[test]
    fn alternating_winners_do_not_hold_a_standing_robot_for_ever() {
        let mut start = filter(10);
        assert_eq!(turns_until_it_goes(&mut start), Some(21), "twice the window after its first win");
        let mut stopped = walking(10);
        stopped.stop_now();
        assert_eq!(turns_until_it_goes(&mut stopped), Some(51), "twice the resume window");
        assert!(!stopped.is_stopped());
    }

    #[test]
    fn a_skill_that_is_viable_now_and_then_does_not_end_the_stand() {
        let mut filter = filter(10);
        for tick in 0..200 {
            let choice = if tick % 2 == 0 { ASCEND } else { DESCEND };
            let of = if tick % 2 == 0 { 1 } else { 2 };
            assert_eq!(filter.step(choice, |skill| skill == of), Active::Stand);
        }
    }

    #[test]
    fn one_tick_without_a_viable_skill_starts_the_patience_anew() {
        let mut filter = filter(10);
        for tick in 0..19 {
            filter.step(if tick % 2 == 0 { ASCEND } else { DESCEND }, |_| true);
        }
        filter.step(Choice::Stop, |_| false);
        assert_eq!(filter.steady(), None);
        assert_eq!(turns_until_it_goes(&mut filter), Some(21));
    }
}
