//! A source that repeats itself: values that stay the same, bit for bit, while a skill drives are not of this robot.

use crate::elevation::Elevation;
use crate::observation::{Observation, ObservationFault};

/// Longest times for which values may stay the same while a skill drives, s; none is not looked at.
///
/// A bridge that stamps the last message of a source that hangs with new times looks so. Joints and body of a robot
/// that walks are never twice the same bits, and neither is terrain relative to a base that moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrozenLimits {
    /// Of joints, gravity and angular velocity.
    pub measurement_s: Option<f64>,
    /// Of terrain, on its own clock.
    pub terrain_s: Option<f64>,
}

/// What was seen last, and since when.
#[derive(Clone, Debug, Default)]
pub(super) struct Frozen {
    measurement: Repeated,
    terrain: Repeated,
}

impl Frozen {
    /// Whether the measurement of `now_s`, counted in ticks, still changes: a line repeated with its old time is
    /// frozen too.
    ///
    /// # Errors
    /// The joints, gravity and angular velocity are what they have been for too long.
    pub(super) fn check(
        &mut self,
        observation: &Observation,
        now_s: f64,
        drives: bool,
        limit_s: Option<f64>,
    ) -> Result<(), ObservationFault> {
        let Some(limit_s) = limit_s else { return Ok(()) };
        let joints = observation.joint_position_rad.iter().chain(&observation.joint_velocity_rad_per_s);
        let body = observation.projected_gravity.iter().chain(&observation.base_angular_velocity);
        match self.measurement.see(now_s, joints.chain(body), drives, limit_s) {
            Some(held_s) => Err(ObservationFault::new(
                "joints and base",
                format!("the same measurement for {held_s:.3} s"),
                format!("one that changes within {limit_s} s while a skill drives"),
            )),
            None => Ok(()),
        }
    }

    /// How long heights have been the same under new times, where that is too long.
    pub(super) fn terrain_s(
        &mut self,
        elevation: &Elevation,
        drives: bool,
        limit_s: Option<f64>,
    ) -> Option<f64> {
        self.terrain.see(elevation.t_s, elevation.height_m.iter(), drives, limit_s?)
    }

    pub(super) fn forget(&mut self) {
        self.measurement.values.clear();
        self.terrain.values.clear();
    }
}

/// Values that may be those of the time before.
#[derive(Clone, Debug, Default)]
struct Repeated {
    values: Vec<f32>,
    since_s: f64,
    is_frozen: bool,
}

impl Repeated {
    /// For how long the values have been the same, once that is as long as the limit; from then on until they
    /// change, whoever drives.
    fn see<'a>(
        &mut self,
        t_s: f64,
        values: impl Iterator<Item = &'a f32> + Clone,
        drives: bool,
        limit_s: f64,
    ) -> Option<f64> {
        let is_same = values.clone().map(|v| v.to_bits()).eq(self.values.iter().map(|v| v.to_bits()));
        if !is_same {
            self.values.clear();
            self.values.extend(values);
            self.is_frozen = false;
        }
        if !is_same || !(drives || self.is_frozen) {
            self.since_s = t_s;
        }
        let held_s = t_s - self.since_s;
        self.is_frozen |= held_s > limit_s - 1e-9;
        self.is_frozen.then_some(held_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decision::Forced;
    use crate::runtime::fixture::{Loop, fake, skill};

    /// A loop that walks, its joints and terrain a little different in every tick.
    fn walking(limits: FrozenLimits) -> Loop {
        let mut run = Loop::new(vec![skill("walk", &fake(0.99, 0.5))]);
        run.runtime.config.frozen = limits;
        for _ in 0..30 {
            moves(&mut run);
            run.tick();
        }
        assert_eq!(run.runtime.decision.active, "walk");
        run
    }

    fn moves(run: &mut Loop) {
        run.observation.joint_velocity_rad_per_s[4] += 1e-4;
        sees(run);
    }

    fn sees(run: &mut Loop) {
        run.observation.elevation.as_mut().unwrap().height_m[7] += 1e-4;
    }

    const MEASUREMENT: FrozenLimits = FrozenLimits { measurement_s: Some(0.1), terrain_s: None };
    const TERRAIN: FrozenLimits = FrozenLimits { measurement_s: None, terrain_s: Some(0.5) };

    #[test]
    fn a_measurement_that_stays_the_same_stops_a_skill_until_it_changes() {
        let mut run = walking(MEASUREMENT);
        for _ in 0..4 {
            assert_eq!(run.tick().active, "walk", "0.08 s");
        }
        let decision = run.tick();
        assert_eq!((decision.active.as_str(), decision.forced), ("stand", Some(Forced::Observation)));
        let found =
            "joints and base: found the same measurement for 0.100 s, wanted one that changes within 0.1 s";
        assert!(decision.events[0].starts_with(found), "{:?}", decision.events);
        assert_eq!(run.ticks(100).forced, Some(Forced::Observation), "standing makes it no better");
        moves(&mut run);
        assert_eq!(run.tick().forced, None);
        let ticks = (2..60).find(|_| {
            moves(&mut run);
            run.tick().active == "walk"
        });
        assert_eq!(ticks, Some(25), "the resume window");
    }

    #[test]
    fn a_line_repeated_with_its_time_is_frozen_too() {
        let mut run = walking(MEASUREMENT);
        let tick = |run: &mut Loop| run.runtime.tick(&run.observation).decision.forced;
        for _ in 0..4 {
            assert_eq!(tick(&mut run), None);
        }
        assert_eq!(tick(&mut run), Some(Forced::Observation));
    }

    #[test]
    fn a_robot_that_stands_may_stand_still() {
        let mut run = Loop::new(vec![skill("walk", &fake(0.2, 0.5))]);
        run.runtime.config.frozen = FrozenLimits { terrain_s: Some(0.1), ..MEASUREMENT };
        assert_eq!(run.ticks(200).forced, None);
    }

    #[test]
    fn terrain_that_stays_the_same_under_new_times_stops_a_skill() {
        let mut run = walking(TERRAIN);
        for _ in 0..24 {
            assert_eq!(run.tick().active, "walk");
        }
        let decision = run.tick();
        assert_eq!((decision.active.as_str(), decision.forced), ("stand", Some(Forced::Terrain)));
        assert!(
            decision.events[0].starts_with("elevation: found the same heights for 0.500 s under new times"),
            "{:?}",
            decision.events
        );
        assert_eq!(run.ticks(100).forced, Some(Forced::Terrain));
        sees(&mut run);
        assert_eq!(run.tick().forced, None);
    }

    #[test]
    fn a_map_that_comes_less_often_than_ticks_is_not_frozen() {
        let mut run = walking(FrozenLimits { terrain_s: Some(0.1), ..TERRAIN });
        for tick in 0..100 {
            // Every eighth tick a new map, under its own time.
            if tick % 8 == 0 {
                sees(&mut run);
                run.tick();
                continue;
            }
            run.observation.t_s += 0.02;
            assert_eq!(run.runtime.tick(&run.observation).decision.active, "walk", "{tick}");
        }
    }

    #[test]
    fn nothing_is_looked_at_unless_a_limit_is_set() {
        let mut run = walking(FrozenLimits::default());
        assert_eq!(run.ticks(200).active, "walk");
    }
}
