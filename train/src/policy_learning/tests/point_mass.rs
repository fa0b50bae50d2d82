//! A mass on a plane, to be brought to the origin and held there by a bounded force.

use rand_chacha::ChaCha8Rng;
use vocaloco_sim::stream::{stream, uniform};

use super::super::task::{End, Step, Task};

/// Steps to an episode.
pub(super) const EPISODE_STEPS: u32 = 40;
/// Distance beyond which the mass is lost.
const LOST_BEYOND: f32 = 3.0;
/// Duration of a step, s.
const STEP_S: f32 = 0.1;

/// The mass, its clock and its draws.
pub(super) struct PointMass {
    seed: u64,
    number: u64,
    segment: u64,
    episode: u64,
    level: u32,
    steps: u32,
    position: [f32; 2],
    velocity: [f32; 2],
    terms: [(&'static str, f32); 2],
}

impl PointMass {
    pub(super) fn new(seed: u64, number: u32) -> Self {
        Self {
            seed,
            number: number.into(),
            segment: 0,
            episode: 0,
            level: 0,
            steps: 0,
            position: [0.0; 2],
            velocity: [0.0; 2],
            terms: [("near", 0.0), ("force", 0.0)],
        }
    }

    fn rng(&self) -> ChaCha8Rng {
        stream(self.seed, "test/point_mass", &[self.number, self.segment, self.episode])
    }

    fn begin(&mut self) {
        let mut rng = self.rng();
        let reach = 1.0 + 0.1 * self.level as f32;
        self.position = std::array::from_fn(|_| uniform(&mut rng, -reach, reach));
        self.velocity = std::array::from_fn(|_| uniform(&mut rng, -0.5, 0.5));
        self.steps = 0;
    }

    /// The force of a controller that solves the problem, N.
    pub(super) fn expert(&self) -> [f32; 2] {
        std::array::from_fn(|axis| (-4.0 * self.position[axis] - 3.0 * self.velocity[axis]).clamp(-2.0, 2.0))
    }
}

impl Task for PointMass {
    fn observation_len(&self) -> usize {
        4
    }

    fn privileged_len(&self) -> usize {
        5
    }

    fn action_len(&self) -> usize {
        2
    }

    fn restart(&mut self, segment: u64, level: u32) {
        (self.segment, self.level, self.episode) = (segment, level, 0);
        self.begin();
        self.steps = (self.number % u64::from(EPISODE_STEPS)) as u32;
    }

    fn begin_episode(&mut self) {
        self.episode += 1;
        self.begin();
    }

    fn observe(&self, observation: &mut [f32], privileged: &mut [f32]) {
        let seen = [self.position[0], self.position[1], self.velocity[0], self.velocity[1]];
        observation.copy_from_slice(&seen);
        privileged[..4].copy_from_slice(&seen);
        privileged[4] = self.steps as f32 / EPISODE_STEPS as f32;
    }

    fn step(&mut self, action: &[f32]) -> Step {
        for (axis, force) in action.iter().enumerate() {
            self.velocity[axis] += STEP_S * force.clamp(-2.0, 2.0);
            self.position[axis] += STEP_S * self.velocity[axis];
        }
        self.steps += 1;
        let squared = |v: [f32; 2]| v[0] * v[0] + v[1] * v[1];
        self.terms[0].1 = 0.1 * libm::expf(-2.0 * squared(self.position));
        self.terms[1].1 = -0.002 * squared([action[0], action[1]]);
        let lost = squared(self.position) > LOST_BEYOND * LOST_BEYOND;
        let end = if lost {
            self.level = self.level.saturating_sub(1);
            Some(End::Terminated)
        } else if self.steps >= EPISODE_STEPS {
            self.level = (self.level + u32::from(squared(self.position) < 0.1)).min(9);
            Some(End::TimedOut)
        } else {
            None
        };
        Step { reward: self.terms[0].1 + self.terms[1].1, end }
    }

    fn expert_action(&mut self, action: &mut [f32]) -> bool {
        action.copy_from_slice(&self.expert());
        true
    }

    fn reward_terms(&self) -> &[(&'static str, f32)] {
        &self.terms
    }

    fn level(&self) -> u32 {
        self.level
    }
}
