//! What is rewarded: named terms of what one policy tick did, each with a weight.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::config::{ConfigError, inside};
use crate::driver::TICK_S;

/// A term of the reward; its value is defined by `Deed::value`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "the table of Deed::value says it once")]
pub enum RewardTerm {
    LinearVelocity,
    YawRate,
    Heading,
    VerticalVelocity,
    RollPitchRate,
    Orientation,
    BaseHeight,
    Torque,
    JointAcceleration,
    JointOverspeed,
    ActionRate,
    Power,
    FootAirTime,
    FootStumble,
    LimbCollision,
    Alive,
}

impl RewardTerm {
    /// Every term, in the order of the records, with its id and default weight.
    ///
    /// # Source
    /// `legged_gym` (METHOD, section 7); heading, overspeed, power and stumbling are ours.
    pub const ALL: [(Self, &'static str, f32); 16] = [
        (Self::LinearVelocity, "linear_velocity", 1.0),
        (Self::YawRate, "yaw_rate", 0.5),
        (Self::Heading, "heading", 0.0),
        (Self::VerticalVelocity, "vertical_velocity", -2.0),
        (Self::RollPitchRate, "roll_pitch_rate", -0.05),
        (Self::Orientation, "orientation", 0.0),
        (Self::BaseHeight, "base_height", 0.0),
        (Self::Torque, "torque", -1e-5),
        (Self::JointAcceleration, "joint_acceleration", -2.5e-7),
        (Self::JointOverspeed, "joint_overspeed", -0.2),
        (Self::ActionRate, "action_rate", -0.01),
        (Self::Power, "power", -0.5),
        (Self::FootAirTime, "foot_air_time", 1.0),
        (Self::FootStumble, "foot_stumble", -0.2),
        (Self::LimbCollision, "limb_collision", -1.0),
        (Self::Alive, "alive", 0.0),
    ];
}

/// Weights of all terms; in TOML a table by name, in which what is left out has its default.
#[derive(Clone, Debug, PartialEq)]
pub struct RewardWeights(BTreeMap<RewardTerm, f32>);

impl RewardWeights {
    /// Weight of a term.
    pub fn of(&self, term: RewardTerm) -> f32 {
        self.0.get(&term).copied().unwrap_or(0.0)
    }

    /// The same with another weight for a term.
    #[must_use]
    pub fn with(mut self, term: RewardTerm, weight: f32) -> Self {
        self.0.insert(term, weight);
        self
    }
}

impl Default for RewardWeights {
    fn default() -> Self {
        Self(RewardTerm::ALL.into_iter().map(|(term, _, weight)| (term, weight)).collect())
    }
}

impl Serialize for RewardWeights {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for RewardWeights {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let given = BTreeMap::<RewardTerm, f32>::deserialize(deserializer)?;
        let mut weights = Self::default();
        weights.0.extend(given);
        Ok(weights)
    }
}

/// How a tick's terms become its reward.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RewardConfig {
    /// σ of the velocity terms, (m/s)² and (rad/s)²: larger forgives more.
    pub tracking_sigma: f32,
    /// Time in the air that a step is worth nothing, s: longer ones are rewarded.
    pub air_time_s: f32,
    /// Negative totals count as 0, termination excepted.
    pub clip_negative: bool,
    /// Added once when an episode ends in a fall; no time step in it.
    pub termination: f32,
    /// Weight of every term, 1/s.
    pub weights: RewardWeights,
}

impl Default for RewardConfig {
    fn default() -> Self {
        Self {
            tracking_sigma: 0.25,
            air_time_s: 0.5,
            clip_negative: true,
            termination: -1.0,
            weights: RewardWeights::default(),
        }
    }
}

/// What one policy tick did. "Mean" is over its physics steps.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Deed {
    /// Commanded forward m/s, left m/s, yaw rate rad/s, at the tick's start.
    pub(super) command: [f32; 3],
    /// Forward and left, m/s, yaw-aligned, at the tick's end.
    pub(super) velocity_in_yaw: [f32; 2],
    /// Along the base's z axis, m/s, at the tick's end.
    pub(super) vertical_m_per_s: f32,
    /// In the base frame, rad/s, at the tick's end.
    pub(super) angular_velocity: [f32; 3],
    pub(super) heading_error_rad: f32,
    pub(super) projected_gravity: [f32; 3],
    /// Of the base above the ground, less the stand's.
    pub(super) height_error_m: f32,
    /// Mean of Σ τ².
    pub(super) torque_squared: f32,
    /// Σ ((q̇ − q̇ of the tick before)/Δt)².
    pub(super) joint_acceleration_squared: f32,
    /// Mean of Σ max(0, |q̇| − limit).
    pub(super) overspeed_rad_per_s: f32,
    /// Σ (a − a of the tick before)².
    pub(super) action_change_squared: f32,
    /// Positive mechanical power per weight of the robot, m/s: cost of transport times speed.
    pub(super) power_per_weight: f32,
    /// Σ over feet that landed of (time in the air − `air_time_s`).
    pub(super) air_time_s: f32,
    /// Feet that pressed on a riser in any of the physics steps.
    pub(super) stumbles: f32,
    /// Share of the physics steps in which hip, thigh or shank touched something.
    pub(super) limb_contact_share: f32,
}

impl Deed {
    /// The value of a term, before its weight.
    ///
    /// | term | value |
    /// |---|---|
    /// | `linear_velocity` | exp(−\|v*ₓᵧ − vₓᵧ\|²/σ), v yaw-aligned |
    /// | `yaw_rate` | exp(−(ω*_z − ω_z)²/σ) |
    /// | `heading` | ψ² with the heading error ψ, rad² |
    /// | `vertical_velocity` | v_z², (m/s)² |
    /// | `roll_pitch_rate` | ωₓ² + ωᵧ², (rad/s)² |
    /// | `orientation` | gₓ² + gᵧ² of the projected gravity |
    /// | `base_height` | (h − h_stand)² over the ground, m² |
    /// | `torque` | Σ τ², (N·m)² |
    /// | `joint_acceleration` | Σ q̈², (rad/s²)² |
    /// | `joint_overspeed` | Σ max(0, \|q̇\| − limit), rad/s |
    /// | `action_rate` | Σ (a − a')² |
    /// | `power` | Σ max(0, τ·q̇)/(m·g), m/s |
    /// | `foot_air_time` | Σ_landing (t_air − `air_time_s`), s |
    /// | `foot_stumble` | feet pressing on a riser |
    /// | `limb_collision` | share of the tick with a contact of hip, thigh or shank |
    /// | `alive` | 1 |
    pub(super) fn value(&self, term: RewardTerm, sigma: f32) -> f32 {
        let [roll_rate, pitch_rate, yaw_rate] = self.angular_velocity;
        match term {
            RewardTerm::LinearVelocity => {
                let error = squared(self.command[0] - self.velocity_in_yaw[0])
                    + squared(self.command[1] - self.velocity_in_yaw[1]);
                libm::expf(-error / sigma)
            }
            RewardTerm::YawRate => libm::expf(-squared(self.command[2] - yaw_rate) / sigma),
            RewardTerm::Heading => squared(self.heading_error_rad),
            RewardTerm::VerticalVelocity => squared(self.vertical_m_per_s),
            RewardTerm::RollPitchRate => squared(roll_rate) + squared(pitch_rate),
            RewardTerm::Orientation => {
                squared(self.projected_gravity[0]) + squared(self.projected_gravity[1])
            }
            RewardTerm::BaseHeight => squared(self.height_error_m),
            RewardTerm::Torque => self.torque_squared,
            RewardTerm::JointAcceleration => self.joint_acceleration_squared,
            RewardTerm::JointOverspeed => self.overspeed_rad_per_s,
            RewardTerm::ActionRate => self.action_change_squared,
            RewardTerm::Power => self.power_per_weight,
            RewardTerm::FootAirTime => self.air_time_s,
            RewardTerm::FootStumble => self.stumbles,
            RewardTerm::LimbCollision => self.limb_contact_share,
            RewardTerm::Alive => 1.0,
        }
    }
}

fn squared(value: f32) -> f32 {
    value * value
}

/// Turns deeds into rewards, and keeps the terms of the latest.
#[derive(Clone, Debug)]
pub(super) struct Judge {
    sigma: f32,
    clip_negative: bool,
    termination: f32,
    /// Each term's weight, times the tick's length; 0 skips it.
    weights: [(RewardTerm, f32); RewardTerm::ALL.len()],
    /// As [`terms`](Self::terms) gives them.
    terms: Vec<(&'static str, f32)>,
}

impl Judge {
    pub(super) fn new(config: &RewardConfig) -> Self {
        let names = RewardTerm::ALL.iter().map(|(_, id, _)| *id).chain(["termination"]);
        Self {
            sigma: config.tracking_sigma,
            clip_negative: config.clip_negative,
            termination: config.termination,
            weights: RewardTerm::ALL.map(|(term, _, _)| (term, config.weights.of(term) * TICK_S as f32)),
            terms: names.map(|id| (id, 0.0)).collect(),
        }
    }

    /// The reward of a tick:
    ///
    /// ```text
    /// max(0, Σ_term weight·value·Δt) + termination·[fell]
    /// ```
    pub(super) fn reward(&mut self, deed: &Deed, fell: bool) -> f32 {
        let mut total = 0.0;
        for ((term, weight), (_, out)) in self.weights.iter().zip(&mut self.terms) {
            *out = if *weight == 0.0 { 0.0 } else { weight * deed.value(*term, self.sigma) };
            total += *out;
        }
        let ending = if fell { self.termination } else { 0.0 };
        if let Some((_, out)) = self.terms.last_mut() {
            *out = ending;
        }
        // Written so that NaN is not taken for 0.
        if self.clip_negative && total < 0.0 { ending } else { total + ending }
    }

    /// The latest tick's terms by id, times weight and time step, and what the ending added.
    pub(super) fn terms(&self) -> &[(&'static str, f32)] {
        &self.terms
    }
}

impl RewardConfig {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        inside("reward.tracking_sigma", self.tracking_sigma, 1e-3..=10.0)?;
        inside("reward.air_time_s", self.air_time_s, 0.0..=2.0)?;
        inside("reward.termination", self.termination, -1000.0..=0.0)?;
        for (term, id, _) in RewardTerm::ALL {
            inside(format!("reward.weights.{id}"), self.weights.of(term), -1000.0..=1000.0)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No two numbers alike.
    fn deed() -> Deed {
        Deed {
            command: [0.6, 0.0, 0.2],
            velocity_in_yaw: [0.3, 0.4],
            vertical_m_per_s: -0.5,
            angular_velocity: [1.0, 2.0, 0.7],
            heading_error_rad: -0.3,
            projected_gravity: [0.1, -0.2, -0.97],
            height_error_m: -0.04,
            torque_squared: 1000.0,
            joint_acceleration_squared: 4e4,
            overspeed_rad_per_s: 1.5,
            action_change_squared: 0.8,
            power_per_weight: 0.12,
            air_time_s: -0.2,
            stumbles: 2.0,
            limb_contact_share: 0.25,
        }
    }

    #[test]
    fn every_term_is_its_formula() {
        let wanted: [(RewardTerm, f32); 16] = [
            // |(0.3, −0.4)|² = 0.25, over σ = 0.5.
            (RewardTerm::LinearVelocity, (-0.5_f32).exp()),
            (RewardTerm::YawRate, (-0.5_f32).exp()),
            (RewardTerm::Heading, 0.09),
            (RewardTerm::VerticalVelocity, 0.25),
            (RewardTerm::RollPitchRate, 5.0),
            (RewardTerm::Orientation, 0.05),
            (RewardTerm::BaseHeight, 0.0016),
            (RewardTerm::Torque, 1000.0),
            (RewardTerm::JointAcceleration, 4e4),
            (RewardTerm::JointOverspeed, 1.5),
            (RewardTerm::ActionRate, 0.8),
            (RewardTerm::Power, 0.12),
            (RewardTerm::FootAirTime, -0.2),
            (RewardTerm::FootStumble, 2.0),
            (RewardTerm::LimbCollision, 0.25),
            (RewardTerm::Alive, 1.0),
        ];
        for (term, wanted) in wanted {
            let found = deed().value(term, 0.5);
            assert!((found - wanted).abs() <= 1e-5 * wanted.abs(), "{term:?}: {found}, wanted {wanted}");
        }
    }

    #[test]
    fn a_reward_is_the_sum_of_its_terms_times_weight_and_time_step() {
        let config = RewardConfig { clip_negative: false, ..RewardConfig::default() };
        let mut judge = Judge::new(&config);
        let reward = judge.reward(&deed(), false);
        let wanted: f32 =
            RewardTerm::ALL.iter().map(|(term, _, weight)| weight * deed().value(*term, 0.25) * 0.02).sum();
        assert!((reward - wanted).abs() < 1e-6, "{reward}, wanted {wanted}");
        let sum: f32 = judge.terms().iter().map(|(_, value)| value).sum();
        assert!((reward - sum).abs() < 1e-6);
        let names: Vec<&str> = judge.terms().iter().map(|(id, _)| *id).collect();
        assert_eq!((names[0], names[16]), ("linear_velocity", "termination"));
    }

    #[test]
    fn a_negative_total_is_clipped_but_a_fall_still_costs() {
        let bad = Deed { vertical_m_per_s: 3.0, ..deed() };
        let mut judge = Judge::new(&RewardConfig::default());
        assert_eq!(judge.reward(&bad, false), 0.0);
        assert_eq!(judge.reward(&bad, true), -1.0);
        assert_eq!(judge.terms()[16], ("termination", -1.0));
        let mut judge = Judge::new(&RewardConfig { clip_negative: false, ..RewardConfig::default() });
        assert!(judge.reward(&bad, false) < -0.2);
    }

    #[test]
    fn a_measurement_of_nan_is_not_taken_for_a_reward_of_zero() {
        let mut judge = Judge::new(&RewardConfig::default());
        assert!(judge.reward(&Deed { vertical_m_per_s: f32::NAN, ..deed() }, false).is_nan());
    }

    #[test]
    fn weights_left_out_keep_their_defaults_and_unknown_ones_are_refused() {
        let config: RewardConfig = toml::from_str("[weights]\npower = -2.0").unwrap();
        assert_eq!(config.weights, RewardWeights::default().with(RewardTerm::Power, -2.0));
        let refused = toml::from_str::<RewardConfig>("[weights]\npowr = -2.0").unwrap_err();
        assert!(refused.to_string().contains("powr"), "{refused}");
    }

    #[test]
    fn the_ids_are_those_of_the_file() {
        for (term, id, _) in RewardTerm::ALL {
            assert_eq!(serde_json::to_string(&term).unwrap(), format!("\"{id}\""));
        }
    }
}
