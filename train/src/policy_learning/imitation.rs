//! Imitation of an expert in shadow: who drives is drawn, what the expert would have done is learnt.

use vocaloco_sim::stream::stream;

use super::adam::{Adam, clipping};
use super::config::ImitationConfig;
use super::descent::{Descent, Loss};
use super::learner::Learner;
use super::normaliser::Scaling;
use super::shuffle::shuffled;
use super::track::{Mixture, Track};

/// Error beyond which the loss grows linearly, in units of an action.
const LINEAR_FROM: f32 = 1.0;

/// Longest gradient of a step.
const LONGEST_GRADIENT: f32 = 1.0;

/// Share of the learning rate left in the last round.
const FINAL_RATE_SHARE: f32 = 0.1;

/// What a round says of itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct RoundRecord {
    /// Share of stints that the expert drove.
    pub expert_share: f64,
    /// Loss on the round's own states before it learnt from them: what counts.
    pub fresh_loss: f64,
    /// Loss on all kept states, mean of the last epoch.
    pub loss: f64,
    /// Samples kept.
    pub samples: usize,
}

/// Samples of all rounds, the oldest overwritten first.
struct Memory {
    widths: [usize; 2],
    capacity: usize,
    observations: Vec<f32>,
    labels: Vec<f32>,
    next: usize,
}

impl Memory {
    fn len(&self) -> usize {
        self.labels.len() / self.widths[1]
    }

    /// Keeps samples and says in which rows they now stand.
    fn add(&mut self, observations: &[f32], labels: &[f32]) -> Vec<u32> {
        let rows = observations.chunks_exact(self.widths[0]).zip(labels.chunks_exact(self.widths[1]));
        rows.map(|(observation, label)| {
            let row = self.next;
            if self.len() < self.capacity {
                self.observations.extend_from_slice(observation);
                self.labels.extend_from_slice(label);
            } else {
                self.observations[row * self.widths[0]..][..self.widths[0]].copy_from_slice(observation);
                self.labels[row * self.widths[1]..][..self.widths[1]].copy_from_slice(label);
            }
            self.next = (self.next + 1) % self.capacity;
            row as u32
        })
        .collect()
    }
}

/// Huber's loss of the distance between the policy's answer and the label, mean over actions.
struct ImitationLoss<'a> {
    memory: &'a Memory,
    scaling: &'a Scaling,
    share: f32,
}

/// Huber's loss and its derivative: `½e²` up to 1, `|e| − ½` beyond.
fn huber(error: f32) -> (f32, f32) {
    if error.abs() <= LINEAR_FROM {
        (0.5 * error * error, error)
    } else {
        (LINEAR_FROM * (error.abs() - 0.5 * LINEAR_FROM), LINEAR_FROM * error.signum())
    }
}

impl Loss for ImitationLoss<'_> {
    fn sums(&self) -> usize {
        1
    }

    fn input(&self, row: usize, input: &mut [f32]) {
        input.copy_from_slice(&self.memory.observations[row * input.len()..][..input.len()]);
        self.scaling.apply(input);
    }

    fn derivative(&self, row: usize, answer: &[f32], by_answer: &mut [f32], sums: &mut [f64]) {
        let labels = &self.memory.labels[row * answer.len()..][..answer.len()];
        let weight = 1.0 / answer.len() as f32;
        for ((answer, label), by_answer) in answer.iter().zip(labels).zip(by_answer) {
            let (loss, by) = huber(answer - label);
            sums[0] += f64::from(weight * loss);
            *by_answer = self.share * weight * by;
        }
    }
}

/// The rounds' memory and optimiser; one run of imitation.
pub struct Imitation {
    memory: Memory,
    descent: Descent,
    adam: Adam,
}

impl Imitation {
    /// Before the first round.
    pub fn new(config: &ImitationConfig, learner: &Learner) -> Self {
        let widths = [learner.actor.inputs(), learner.actor.outputs()];
        let memory = Memory {
            widths,
            capacity: config.capacity,
            observations: Vec::new(),
            labels: Vec::new(),
            next: 0,
        };
        Self {
            memory,
            descent: Descent::new(learner.actor.clone()),
            adam: Adam::new(learner.actor.parameters()),
        }
    }

    /// Who drives in `round`.
    pub fn mixture(config: &ImitationConfig, round: u64) -> Mixture {
        Mixture {
            expert_share: config.expert_share * libm::pow(config.expert_share_decay, round as f64),
            stint_steps: config.stint_steps,
            noise_std: config.noise_std,
        }
    }

    /// Keeps the round's samples and fits the policy's network to all that are kept.
    pub fn fit(
        &mut self,
        learner: &mut Learner,
        tracks: &[Track],
        config: &ImitationConfig,
        seed: u64,
    ) -> RoundRecord {
        let round = learner.rounds;
        let mut fresh = Vec::new();
        for track in tracks {
            fresh.extend(self.memory.add(&track.observation, &track.expert));
        }
        let scaling = learner.observation.scaling();
        let fresh_loss = self.loss(learner, &scaling, &fresh);
        let through = round as f32 / (config.rounds - 1).max(1) as f32;
        let rate = config.learning_rate * (1.0 - (1.0 - FINAL_RATE_SHARE) * through);
        let weights = learner.actor.parameters();
        let mut loss_sum = 0.0;
        for epoch in 0..config.epochs {
            loss_sum = 0.0;
            let mut rng = stream(seed, "policy_learning/imitation", &[round, epoch]);
            for batch in shuffled(self.memory.len(), &mut rng).chunks(config.batch) {
                let share = 1.0 / batch.len() as f32;
                let loss = ImitationLoss { memory: &self.memory, scaling: &scaling, share };
                let (gradient, sums) = self.descent.gradient(&learner.policy[..weights], batch, &loss);
                let scale = clipping(&[gradient], LONGEST_GRADIENT);
                self.adam.step(&mut learner.policy[..weights], gradient, scale, rate);
                loss_sum += sums[0];
            }
        }
        RoundRecord {
            expert_share: Self::mixture(config, round).expert_share,
            fresh_loss,
            loss: loss_sum / self.memory.len().max(1) as f64,
            samples: self.memory.len(),
        }
    }

    fn loss(&mut self, learner: &Learner, scaling: &Scaling, rows: &[u32]) -> f64 {
        let loss = ImitationLoss { memory: &self.memory, scaling, share: 0.0 };
        self.descent.gradient(learner.weights(), rows, &loss).1[0] / rows.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loss_is_square_near_zero_and_straight_beyond_one() {
        assert_eq!(huber(0.5), (0.125, 0.5));
        assert_eq!(huber(-3.0), (2.5, -1.0));
        assert_eq!(huber(1.0).0, 0.5);
    }

    #[test]
    fn the_oldest_sample_is_overwritten_first() {
        let mut memory =
            Memory { widths: [1, 1], capacity: 3, observations: Vec::new(), labels: Vec::new(), next: 0 };
        assert_eq!(memory.add(&[1.0, 2.0], &[10.0, 20.0]), [0, 1]);
        assert_eq!(memory.add(&[3.0, 4.0], &[30.0, 40.0]), [2, 0]);
        assert_eq!(memory.observations, [4.0, 2.0, 3.0]);
        assert_eq!(memory.labels, [40.0, 20.0, 30.0]);
    }
}
