//! A training run: imitation, then segments of PPO iterations, a checkpoint after each.
//!
//! Physics is not saved. Instead every environment starts afresh at a segment's start from what (seed,
//! segment, number, level) give, in a run that is never stopped as in one that is resumed: both are equal.

use std::time::Instant;

use anyhow::{Context, bail};
use rayon::prelude::*;
use serde::Serialize;
use vocaloco_sim::stream::stream;

use super::config::{ImitationConfig, Plan};
use super::imitation::{Imitation, RoundRecord};
use super::learner::{Learner, Widths};
use super::ppo::{Ppo, Turn, UpdateRecord};
use super::task::Task;
use super::track::{Episodes, Pull, Track};

/// What the environments went through in an iteration or a round.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DriveRecord {
    /// Mean reward of a step.
    pub reward: f64,
    /// Mean of each of its terms.
    pub terms: Vec<(&'static str, f64)>,
    /// Episodes that ended.
    pub episodes: u64,
    /// Share of them that ended for good.
    pub terminated_share: f64,
    /// Their mean length, steps.
    pub episode_steps: f64,
    /// Their mean reward.
    pub episode_reward: f64,
    /// Mean level of the curriculum.
    pub level: f64,
}

/// One iteration of reinforcement learning.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IterationRecord {
    /// Its number, from 1.
    pub iteration: u64,
    /// Steps taken since the run began.
    pub steps: u64,
    /// What happened.
    pub drive: DriveRecord,
    /// What was learnt.
    pub update: UpdateRecord,
    /// Learning rate afterwards.
    pub learning_rate: f32,
    /// Mean standard deviation of the actions afterwards.
    pub std: f32,
}

/// One round of imitation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImitationRecord {
    /// Its number, from 1.
    pub round: u64,
    /// Steps taken since the run began.
    pub steps: u64,
    /// What happened.
    pub drive: DriveRecord,
    /// What was learnt.
    pub fit: RoundRecord,
}

/// Time that went by, s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spent {
    /// While environments were stepped.
    pub drive_s: f64,
    /// While networks were fitted.
    pub learn_s: f64,
}

#[expect(clippy::disallowed_methods, reason = "time is told, and says when to stop; no result depends on it")]
pub(super) fn now() -> Instant {
    Instant::now()
}

/// Environments and what learns from them.
pub struct Trainer<T> {
    plan: Plan,
    seed: u64,
    tasks: Vec<T>,
    tracks: Vec<Track>,
    /// What is learnt.
    pub learner: Learner,
    ppo: Ppo,
    spent: Spent,
}

/// Widths of a task.
pub fn widths<T: Task>(task: &T) -> Widths {
    Widths {
        observation: task.observation_len(),
        privileged: task.privileged_len(),
        action: task.action_len(),
    }
}

impl<T: Task> Trainer<T> {
    /// Goes on from `learner`; as many tasks as the plan has environments.
    pub fn new(plan: Plan, seed: u64, tasks: Vec<T>, learner: Learner) -> Self {
        let tracks = tasks.iter().map(|_| Track::default()).collect();
        Self { ppo: Ppo::new(&learner), plan, seed, tasks, tracks, learner, spent: Spent::default() }
    }

    /// Where the time went.
    pub fn spent(&self) -> Spent {
        self.spent
    }

    /// Whether imitation is still to be done.
    pub fn imitates(&self) -> bool {
        self.plan.imitation.is_some() && self.learner.rounds == 0 && self.learner.iteration == 0
    }

    /// Whether all iterations are done.
    pub fn is_done(&self) -> bool {
        self.learner.iteration >= self.plan.ppo.iterations
    }

    /// All rounds of imitation.
    ///
    /// # Errors
    /// The environment has no expert, or gave what is not a number.
    pub fn imitate(
        &mut self,
        mut told: impl FnMut(&ImitationRecord) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let Some(config) = self.plan.imitation.clone() else { return Ok(()) };
        let mut imitation = Imitation::new(&config, &self.learner);
        for round in 0..config.rounds {
            self.restart(round);
            self.drive_mixture(&config)?;
            self.see_moments();
            let labels: usize = self.tracks.iter().map(|track| track.expert.len()).sum();
            if labels == 0 {
                bail!("imitation: found an environment without an expert, wanted one that answers");
            }
            let since = now();
            let fit = imitation.fit(&mut self.learner, &self.tracks, &config, self.seed);
            self.spent.learn_s += since.elapsed().as_secs_f64();
            self.learner.rounds += 1;
            told(&ImitationRecord {
                round: round + 1,
                steps: self.learner.steps,
                drive: self.drive_record(),
                fit,
            })?;
        }
        Ok(())
    }

    /// One segment: fresh environments, then its iterations.
    ///
    /// # Errors
    /// An environment gave what is not a number.
    pub fn segment(
        &mut self,
        mut told: impl FnMut(&IterationRecord) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let segment = self.learner.iteration / self.plan.segment_iterations;
        let rounds = self.plan.imitation.as_ref().map_or(0, |imitation| imitation.rounds);
        self.restart(rounds + segment);
        for _ in 0..self.plan.segment_iterations {
            told(&self.iterate()?)?;
        }
        Ok(())
    }

    fn restart(&mut self, segment: u64) {
        let tasks = self.tasks.par_iter_mut().zip(&mut self.tracks).zip(&self.learner.levels);
        tasks.for_each(|((task, track), level)| {
            task.restart(segment, *level);
            track.restart();
        });
    }

    fn iterate(&mut self) -> anyhow::Result<IterationRecord> {
        let config = self.plan.ppo.clone();
        let iteration = self.learner.iteration;
        let (pull, weight) = pull(&config, iteration);
        let policy = self.learner.single_pass();
        let spread = self.learner.spread();
        let seed = self.seed;
        let since = now();
        let tasks = self.tasks.par_iter_mut().zip(&mut self.tracks).enumerate();
        tasks.for_each(|(number, (task, track))| {
            track.clear();
            let mut rng = stream(seed, "policy_learning/exploration", &[iteration, number as u64]);
            track.explore(task, &policy, spread, config.steps, pull, &mut rng);
        });
        self.spent.drive_s += since.elapsed().as_secs_f64();
        self.after_drive()?;
        let since = now();
        let update = self.ppo.update(
            &mut self.learner,
            &self.tracks,
            &config,
            Turn {
                seed,
                imitation: weight,
                fits_policy: iteration >= config.critic_iterations,
                least_std: self.plan.network.least_std,
            },
        );
        self.spent.learn_s += since.elapsed().as_secs_f64();
        // After the update: within one, what drove and what is fitted see the same scaling.
        self.see_moments();
        self.learner.iteration += 1;
        let log_std = self.learner.spread().log_std;
        Ok(IterationRecord {
            iteration: iteration + 1,
            steps: self.learner.steps,
            drive: self.drive_record(),
            update,
            learning_rate: self.learner.learning_rate,
            std: log_std.iter().map(|log_std| libm::expf(*log_std)).sum::<f32>() / log_std.len() as f32,
        })
    }

    fn drive_mixture(&mut self, config: &ImitationConfig) -> anyhow::Result<()> {
        let (seed, round) = (self.seed, self.learner.rounds);
        let policy = self.learner.single_pass();
        let mixture = Imitation::mixture(config, round);
        let since = now();
        let tasks = self.tasks.par_iter_mut().zip(&mut self.tracks).enumerate();
        tasks.for_each(|(number, (task, track))| {
            track.clear();
            let mut rng = stream(seed, "policy_learning/mixture", &[round, number as u64]);
            track.imitate(task, &policy, mixture, config.steps, &mut rng);
        });
        self.spent.drive_s += since.elapsed().as_secs_f64();
        self.after_drive()
    }

    fn after_drive(&mut self) -> anyhow::Result<()> {
        for (number, track) in self.tracks.iter().enumerate() {
            if let Some(fault) = track.fault {
                bail!("environment {number}: found {fault} that is not a number, wanted finite values");
            }
            self.learner.steps += track.reward.len() as u64;
        }
        self.learner.levels = self.tasks.iter().map(Task::level).collect();
        Ok(())
    }

    fn see_moments(&mut self) {
        if self.learner.observation.count >= self.plan.network.normaliser_samples {
            return;
        }
        let (observation, privileged) = (self.learner.actor.inputs(), self.learner.critic.inputs());
        let moments: Vec<_> =
            self.tracks.par_iter().map(|track| track.moments(observation, privileged)).collect();
        for [observation, privileged] in &moments {
            self.learner.observation.merge(observation);
            self.learner.privileged.merge(privileged);
        }
    }

    fn drive_record(&self) -> DriveRecord {
        let steps: usize = self.tracks.iter().map(|track| track.reward.len()).sum();
        let per_step = 1.0 / steps.max(1) as f64;
        let mut ended = Episodes::default();
        let mut terms: Vec<(&'static str, f64)> = self
            .tasks
            .first()
            .map_or_else(Vec::new, |task| task.reward_terms().iter().map(|(name, _)| (*name, 0.0)).collect());
        let mut reward = 0.0;
        for track in &self.tracks {
            ended.count += track.episodes.count;
            ended.terminated += track.episodes.terminated;
            ended.steps += track.episodes.steps;
            ended.reward += track.episodes.reward;
            reward += track.reward.iter().map(|reward| f64::from(*reward)).sum::<f64>();
            for ((_, sum), term) in terms.iter_mut().zip(&track.terms) {
                *sum += term * per_step;
            }
        }
        let per_episode = 1.0 / ended.count.max(1) as f64;
        let levels = &self.learner.levels;
        DriveRecord {
            reward: reward * per_step,
            terms,
            episodes: ended.count,
            terminated_share: ended.terminated as f64 * per_episode,
            episode_steps: ended.steps as f64 * per_episode,
            episode_reward: ended.reward * per_episode,
            level: levels.iter().map(|level| f64::from(*level)).sum::<f64>() / levels.len().max(1) as f64,
        }
    }
}

/// What the policy is pulled towards in an iteration, and how much: the expert, until its weight has fallen
/// below a hundredth, then its own mirror image.
fn pull(config: &super::config::PpoConfig, iteration: u64) -> (Pull, f32) {
    let share = libm::pow(config.imitation_decay, iteration as f64);
    if config.imitation > 0.0 && share >= 0.01 {
        return (Pull::Expert, config.imitation * share as f32);
    }
    if config.symmetry > 0.0 { (Pull::Mirror, config.symmetry) } else { (Pull::None, 0.0) }
}

/// Makes the tasks of a plan, on all threads.
///
/// # Errors
/// The first that could not be made.
pub fn make_tasks<T: Task>(
    plan: &Plan,
    make: impl Fn(u32) -> anyhow::Result<T> + Sync,
) -> anyhow::Result<Vec<T>> {
    (0..plan.environments as u32)
        .into_par_iter()
        .map(|number| make(number).with_context(|| format!("environment {number}")))
        .collect()
}
