//! How much is measured: the paper's numbers, or enough of each kind to look at within minutes.

use serde::Serialize;

/// Sizes and counts of every experiment.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Plan {
    /// Whether this is the short version.
    pub(super) quick: bool,
    pub(super) seed: u64,
    /// Step heights of predictions and of success rates, m.
    pub(super) sizes_m: Vec<f32>,
    /// Fresh poses a skill, terrain and height.
    pub(super) samples: u64,
    /// Rollouts a course, height and selector.
    pub(super) rollouts: u64,
    /// The same of the deployment whose thresholds promise something: shares of 1 % take more.
    pub(super) promised_rollouts: u64,
    /// Steps of a flight, as in the success rates.
    pub(super) steps: usize,
    /// Step heights of the course that mixes flat and stairs, m.
    pub(super) mixed_sizes_m: Vec<f32>,
    /// Step height of the demo's staircases, m, and their steps.
    pub(super) demo_size_m: f32,
    pub(super) demo_steps: usize,
    /// Step height that no skill takes, m.
    pub(super) wall_size_m: f32,
    /// Windows compared, ticks, on stairs of these heights, m.
    pub(super) windows: Vec<usize>,
    pub(super) window_sizes_m: Vec<f32>,
    /// Horizons compared, m, on stairs of these heights, m, with as many poses a skill, terrain and height.
    pub(super) horizons_m: Vec<f32>,
    pub(super) horizon_sizes_m: Vec<f32>,
    pub(super) horizon_samples: u64,
    /// Thresholds compared, on stairs of these heights, m.
    pub(super) thresholds: Vec<f32>,
    pub(super) threshold_sizes_m: Vec<f32>,
    /// Heights on which fields are seen by cameras, m.
    pub(super) camera_sizes_m: Vec<f32>,
    /// Rollouts a variant and height.
    pub(super) ablation_rollouts: u64,
}

impl Plan {
    /// As in docs/method.md.
    pub(super) fn full(seed: u64) -> Self {
        Self {
            quick: false,
            seed,
            // As the decimals read: commands that name them then find what stands.
            sizes_m: (1..=16).map(|step| (step * 25) as f32 / 1000.0).collect(),
            samples: 500,
            rollouts: 100,
            promised_rollouts: 300,
            steps: 6,
            mixed_sizes_m: vec![0.05, 0.1, 0.15],
            demo_size_m: 0.12,
            demo_steps: 3,
            wall_size_m: 0.4,
            windows: vec![1, 5, 10, 20],
            window_sizes_m: vec![0.1, 0.15, 0.2],
            horizons_m: vec![0.75, 1.5, 2.5],
            horizon_sizes_m: vec![0.1, 0.2, 0.3],
            horizon_samples: 100,
            thresholds: vec![0.5, 0.7, 0.8, 0.9, 0.95, 0.975, 0.99],
            threshold_sizes_m: vec![0.05, 0.1, 0.15, 0.25, 0.3, 0.35, 0.4],
            camera_sizes_m: vec![0.1, 0.15, 0.2, 0.3, 0.4],
            ablation_rollouts: 50,
        }
    }

    /// A few rollouts of everything: for the curious, and to see that all of it works.
    pub(super) fn quick(seed: u64) -> Self {
        Self {
            quick: true,
            sizes_m: vec![0.1, 0.2, 0.3, 0.4],
            samples: 8,
            rollouts: 2,
            promised_rollouts: 2,
            mixed_sizes_m: vec![0.1],
            windows: vec![1, 10, 20],
            window_sizes_m: vec![0.1],
            horizons_m: vec![0.75, 1.5],
            horizon_sizes_m: vec![0.2],
            thresholds: vec![0.5, 0.9, 0.99],
            threshold_sizes_m: vec![0.1, 0.4],
            camera_sizes_m: vec![0.15],
            ablation_rollouts: 2,
            ..Self::full(seed)
        }
    }

    /// The same with other counts, where they are given.
    pub(super) fn with_counts(mut self, rollouts: Option<u64>, samples: Option<u64>) -> Self {
        if let Some(rollouts) = rollouts {
            self.rollouts = rollouts;
            self.promised_rollouts = self.promised_rollouts.min(3 * rollouts);
            self.ablation_rollouts = self.ablation_rollouts.min(rollouts);
        }
        self.samples = samples.unwrap_or(self.samples);
        self.horizon_samples = self.horizon_samples.min(self.samples);
        self
    }
}
