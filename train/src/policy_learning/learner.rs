//! All that learning changes: what a checkpoint holds.

use vocaloco_sim::stream::stream;

use super::adam::Adam;
use super::config::Plan;
use super::gaussian::Spread;
use super::network::Network;
use super::normaliser::Normaliser;
use super::single_pass::SinglePass;

/// Gain of the policy's last layer: near the default pose at the start.
const POLICY_LAST_GAIN: f32 = 0.01;

/// Values at the borders of an environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Widths {
    /// What the policy sees.
    pub observation: usize,
    /// What the critic sees.
    pub privileged: usize,
    /// What the policy answers.
    pub action: usize,
}

/// Networks, their optimisers' memory, the observations' moments, the curriculum.
#[derive(Clone, Debug, PartialEq)]
pub struct Learner {
    /// The policy's shape.
    pub actor: Network,
    /// The critic's shape.
    pub critic: Network,
    /// Parameters of the policy's network, then `ln σ` of each action.
    pub policy: Vec<f32>,
    /// Parameters of the critic.
    pub value: Vec<f32>,
    /// Memory of the policy's descent.
    pub policy_adam: Adam,
    /// Memory of the critic's.
    pub value_adam: Adam,
    /// Moments of what the policy sees.
    pub observation: Normaliser,
    /// Moments of what the critic sees.
    pub privileged: Normaliser,
    /// Present learning rate.
    pub learning_rate: f32,
    /// Iterations of reinforcement learning done.
    pub iteration: u64,
    /// Rounds of imitation done, all or none.
    pub rounds: u64,
    /// Steps that environments have taken.
    pub steps: u64,
    /// Curriculum level of each environment.
    pub levels: Vec<u32>,
}

impl Learner {
    /// As it is before anything was learnt.
    pub fn new(plan: &Plan, widths: Widths, seed: u64) -> Self {
        let actor = Network::new(widths.observation, &plan.network.actor, widths.action);
        let critic = Network::new(widths.privileged, &plan.network.critic, 1);
        let mut policy =
            actor.start_values(POLICY_LAST_GAIN, &mut stream(seed, "policy_learning/actor", &[]));
        policy.extend(vec![libm::logf(plan.network.initial_std); widths.action]);
        let value = critic.start_values(1.0, &mut stream(seed, "policy_learning/critic", &[]));
        Self {
            policy_adam: Adam::new(policy.len()),
            value_adam: Adam::new(value.len()),
            observation: Normaliser::new(widths.observation),
            privileged: Normaliser::new(widths.privileged),
            learning_rate: plan.ppo.learning_rate,
            iteration: 0,
            rounds: 0,
            steps: 0,
            levels: vec![0; plan.environments],
            actor,
            critic,
            policy,
            value,
        }
    }

    /// Keeps networks and moments, forgets optimisers, spread, counts and levels: a start for another run.
    #[must_use]
    pub fn restarted(mut self, plan: &Plan) -> Self {
        let weights = self.actor.parameters();
        self.policy[weights..].fill(libm::logf(plan.network.initial_std));
        self.policy_adam = Adam::new(self.policy.len());
        self.value_adam = Adam::new(self.value.len());
        self.learning_rate = plan.ppo.learning_rate;
        (self.iteration, self.rounds, self.steps) = (0, 0, 0);
        self.levels = vec![0; plan.environments];
        self
    }

    /// Parameters of the policy's network.
    pub fn weights(&self) -> &[f32] {
        &self.policy[..self.actor.parameters()]
    }

    /// Spread of the policy's actions.
    pub fn spread(&self) -> Spread<'_> {
        Spread { log_std: &self.policy[self.actor.parameters()..] }
    }

    /// The policy, laid out for single observations.
    pub fn single_pass(&self) -> SinglePass {
        SinglePass::new(&self.actor, self.weights(), self.observation.scaling())
    }
}
