//! Position targets in training: what is drawn, where a robot is on its way, and what that is worth.

use serde::{Deserialize, Serialize};
use vocaloco_core::target::TargetRule;

use super::config::{ConfigError, inside, ordered};
use super::reward::RewardTerm;

/// A target for each episode in place of a velocity, set as in a rollout: straight ahead of where it begins.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetRules {
    /// Length of the way, least and most, m.
    pub distance_m: [f32; 2],
    /// Time for it, which is the episode's, least and most, s.
    pub time_s: [f32; 2],
}

impl TargetRules {
    /// Always a skill's own.
    pub fn always(rule: TargetRule) -> Self {
        Self { distance_m: [rule.distance_m; 2], time_s: [rule.time_s as f32; 2] }
    }

    pub(super) fn check(&self) -> Result<(), ConfigError> {
        ordered("target.distance_m", self.distance_m, 0.1..=10.0)?;
        ordered("target.time_s", self.time_s, 0.5..=60.0)
    }
}

/// When, and how sharply, a target is rewarded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TargetReward {
    /// Being there counts while less than this is left, s.
    pub window_s: f32,
    /// Distance from the target that is worth half, m.
    pub half_m: f32,
    /// Within this distance a robot is there and should rest, m.
    pub near_m: f32,
    /// Speed on the way that is worth all there is, m/s.
    pub approach_m_per_s: f32,
    /// Slower than this on the way is waiting, m/s.
    pub waiting_m_per_s: f32,
}

impl Default for TargetReward {
    fn default() -> Self {
        Self { window_s: 2.0, half_m: 0.5, near_m: 0.15, approach_m_per_s: 0.5, waiting_m_per_s: 0.1 }
    }
}

impl TargetReward {
    pub(super) fn is_default(&self) -> bool {
        *self == Self::default()
    }

    pub(super) fn check(&self) -> Result<(), ConfigError> {
        inside("reward.target.window_s", self.window_s, 0.02..=60.0)?;
        inside("reward.target.half_m", self.half_m, 0.01..=10.0)?;
        inside("reward.target.near_m", self.near_m, 0.0..=10.0)?;
        inside("reward.target.approach_m_per_s", self.approach_m_per_s, 0.01..=3.0)?;
        inside("reward.target.waiting_m_per_s", self.waiting_m_per_s, 0.0..=3.0)
    }
}

/// A robot on its way to a target, at the end of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Aim {
    /// Horizontal distance to the target, m.
    pub(super) distance_m: f32,
    /// Time left, s.
    pub(super) left_s: f32,
    /// Of the base straight to the target, m/s.
    pub(super) approach_m_per_s: f32,
    /// Horizontal, m/s.
    pub(super) speed_m_per_s: f32,
    /// rad/s.
    pub(super) yaw_rate_rad_per_s: f32,
    /// Σ (q − q₀)², q₀ the stand, rad².
    pub(super) posture_error: f32,
}

impl Aim {
    /// From the command of the instant, `[x m, y m, heading rad, time left s]` in the yaw-aligned base frame,
    /// and the base's velocity, `[forward, left]` m/s in the same frame.
    pub(super) fn new(
        target: [f32; 4],
        velocity: [f32; 2],
        yaw_rate_rad_per_s: f32,
        posture_error: f32,
    ) -> Self {
        let [x_m, y_m, _, left_s] = target;
        let distance_m = libm::hypotf(x_m, y_m);
        let toward = (velocity[0] * x_m + velocity[1] * y_m) / distance_m.max(1e-6);
        Self {
            distance_m,
            left_s,
            approach_m_per_s: toward,
            speed_m_per_s: libm::hypotf(velocity[0], velocity[1]),
            yaw_rate_rad_per_s,
            posture_error,
        }
    }

    /// The value of a term, before its weight; 0 of one that has nothing to do with targets.
    ///
    /// | term | value |
    /// |---|---|
    /// | `target` | 1/(1 + (d/`half_m`)²) while less than `window_s` is left, else 0 |
    /// | `target_approach` | v·e/`approach_m_per_s` within ±1, e pointing to the target, farther than `near_m` |
    /// | `target_waiting` | 1 slower than `waiting_m_per_s` and farther than `near_m` |
    /// | `target_motion` | \|vₓᵧ\|² + ω² within `near_m`, (m/s)² + (rad/s)² |
    /// | `target_posture` | Σ (q − q₀)² within `near_m`, q₀ the stand, rad² |
    ///
    /// # Source
    /// Rudin et al., *Advanced skills by learning locomotion and local navigation end-to-end*, IROS 2022,
    /// sections III-B and III-C. Theirs of the approach is the cosine alone, which is as good for crawling;
    /// ours adds up to the way made and needs no switching off.
    pub(super) fn value(&self, term: RewardTerm, rules: &TargetReward) -> f32 {
        let is_near = self.distance_m <= rules.near_m;
        let is_in_window = self.left_s <= rules.window_s;
        let only = |here: bool, value: f32| if here { value } else { 0.0 };
        match term {
            RewardTerm::Target => {
                let share = self.distance_m / rules.half_m;
                only(is_in_window, 1.0 / (1.0 + share * share))
            }
            RewardTerm::TargetApproach => {
                only(!is_near, (self.approach_m_per_s / rules.approach_m_per_s).clamp(-1.0, 1.0))
            }
            RewardTerm::TargetWaiting => only(!is_near && self.speed_m_per_s < rules.waiting_m_per_s, 1.0),
            RewardTerm::TargetMotion => {
                let (speed, yaw_rate) = (self.speed_m_per_s, self.yaw_rate_rad_per_s);
                only(is_near, speed * speed + yaw_rate * yaw_rate)
            }
            RewardTerm::TargetPosture => only(is_near, self.posture_error),
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULES: TargetReward =
        TargetReward { window_s: 1.0, half_m: 0.5, near_m: 0.2, approach_m_per_s: 0.4, waiting_m_per_s: 0.1 };

    /// 0.3 m ahead and 0.4 m to the left, 0.6 m/s forward.
    fn on_the_way(left_s: f32) -> Aim {
        Aim::new([0.3, 0.4, 0.1, left_s], [0.6, 0.0], 0.5, 0.8)
    }

    #[test]
    fn being_there_counts_towards_the_end_alone() {
        let value = |left_s: f32| on_the_way(left_s).value(RewardTerm::Target, &RULES);
        assert_eq!(value(1.1), 0.0);
        assert!((value(0.9) - 0.5).abs() < 1e-6, "half at {} m: {}", RULES.half_m, value(0.9));
        let there = Aim::new([0.0, 0.0, 0.0, 0.0], [0.0; 2], 0.0, 0.0);
        assert_eq!(there.value(RewardTerm::Target, &RULES), 1.0);
    }

    #[test]
    fn the_way_counts_as_far_as_it_leads_there_and_no_faster_than_wanted() {
        let toward = |velocity: [f32; 2]| {
            Aim::new([0.3, 0.4, 0.0, 5.0], velocity, 0.0, 0.0).value(RewardTerm::TargetApproach, &RULES)
        };
        // 0.6·0.3/0.5 = 0.36 m/s of the 0.4 m/s wanted.
        assert!((toward([0.6, 0.0]) - 0.9).abs() < 1e-5, "{}", toward([0.6, 0.0]));
        assert_eq!((toward([3.0, 4.0]), toward([-3.0, -4.0])), (1.0, -1.0));
        assert!(toward([0.8, -0.6]).abs() < 1e-6, "across");
        assert_eq!(on_the_way(5.0).value(RewardTerm::TargetWaiting, &RULES), 0.0);
        let still = Aim::new([0.3, 0.4, 0.0, 5.0], [0.05, 0.0], 0.0, 0.0);
        assert_eq!(still.value(RewardTerm::TargetWaiting, &RULES), 1.0);
    }

    #[test]
    fn at_the_target_a_robot_rests_and_nothing_drives_it_on() {
        let there = Aim::new([0.1, -0.1, 0.0, 5.0], [0.3, -0.4], 0.5, 0.8);
        for (term, wanted) in [
            (RewardTerm::TargetApproach, 0.0),
            (RewardTerm::TargetWaiting, 0.0),
            (RewardTerm::TargetMotion, 0.5),
            (RewardTerm::TargetPosture, 0.8),
        ] {
            let found = there.value(term, &RULES);
            assert!((found - wanted).abs() < 1e-6, "{term:?}: {found}, wanted {wanted}");
        }
        assert_eq!(on_the_way(5.0).value(RewardTerm::TargetMotion, &RULES), 0.0, "it may move on the way");
        assert_eq!(on_the_way(5.0).value(RewardTerm::TargetPosture, &RULES), 0.0);
    }

    #[test]
    fn a_distance_of_nan_is_worth_nothing_but_nan() {
        let lost = Aim::new([f32::NAN, 0.0, 0.0, 0.0], [0.0; 2], 0.0, 0.0);
        assert!(lost.value(RewardTerm::Target, &RULES).is_nan());
    }
}
