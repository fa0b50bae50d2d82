//! What the learner asks of an environment; of physics it knows nothing else.

use vocaloco_sim::environment::Mirror;

/// How an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// For good: nothing is worth anything afterwards.
    Terminated,
    /// Cut off by the clock: what would have followed is estimated by the critic.
    TimedOut,
    /// For good, and no failure: it was to end then.
    Finished,
}

/// What one step gave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Reward of the step, times its duration.
    pub reward: f32,
    /// Whether the episode ended with it.
    pub end: Option<End>,
}

/// One environment. Its number and the run's seed are given to it when it is made.
///
/// Whatever it draws depends on (seed, its number, segment, episode) alone.
pub trait Task: Send {
    /// Values that the policy sees.
    fn observation_len(&self) -> usize;

    /// Values that the critic sees: the observation without noise and what a robot cannot measure.
    fn privileged_len(&self) -> usize;

    /// Values that the policy answers.
    fn action_len(&self) -> usize;

    /// Start of a segment. The state afterwards depends only on (seed, number, segment, level): nothing of
    /// what was before survives.
    fn restart(&mut self, segment: u64, level: u32);

    /// The next episode, after a step that ended one.
    fn begin_episode(&mut self);

    /// Both views of the present instant; asking twice gives the same.
    fn observe(&self, observation: &mut [f32], privileged: &mut [f32]);

    /// Takes one step and stays where it ended, for the critic to see.
    fn step(&mut self, action: &[f32]) -> Step;

    /// What the expert does in the present state; false when there is none.
    ///
    /// Asked at most once before a step, whoever then drives.
    fn expert_action(&mut self, action: &mut [f32]) -> bool;

    /// How left and right are exchanged, where that is another state of the same problem.
    fn mirror(&self) -> Option<&Mirror> {
        None
    }

    /// The last step's reward by term, always the same terms in the same order.
    fn reward_terms(&self) -> &[(&'static str, f32)];

    /// Level of the curriculum: all of an environment that a checkpoint keeps.
    fn level(&self) -> u32;
}
