//! Proximal policy optimisation: one update from the steps of all environments.
//!
//! # Source
//! Schulman et al., *Proximal policy optimization algorithms*, 2017; clipped value loss and the learning
//! rate's rule as in Rudin et al., *Learning to walk in minutes*, `CoRL` 2021.

use rayon::prelude::*;
use vocaloco_sim::stream::stream;

use super::adam::clipping;
use super::advantage::{Trace, advantages};
use super::config::PpoConfig;
use super::descent::{Descent, Loss, values};
use super::gaussian::Spread;
use super::learner::Learner;
use super::normaliser::Scaling;
use super::shuffle::shuffled;
use super::track::Track;

/// What an update says of itself: means over its steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct UpdateRecord {
    /// Divergence from the policy that drove.
    pub divergence: f64,
    /// Clipped surrogate loss.
    pub surrogate_loss: f64,
    /// Clipped value loss.
    pub value_loss: f64,
    /// Share of samples whose ratio was clipped.
    pub clipped_share: f64,
    /// Squared distance to the expert's action, where one is asked.
    pub imitation_loss: f64,
}

/// What an update does besides its configuration.
#[derive(Clone, Copy, Debug)]
pub struct Turn {
    /// The run's seed.
    pub seed: u64,
    /// Weight of the squared distance to the expert's action; 0 where none was asked.
    pub imitation: f32,
    /// Whether the policy is fitted; else the critic alone, and the learning rate stays.
    pub fits_policy: bool,
    /// Standard deviation that exploration keeps at least.
    pub least_std: f32,
}

/// Room for the gradients of both networks.
pub struct Ppo {
    policy: Descent,
    value: Descent,
}

/// The learning rate after an update that moved the policy by `divergence`.
///
/// ```text
/// divergence > 2·desired: rate / 1.5      divergence < desired/2: rate · 1.5      within 1e-5 … 1e-2
/// ```
pub fn adapted_rate(rate: f32, divergence: f32, desired: f32) -> f32 {
    if divergence > 2.0 * desired {
        (rate / 1.5).max(1e-5)
    } else if divergence < 0.5 * desired && divergence > 0.0 {
        (rate * 1.5).min(1e-2)
    } else {
        rate
    }
}

/// Loss of a probability ratio and its derivative by `ln p`.
///
/// ```text
/// L = max(−A·r, −A·clip(r, 1−ε, 1+ε))        dL/d ln p = −A·r where the first is the larger, else 0
/// ```
pub fn surrogate(ratio: f32, advantage: f32, clip: f32) -> (f32, f32) {
    let free = -advantage * ratio;
    let clipped = -advantage * ratio.clamp(1.0 - clip, 1.0 + clip);
    if free >= clipped { (free, free) } else { (clipped, 0.0) }
}

/// Loss of a value and its derivative by it.
///
/// ```text
/// L = max((V − R)², (V₀ + clip(V − V₀, ±ε) − R)²)
/// ```
pub fn clipped_value_loss(value: f32, old: f32, target: f32, clip: f32) -> (f32, f32) {
    let moved = value - old;
    let free = value - target;
    let clipped = old + moved.clamp(-clip, clip) - target;
    if free * free >= clipped * clipped {
        (free * free, 2.0 * free)
    } else if moved.abs() < clip {
        (clipped * clipped, 2.0 * clipped)
    } else {
        (clipped * clipped, 0.0)
    }
}

struct PolicyLoss<'a> {
    tracks: &'a [Track],
    steps: usize,
    scaling: &'a Scaling,
    spread: Spread<'a>,
    old_spread: Spread<'a>,
    advantages: &'a [f32],
    clip: f32,
    imitation: f32,
    share: f32,
}

/// Places in the sums of [`PolicyLoss`]; `ln σ`'s derivatives follow.
const DIVERGENCE: usize = 0;
const SURROGATE: usize = 1;
const CLIPPED: usize = 2;
const IMITATION: usize = 3;
const BY_LOG_STD: usize = 4;

impl Loss for PolicyLoss<'_> {
    fn sums(&self) -> usize {
        BY_LOG_STD + self.spread.log_std.len()
    }

    fn input(&self, row: usize, input: &mut [f32]) {
        let (track, step) = (&self.tracks[row / self.steps], row % self.steps);
        input.copy_from_slice(&track.observation[step * input.len()..][..input.len()]);
        self.scaling.apply(input);
    }

    fn derivative(&self, row: usize, mean: &[f32], by_mean: &mut [f32], sums: &mut [f64]) {
        let (track, step) = (&self.tracks[row / self.steps], row % self.steps);
        let own = step * mean.len()..(step + 1) * mean.len();
        let (action, old_mean) = (&track.action[own.clone()], &track.mean[own.clone()]);
        let ratio = libm::expf(self.spread.log_probability(mean, action) - track.log_probability[step]);
        let (loss, by_log_p) = surrogate(ratio, self.advantages[row], self.clip);
        sums[DIVERGENCE] += f64::from(self.spread.divergence_from(self.old_spread, old_mean, mean));
        sums[SURROGATE] += f64::from(loss);
        sums[CLIPPED] += f64::from(u8::from((ratio - 1.0).abs() > self.clip));
        for at in 0..mean.len() {
            let precision = libm::expf(-2.0 * self.spread.log_std[at]);
            let distance = action[at] - mean[at];
            by_mean[at] = self.share * by_log_p * distance * precision;
            sums[BY_LOG_STD + at] +=
                f64::from(self.share * by_log_p * (distance * distance * precision - 1.0));
        }
        if self.imitation > 0.0 {
            let expert = &track.expert[own];
            let weight = 1.0 / mean.len() as f32;
            for at in 0..mean.len() {
                let distance = mean[at] - expert[at];
                sums[IMITATION] += f64::from(weight * distance * distance);
                by_mean[at] += self.share * self.imitation * weight * 2.0 * distance;
            }
        }
    }
}

struct ValueLoss<'a> {
    /// `[row][value]`, without the state after the last step.
    privileged: &'a [f32],
    scaling: &'a Scaling,
    old: &'a [f32],
    targets: &'a [f32],
    clip: f32,
    weight: f32,
}

impl Loss for ValueLoss<'_> {
    fn sums(&self) -> usize {
        1
    }

    fn input(&self, row: usize, input: &mut [f32]) {
        input.copy_from_slice(&self.privileged[row * input.len()..][..input.len()]);
        self.scaling.apply(input);
    }

    fn derivative(&self, row: usize, value: &[f32], by_value: &mut [f32], sums: &mut [f64]) {
        let (loss, by) = clipped_value_loss(value[0], self.old[row], self.targets[row], self.clip);
        sums[0] += f64::from(loss);
        by_value[0] = self.weight * by;
    }
}

/// What the critic makes of the tracks, one number per row.
struct Judged {
    privileged: Vec<f32>,
    old: Vec<f32>,
    advantages: Vec<f32>,
    targets: Vec<f32>,
}

fn judge(learner: &Learner, tracks: &[Track], config: &PpoConfig, scaling: &Scaling) -> Judged {
    let width = learner.critic.inputs();
    let judged: Vec<_> = tracks
        .par_iter()
        .map(|track| {
            let mut rows: Vec<f32> = track.privileged.iter().chain(&track.timed_out).copied().collect();
            rows.chunks_exact_mut(width).for_each(|row| scaling.apply(row));
            let all = values(&learner.critic, &learner.value, &rows);
            let (values, timed_out_values) = all.split_at(track.reward.len() + 1);
            let trace = Trace { rewards: &track.reward, ends: &track.ends, values, timed_out_values };
            let advantages = advantages(trace, config.discount, config.trace_decay);
            (values[..track.reward.len()].to_vec(), advantages)
        })
        .collect();
    let mut all =
        Judged { privileged: Vec::new(), old: Vec::new(), advantages: Vec::new(), targets: Vec::new() };
    for (track, (values, advantages)) in tracks.iter().zip(judged) {
        all.privileged.extend_from_slice(&track.privileged[..track.reward.len() * width]);
        all.targets.extend(values.iter().zip(&advantages).map(|(value, advantage)| value + advantage));
        all.old.extend(values);
        all.advantages.extend(advantages);
    }
    standardise(&mut all.advantages);
    all
}

/// `x ← (x − mean) / (standard deviation + 1e-8)`.
fn standardise(values: &mut [f32]) {
    let count = values.len() as f64;
    let mean = values.iter().map(|x| f64::from(*x)).sum::<f64>() / count;
    let variance = values.iter().map(|x| (f64::from(*x) - mean).powi(2)).sum::<f64>() / count;
    let factor = 1.0 / (variance.sqrt() + 1e-8);
    for value in values {
        *value = ((f64::from(*value) - mean) * factor) as f32;
    }
}

impl Ppo {
    /// Room for the learner's networks.
    pub fn new(learner: &Learner) -> Self {
        Self { policy: Descent::new(learner.actor.clone()), value: Descent::new(learner.critic.clone()) }
    }

    /// One update from tracks of `config.steps` steps each.
    pub fn update(
        &mut self,
        learner: &mut Learner,
        tracks: &[Track],
        config: &PpoConfig,
        turn: Turn,
    ) -> UpdateRecord {
        let scalings = [learner.observation.scaling(), learner.privileged.scaling()];
        let judged = judge(learner, tracks, config, &scalings[1]);
        let weights = learner.actor.parameters();
        let old_log_std = learner.spread().log_std.to_vec();
        let mut record = UpdateRecord::default();
        let mut by_policy = vec![0.0; learner.policy.len()];
        let rows = judged.old.len();
        let updates = config.epochs * config.minibatches as u64;
        for epoch in 0..config.epochs {
            let mut rng = stream(turn.seed, "policy_learning/minibatches", &[learner.iteration, epoch]);
            let order = shuffled(rows, &mut rng);
            for minibatch in 0..config.minibatches {
                let batch = &order
                    [minibatch * rows / config.minibatches..(minibatch + 1) * rows / config.minibatches];
                let count = batch.len() as f64;
                if turn.fits_policy {
                    let loss = PolicyLoss {
                        tracks,
                        steps: config.steps,
                        scaling: &scalings[0],
                        spread: learner.spread(),
                        old_spread: Spread { log_std: &old_log_std },
                        advantages: &judged.advantages,
                        clip: config.clip,
                        imitation: turn.imitation,
                        share: 1.0 / batch.len() as f32,
                    };
                    let (gradient, sums) = self.policy.gradient(learner.weights(), batch, &loss);
                    by_policy[..weights].copy_from_slice(gradient);
                    for (by, sum) in by_policy[weights..].iter_mut().zip(&sums[BY_LOG_STD..]) {
                        *by = *sum as f32 - config.entropy;
                    }
                    let divergence = sums[DIVERGENCE] / count;
                    learner.learning_rate =
                        adapted_rate(learner.learning_rate, divergence as f32, config.desired_divergence);
                    record.divergence += divergence / updates as f64;
                    record.surrogate_loss += sums[SURROGATE] / count / updates as f64;
                    record.clipped_share += sums[CLIPPED] / count / updates as f64;
                    record.imitation_loss += sums[IMITATION] / count / updates as f64;
                }
                let loss = ValueLoss {
                    privileged: &judged.privileged,
                    scaling: &scalings[1],
                    old: &judged.old,
                    targets: &judged.targets,
                    clip: config.clip,
                    weight: config.value_loss / batch.len() as f32,
                };
                let (by_value, sums) = self.value.gradient(&learner.value, batch, &loss);
                record.value_loss += sums[0] / count / updates as f64;
                let scale = clipping(&[&by_policy, by_value], config.longest_gradient);
                let rate = learner.learning_rate;
                let value_rate = config.critic_learning_rate.unwrap_or(rate);
                learner.value_adam.step(&mut learner.value, by_value, scale, value_rate);
                if turn.fits_policy {
                    learner.policy_adam.step(&mut learner.policy, &by_policy, scale, rate);
                    let least = libm::logf(turn.least_std);
                    for log_std in &mut learner.policy[weights..] {
                        *log_std = log_std.max(least);
                    }
                }
            }
        }
        record
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_learning_rate_falls_when_kl_is_high() {
        assert!((adapted_rate(1e-3, 0.021, 0.01) - 1e-3 / 1.5).abs() < 1e-9);
        assert_eq!(adapted_rate(1.2e-5, 1.0, 0.01), 1e-5);
    }

    #[test]
    fn the_learning_rate_rises_when_kl_is_low_and_stays_between() {
        assert!((adapted_rate(1e-3, 0.004, 0.01) - 1.5e-3).abs() < 1e-9);
        assert_eq!(adapted_rate(9e-3, 0.004, 0.01), 1e-2);
        assert_eq!(adapted_rate(1e-3, 0.01, 0.01), 1e-3);
        // A policy that has not moved says nothing.
        assert_eq!(adapted_rate(1e-3, 0.0, 0.01), 1e-3);
    }

    #[test]
    fn a_ratio_is_clipped_only_where_it_would_gain() {
        // Better than expected and already likelier by more than ε: no further pull.
        assert_eq!(surrogate(1.3, 2.0, 0.2), (-2.4, 0.0));
        // Worse than expected and likelier: pushed back with all its weight.
        assert_eq!(surrogate(1.3, -2.0, 0.2), (2.6, 2.6));
        assert_eq!(surrogate(0.7, -2.0, 0.2), (1.6, 0.0));
        assert_eq!(surrogate(0.7, 2.0, 0.2), (-1.4, -1.4));
        assert_eq!(surrogate(1.1, 2.0, 0.2), (-2.2, -2.2));
    }

    #[test]
    fn the_value_loss_is_the_larger_of_two_and_its_slope_is_that_ones() {
        for (value, old, target) in [(1.0, 0.9, 3.0), (2.0, 0.9, 3.0), (2.0, 0.9, -3.0), (0.95, 0.9, 0.0)] {
            let loss = |value: f32| clipped_value_loss(value, old, target, 0.2).0;
            let wanted = (loss(value + 1e-3) - loss(value - 1e-3)) / 2e-3;
            let found = clipped_value_loss(value, old, target, 0.2).1;
            assert!((found - wanted).abs() < 2e-2, "{value} {old} {target}: {found} against {wanted}");
        }
        // Moved towards its target by more than ε: no further pull.
        assert_eq!(clipped_value_loss(2.0, 0.9, 3.0, 0.2).1, 0.0);
    }

    #[test]
    fn advantages_have_mean_zero_and_spread_one() {
        let mut values = [1.0, 2.0, 3.0, 10.0];
        standardise(&mut values);
        assert!(values.iter().sum::<f32>().abs() < 1e-5);
        assert!((values.iter().map(|x| x * x).sum::<f32>() / 4.0 - 1.0).abs() < 1e-5);
    }
}
