//! What a collection depends on, besides robot and skill.

use serde::{Deserialize, Serialize};

use super::Mixture;
use crate::{
    dataset::Kind,
    driver::SensorNoise,
    plant::PlantKind,
    rollout::{Perturbations, RolloutRules},
    spawn::SpawnRules,
};

/// The canonical configuration of a collection, written whole into `meta.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CollectConfig {
    /// Seed of every stream.
    pub seed: u64,
    /// Rollouts from each pose; 1 for cost of transport.
    pub repeats: u32,
    /// Which plant.
    pub plant: PlantKind,
    /// Half-width of the uniform noise on the predictors' field, m.
    pub field_noise_m: f32,
    /// Half-width of the uniform noise on the plugin's terrain patch, m.
    pub patch_noise_m: f32,
    /// What differs between the rollouts of a pose.
    pub perturb: Perturbations,
    /// Poses.
    pub spawn: SpawnRules,
    /// Rollouts.
    pub rollout: RolloutRules,
    /// Share of the rows that start where a rollout of the skill's own had the robot; none if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own_starts_share: Option<f32>,
    /// Share of the rows that begin there in stride: the rollout has come there and goes on; none if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_stride_share: Option<f32>,
    /// Terrains.
    pub mixture: Mixture,
}

impl CollectConfig {
    /// docs/method.md: ten rollouts a pose for viability, one for cost of transport.
    pub fn new(kind: Kind, seed: u64) -> Self {
        Self {
            seed,
            repeats: if kind == Kind::Viability { 10 } else { 1 },
            plant: PlantKind::Reference,
            field_noise_m: 0.1,
            patch_noise_m: 0.02,
            perturb: Perturbations::protocol(),
            spawn: SpawnRules::default(),
            rollout: RolloutRules::default(),
            own_starts_share: None,
            in_stride_share: None,
            mixture: Mixture::default(),
        }
    }

    /// The same with a skill's own horizon, time limit and starts, from its manifest.
    #[must_use]
    pub fn for_skill(mut self, rollout: &vocaloco_core::manifest::Rollout) -> Self {
        self.rollout.horizon_m = rollout.horizon_m;
        self.rollout.time_limit_s = rollout.time_limit_s;
        let share = |share: f64| (share > 0.0).then_some(share as f32);
        self.own_starts_share = share(rollout.own_starts_share);
        self.in_stride_share = share(rollout.in_stride_share);
        self
    }

    /// Noise on what the plugin measures.
    pub fn sensor_noise(&self) -> SensorNoise {
        SensorNoise { patch_m: self.patch_noise_m, ..SensorNoise::default() }
    }
}
