//! What is rewarded: named terms of what one policy tick did, each with a weight.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::config::{ConfigError, inside};
use super::target::{Aim, TargetReward};
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
    BaseCollision,
    Target,
    TargetApproach,
    TargetWaiting,
    TargetMotion,
    TargetPosture,
}

/// How many of [`RewardTerm::ALL`] stand in every record; the others do where they have a weight.
const ALWAYS: usize = 16;

impl RewardTerm {
    /// Every term, in the order of the records, with its id and default weight.
    ///
    /// # Source
    /// `legged_gym` (docs/method.md); heading, overspeed, power, stumbling and base collision are ours,
    /// targets after Rudin et al. (2022).
    pub const ALL: [(Self, &'static str, f32); 22] = [
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
        (Self::BaseCollision, "base_collision", 0.0),
        (Self::Target, "target", 0.0),
        (Self::TargetApproach, "target_approach", 0.0),
        (Self::TargetWaiting, "target_waiting", 0.0),
        (Self::TargetMotion, "target_motion", 0.0),
        (Self::TargetPosture, "target_posture", 0.0),
    ];

    /// Whether a term of this weight stands in records.
    fn is_recorded(self, weight: f32) -> bool {
        weight != 0.0 || Self::ALL[..ALWAYS].iter().any(|(term, ..)| *term == self)
    }
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
        serializer.collect_map(self.0.iter().filter(|(term, weight)| term.is_recorded(**weight)))
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
    /// When and how sharply position targets are rewarded.
    #[serde(skip_serializing_if = "TargetReward::is_default")]
    pub target: TargetReward,
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
            target: TargetReward::default(),
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
    /// Share of the physics steps in which the base touched something.
    pub(super) base_contact_share: f32,
    /// Where it is on its way, if it goes to a target.
    pub(super) aim: Option<Aim>,
}

/// What the values of terms are measured by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scales {
    /// σ of the velocity terms.
    pub(super) sigma: f32,
    /// Of the target terms.
    pub(super) target: TargetReward,
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
    /// | `base_collision` | share of the tick with a contact of the base |
    /// | `target` and what begins so | as [`Aim::value`] says |
    pub(super) fn value(&self, term: RewardTerm, scales: &Scales) -> f32 {
        let sigma = scales.sigma;
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
            RewardTerm::BaseCollision => self.base_contact_share,
            RewardTerm::Target
            | RewardTerm::TargetApproach
            | RewardTerm::TargetWaiting
            | RewardTerm::TargetMotion
            | RewardTerm::TargetPosture => self.aim.map_or(0.0, |aim| aim.value(term, &scales.target)),
        }
    }
}

fn squared(value: f32) -> f32 {
    value * value
}

/// Turns deeds into rewards, and keeps the terms of the latest.
#[derive(Clone, Debug)]
pub(super) struct Judge {
    scales: Scales,
    clip_negative: bool,
    termination: f32,
    /// The weight of each term that is recorded, times the tick's length; 0 skips it.
    weights: Vec<(RewardTerm, f32)>,
    /// As [`terms`](Self::terms) gives them.
    terms: Vec<(&'static str, f32)>,
}

impl Judge {
    pub(super) fn new(config: &RewardConfig) -> Self {
        let weight = |term: RewardTerm| config.weights.of(term);
        let recorded = || RewardTerm::ALL.iter().filter(|(term, ..)| term.is_recorded(weight(*term)));
        let names = recorded().map(|(_, id, _)| *id).chain(["termination"]);
        Self {
            scales: Scales { sigma: config.tracking_sigma, target: config.target },
            clip_negative: config.clip_negative,
            termination: config.termination,
            weights: recorded().map(|(term, ..)| (*term, weight(*term) * TICK_S as f32)).collect(),
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
            *out = if *weight == 0.0 { 0.0 } else { weight * deed.value(*term, &self.scales) };
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
        self.target.check()?;
        for (term, id, _) in RewardTerm::ALL {
            inside(format!("reward.weights.{id}"), self.weights.of(term), -1000.0..=1000.0)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
