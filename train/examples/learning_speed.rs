//! What learning costs apart from physics: an environment that costs nothing, at the sizes of a legged
//! robot. Prints a line per number of threads: time of a policy's answer, samples fitted a second.
//!
//! `cargo run --package vocaloco-train --example learning_speed`

use vocaloco_sim::threads::with_threads;
use vocaloco_train::policy_learning::config::Plan;
use vocaloco_train::policy_learning::learner::Learner;
use vocaloco_train::policy_learning::task::{End, Step, Task};
use vocaloco_train::policy_learning::trainer::{Trainer, make_tasks, widths};

const OBSERVATION: usize = 237;
const PRIVILEGED: usize = 270;
const ACTION: usize = 12;
const ENVIRONMENTS: usize = 256;
const EPISODE_STEPS: u32 = 500;

/// Numbers that change from step to step, and a reward for small actions.
struct Nothing {
    steps: u32,
    terms: [(&'static str, f32); 1],
}

impl Task for Nothing {
    fn observation_len(&self) -> usize {
        OBSERVATION
    }

    fn privileged_len(&self) -> usize {
        PRIVILEGED
    }

    fn action_len(&self) -> usize {
        ACTION
    }

    fn restart(&mut self, segment: u64, _: u32) {
        self.steps = segment as u32;
    }

    fn begin_episode(&mut self) {
        self.steps = 0;
    }

    fn observe(&self, observation: &mut [f32], privileged: &mut [f32]) {
        for (at, value) in observation.iter_mut().chain(privileged).enumerate() {
            *value = ((self.steps * 7 + at as u32) % 13) as f32 - 6.0;
        }
    }

    fn step(&mut self, action: &[f32]) -> Step {
        self.steps += 1;
        self.terms[0].1 = -0.01 * action.iter().map(|a| a * a).sum::<f32>();
        Step { reward: self.terms[0].1, end: (self.steps == EPISODE_STEPS).then_some(End::TimedOut) }
    }

    fn expert_action(&mut self, _: &mut [f32]) -> bool {
        false
    }

    fn reward_terms(&self) -> &[(&'static str, f32)] {
        &self.terms
    }

    fn level(&self) -> u32 {
        0
    }
}

#[expect(clippy::print_stdout, reason = "a program that measures")]
fn main() -> anyhow::Result<()> {
    for threads in [1, 2] {
        let mut plan = Plan::with_environment(ENVIRONMENTS, ());
        plan.segment_iterations = 4;
        let (spent, steps) = with_threads(threads, || {
            let tasks = make_tasks(&plan, |_| Ok(Nothing { steps: 0, terms: [("small", 0.0)] }))?;
            let learner = Learner::new(&plan, widths(&tasks[0]), 1);
            let mut trainer = Trainer::new(plan.clone(), 1, tasks, learner);
            trainer.segment(|_| Ok(()))?;
            anyhow::Ok((trainer.spent(), trainer.learner.steps as f64))
        })??;
        println!(
            "{threads} threads: {:.1} us a step without physics, {:.0} samples fitted a second ({:.0} steps a \
             second with {} epochs)",
            1e6 * spent.drive_s * threads as f64 / steps,
            steps * plan.ppo.epochs as f64 / spent.learn_s,
            steps / spent.learn_s,
            plan.ppo.epochs,
        );
    }
    Ok(())
}
