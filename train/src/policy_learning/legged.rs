//! The simulator's legged robot as a [`Task`].

use vocaloco_sim::environment::{self, Environment};

use super::task::{End, Step, Task};

impl Task for Environment {
    fn observation_len(&self) -> usize {
        self.observation_len()
    }

    fn privileged_len(&self) -> usize {
        self.privileged_len()
    }

    fn action_len(&self) -> usize {
        self.action_len()
    }

    fn restart(&mut self, segment: u64, level: u32) {
        self.restart(segment, level);
    }

    fn begin_episode(&mut self) {
        self.begin_episode();
    }

    fn observe(&self, observation: &mut [f32], privileged: &mut [f32]) {
        self.observe(observation, privileged);
    }

    fn step(&mut self, action: &[f32]) -> Step {
        let step = self.step(action);
        let end = step.end.map(|end| match end {
            environment::End::Terminated => End::Terminated,
            environment::End::TimedOut => End::TimedOut,
            environment::End::Finished => End::Finished,
        });
        Step { reward: step.reward, end }
    }

    fn expert_action(&mut self, action: &mut [f32]) -> bool {
        self.expert_action(action)
    }

    fn mirror(&self) -> Option<&environment::Mirror> {
        self.mirror()
    }

    fn reward_terms(&self) -> &[(&'static str, f32)] {
        self.reward_terms()
    }

    fn level(&self) -> u32 {
        self.level()
    }
}
