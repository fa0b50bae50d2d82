//! One environment's steps, driven by one thread from first to last.
//!
//! No step waits for another environment, an environment's state stays in its thread's cache, and what
//! is drawn depends on its number alone: the same steps on any number of threads.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::gaussian::{Spread, normal};
use super::normaliser::Normaliser;
use super::single_pass::{Scratch, SinglePass};
use super::task::{End, Task};

/// Episodes that ended, summed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Episodes {
    /// How many.
    pub count: u64,
    /// Of them, for good.
    pub terminated: u64,
    /// Their steps.
    pub steps: u64,
    /// Their rewards.
    pub reward: f64,
}

/// What one environment went through since [`Track::clear`]; `[step][value]` each.
#[derive(Default)]
pub struct Track {
    /// What the policy saw.
    pub observation: Vec<f32>,
    /// What the critic saw, one more than steps.
    pub privileged: Vec<f32>,
    /// What was done.
    pub action: Vec<f32>,
    /// The mean it was drawn around.
    pub mean: Vec<f32>,
    /// `ln p` of it.
    pub log_probability: Vec<f32>,
    /// Rewards.
    pub reward: Vec<f32>,
    /// Episodes' ends.
    pub ends: Vec<Option<End>>,
    /// What the critic saw last in each episode that timed out.
    pub timed_out: Vec<f32>,
    /// What the expert would have done, or whatever else the policy is pulled towards, where it was asked.
    pub expert: Vec<f32>,
    /// Sums of the reward's terms.
    pub terms: Vec<f64>,
    /// Episodes that ended.
    pub episodes: Episodes,
    /// What was not a number, if anything.
    pub fault: Option<&'static str>,
    episode_steps: u64,
    episode_reward: f64,
    scratch: Scratch,
}

/// What the policy is pulled towards while it explores.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pull {
    /// Nothing.
    None,
    /// What the expert would have done.
    Expert,
    /// What the policy does as its own mirror image.
    Mirror,
}

/// Who drives while an expert is imitated.
#[derive(Clone, Copy, Debug)]
pub struct Mixture {
    /// Share of stints that the expert drives.
    pub expert_share: f64,
    /// Steps to a stint.
    pub stint_steps: usize,
    /// Standard deviation of the noise on every action.
    pub noise_std: f32,
}

impl Track {
    /// Forgets the steps, not the episode that is under way.
    pub fn clear(&mut self) {
        for values in [
            &mut self.observation,
            &mut self.privileged,
            &mut self.action,
            &mut self.mean,
            &mut self.log_probability,
            &mut self.reward,
            &mut self.timed_out,
            &mut self.expert,
        ] {
            values.clear();
        }
        self.ends.clear();
        self.terms.clear();
        self.episodes = Episodes::default();
    }

    /// Forgets the steps and the episode: the environment has been restarted.
    pub fn restart(&mut self) {
        self.clear();
        (self.episode_steps, self.episode_reward) = (0, 0.0);
    }

    /// Moments of what was seen: the policy's view and the critic's.
    pub fn moments(&self, observation: usize, privileged: usize) -> [Normaliser; 2] {
        let mut moments = [Normaliser::new(observation), Normaliser::new(privileged)];
        moments[0].add(self.observation.chunks_exact(observation));
        moments[1].add(self.privileged.chunks_exact(privileged));
        moments
    }

    /// Takes `steps` steps with actions drawn around the policy's answers.
    pub fn explore<T: Task>(
        &mut self,
        task: &mut T,
        policy: &SinglePass,
        spread: Spread<'_>,
        steps: usize,
        pull: Pull,
        rng: &mut ChaCha8Rng,
    ) {
        let mut action = vec![0.0; task.action_len()];
        let mut mirrored = vec![0.0; task.observation_len()];
        for _ in 0..steps {
            let observation = self.see(task);
            let mean = policy.answer(&self.observation[observation..], &mut self.scratch);
            spread.draw(mean, rng, &mut action);
            self.log_probability.push(spread.log_probability(mean, &action));
            self.mean.extend_from_slice(mean);
            self.action.extend_from_slice(&action);
            let at = self.expert.len();
            match pull {
                Pull::None => {}
                Pull::Expert => {
                    // Without an expert nothing pulls away from what the policy does.
                    self.expert.resize(at + action.len(), 0.0);
                    if !task.expert_action(&mut self.expert[at..]) {
                        self.expert[at..].copy_from_slice(mean);
                    }
                }
                Pull::Mirror => {
                    self.expert.extend_from_slice(mean);
                    if let Some(mirror) = task.mirror() {
                        mirror.observation(&self.observation[observation..], &mut mirrored);
                        let answer = policy.answer(&mirrored, &mut self.scratch);
                        mirror.action(answer, &mut self.expert[at..]);
                    }
                }
            }
            self.take(task, &action);
        }
        self.see_last(task);
    }

    /// Takes `steps` steps, driven in stints by the expert or the policy, and keeps those that the expert
    /// has a label for, each also as seen in the mirror where the task has one.
    pub fn imitate<T: Task>(
        &mut self,
        task: &mut T,
        policy: &SinglePass,
        mixture: Mixture,
        steps: usize,
        rng: &mut ChaCha8Rng,
    ) {
        let mut label = vec![0.0; task.action_len()];
        let mut mirrored = vec![0.0; task.observation_len()];
        let mut expert_drives = false;
        for step in 0..steps {
            if step % mixture.stint_steps == 0 {
                expert_drives = rng.random::<f64>() < mixture.expert_share;
            }
            let observation = self.see(task);
            let labelled = task.expert_action(&mut label);
            let driver = if labelled && expert_drives {
                &label
            } else {
                policy.answer(&self.observation[observation..], &mut self.scratch)
            };
            let action: Vec<f32> = driver.iter().map(|a| a + mixture.noise_std * normal(rng)).collect();
            if labelled {
                self.expert.extend_from_slice(&label);
                if let Some(mirror) = task.mirror() {
                    mirror.observation(&self.observation[observation..], &mut mirrored);
                    self.observation.extend_from_slice(&mirrored);
                    let at = self.expert.len();
                    self.expert.resize(at + label.len(), 0.0);
                    mirror.action(&label, &mut self.expert[at..]);
                }
            } else {
                self.observation.truncate(observation);
            }
            self.take(task, &action);
        }
    }

    /// Looks, and says where in `observation` the new row begins.
    fn see<T: Task>(&mut self, task: &T) -> usize {
        let at = self.observation.len();
        self.observation.resize(at + task.observation_len(), 0.0);
        let privileged = self.privileged.len();
        self.privileged.resize(privileged + task.privileged_len(), 0.0);
        task.observe(&mut self.observation[at..], &mut self.privileged[privileged..]);
        if !self.observation[at..].iter().chain(&self.privileged[privileged..]).all(|x| x.is_finite()) {
            self.fault = Some("an observation");
        }
        at
    }

    fn see_last<T: Task>(&mut self, task: &T) {
        let at = self.see(task);
        self.observation.truncate(at);
    }

    fn take<T: Task>(&mut self, task: &mut T, action: &[f32]) {
        let step = task.step(action);
        if !step.reward.is_finite() {
            self.fault = Some("a reward");
        }
        self.reward.push(step.reward);
        self.ends.push(step.end);
        let terms = task.reward_terms();
        self.terms.resize(terms.len(), 0.0);
        for (sum, (_, term)) in self.terms.iter_mut().zip(terms) {
            *sum += f64::from(*term);
        }
        self.episode_steps += 1;
        self.episode_reward += f64::from(step.reward);
        let Some(end) = step.end else { return };
        match end {
            End::TimedOut => {
                let at = self.privileged.len();
                self.see_last(task);
                self.timed_out.extend(self.privileged.drain(at..));
            }
            End::Terminated => self.episodes.terminated += 1,
            End::Finished => {}
        }
        self.episodes.count += 1;
        self.episodes.steps += std::mem::take(&mut self.episode_steps);
        self.episodes.reward += std::mem::take(&mut self.episode_reward);
        task.begin_episode();
    }
}
