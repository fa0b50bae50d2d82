//! `skills/<name>/training.toml`: how a network policy is trained.

use std::path::Path;

use anyhow::{Context, ensure};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

/// A whole configuration; `E` is the environment's own part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingConfig<E> {
    schema: u32,
    /// Environments that are stepped side by side.
    pub environments: usize,
    /// Iterations between two checkpoints; environments start afresh at each.
    #[serde(default = "default_segment")]
    pub segment_iterations: u64,
    /// Sizes of the networks.
    #[serde(default)]
    pub network: NetworkConfig,
    /// Imitation of the structured controller first; left out, none.
    #[serde(default)]
    pub imitation: Option<ImitationConfig>,
    /// Reinforcement learning then.
    #[serde(default)]
    pub ppo: PpoConfig,
    /// Robot, terrain, reward, curriculum, randomisation.
    pub environment: E,
}

/// A configuration without its environment: all that learning needs.
pub type Plan = TrainingConfig<()>;

fn default_segment() -> u64 {
    25
}

/// Sizes of the networks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NetworkConfig {
    /// Hidden layers of the policy.
    pub actor: Vec<usize>,
    /// Hidden layers of the critic, which is not shipped.
    pub critic: Vec<usize>,
    /// Standard deviation of the actions at the start; small after an imitation, 1 without.
    pub initial_std: f32,
    /// Standard deviation that exploration keeps at least.
    pub least_std: f32,
    /// Samples after which the observations' mean and spread stay as they are.
    pub normaliser_samples: f64,
}

impl Default for NetworkConfig {
    fn default() -> Self {
        Self {
            actor: vec![256, 128, 64],
            critic: vec![256, 128, 64],
            initial_std: 1.0,
            least_std: 0.05,
            normaliser_samples: 2e6,
        }
    }
}

/// Imitation of an expert that runs in shadow (`DAgger`).
///
/// # Source
/// Ross, Gordon and Bagnell, *A reduction of imitation learning and structured prediction to no-regret
/// online learning*, AISTATS 2011, algorithm 3.1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImitationConfig {
    /// Rounds of driving and fitting.
    pub rounds: u64,
    /// Steps of each environment in a round.
    pub steps: usize,
    /// Share of stints that the expert drives in the first round.
    pub expert_share: f64,
    /// What that share is multiplied by each round.
    pub expert_share_decay: f64,
    /// Steps to a stint, after which it is drawn anew who drives.
    pub stint_steps: usize,
    /// Standard deviation of the noise on what drives, so that its mistakes are seen.
    pub noise_std: f32,
    /// Samples kept; the oldest go first.
    pub capacity: usize,
    /// Times that the kept samples are seen each round.
    pub epochs: u64,
    /// Samples to a step.
    pub batch: usize,
    /// Learning rate.
    pub learning_rate: f32,
}

impl Default for ImitationConfig {
    fn default() -> Self {
        Self {
            rounds: 12,
            steps: 100,
            expert_share: 1.0,
            expert_share_decay: 0.7,
            stint_steps: 50,
            noise_std: 0.1,
            capacity: 400_000,
            epochs: 4,
            batch: 2048,
            learning_rate: 1e-3,
        }
    }
}

/// Reinforcement learning (PPO).
///
/// # Source
/// Schulman et al., *Proximal policy optimization algorithms*, 2017; figures as Rudin et al., *Learning to
/// walk in minutes*, `CoRL` 2021.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PpoConfig {
    /// Iterations in all, a multiple of `segment_iterations` or rounded up to one.
    pub iterations: u64,
    /// Steps of each environment in an iteration.
    pub steps: usize,
    /// Times that an iteration's samples are seen.
    pub epochs: u64,
    /// Steps of the descent in each of them.
    pub minibatches: usize,
    /// Learning rate at the start.
    pub learning_rate: f32,
    /// Learning rate of the critic; left out, the policy's.
    pub critic_learning_rate: Option<f32>,
    /// Divergence of the policy in an update that the learning rate is steered to.
    pub desired_divergence: f32,
    /// How far a probability ratio, and a value, may move in an update.
    pub clip: f32,
    /// Discount γ.
    pub discount: f32,
    /// Decay of the advantage's trace, λ.
    pub trace_decay: f32,
    /// Weight of the entropy.
    pub entropy: f32,
    /// Weight of the value loss.
    pub value_loss: f32,
    /// Longest gradient, policy and critic together.
    pub longest_gradient: f32,
    /// First iterations that fit the critic alone, so that a good policy is not lost to a critic that
    /// knows nothing yet.
    pub critic_iterations: u64,
    /// Weight of the squared distance to the expert's action at the start; 0 asks no expert.
    pub imitation: f32,
    /// What that weight is multiplied by each iteration; below a hundredth of the start it is 0.
    pub imitation_decay: f64,
    /// Weight of the squared distance to what the policy does as its own mirror image, where no expert is
    /// asked; 0 lets left and right differ.
    pub symmetry: f32,
}

impl Default for PpoConfig {
    fn default() -> Self {
        Self {
            iterations: 1500,
            steps: 24,
            epochs: 5,
            minibatches: 4,
            learning_rate: 1e-3,
            critic_learning_rate: None,
            desired_divergence: 0.01,
            clip: 0.2,
            discount: 0.99,
            trace_decay: 0.95,
            entropy: 0.01,
            value_loss: 1.0,
            longest_gradient: 1.0,
            critic_iterations: 0,
            imitation: 0.0,
            imitation_decay: 0.98,
            symmetry: 0.0,
        }
    }
}

impl<E: DeserializeOwned> TrainingConfig<E> {
    /// Reads and checks the file; the environment's part checks itself.
    ///
    /// # Errors
    /// It cannot be read, does not parse, or a number is outside its range.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| {
            format!("{}: cannot be read; a network to be trained needs one", path.display())
        })?;
        Self::parse(&text).with_context(|| path.display().to_string())
    }

    /// Parses and checks a text.
    ///
    /// # Errors
    /// It does not parse, or a number is outside its range.
    pub fn parse(text: &str) -> anyhow::Result<Self> {
        let config: Self = toml::from_str(text).context("does not parse")?;
        config.check()?;
        Ok(config)
    }
}

impl<E> TrainingConfig<E> {
    /// A configuration with everything but the environment at its default.
    pub fn with_environment(environments: usize, environment: E) -> Self {
        Self {
            schema: 1,
            environments,
            segment_iterations: default_segment(),
            network: NetworkConfig::default(),
            imitation: None,
            ppo: PpoConfig::default(),
            environment,
        }
    }

    /// The same without the environment's part.
    pub fn plan(&self) -> Plan {
        Plan {
            schema: self.schema,
            environments: self.environments,
            segment_iterations: self.segment_iterations,
            network: self.network.clone(),
            imitation: self.imitation.clone(),
            ppo: self.ppo.clone(),
            environment: (),
        }
    }

    /// Refuses numbers outside their ranges.
    ///
    /// # Errors
    /// The first field that is outside, with what was found and wanted.
    pub fn check(&self) -> anyhow::Result<()> {
        ensure!(self.schema == 1, "schema: found {}, wanted 1", self.schema);
        count("environments", self.environments as u64, 1, 65_536)?;
        count("segment_iterations", self.segment_iterations, 1, 10_000)?;
        for (field, hidden) in
            [("network.actor", &self.network.actor), ("network.critic", &self.network.critic)]
        {
            ensure!(
                (1..=4).contains(&hidden.len()) && hidden.iter().all(|width| (1..=1024).contains(width)),
                "{field}: found {hidden:?}, wanted 1 to 4 layers of 1 to 1024"
            );
        }
        within("network.initial_std", self.network.initial_std.into(), 0.001, 10.0)?;
        within("network.least_std", self.network.least_std.into(), 0.001, 10.0)?;
        within("network.normaliser_samples", self.network.normaliser_samples, 0.0, 1e12)?;
        if let Some(imitation) = &self.imitation {
            imitation.check()?;
        }
        self.ppo.check()
    }
}

impl ImitationConfig {
    fn check(&self) -> anyhow::Result<()> {
        count("imitation.rounds", self.rounds, 1, 10_000)?;
        count("imitation.steps", self.steps as u64, 1, 100_000)?;
        count("imitation.stint_steps", self.stint_steps as u64, 1, 100_000)?;
        count("imitation.capacity", self.capacity as u64, 1, 100_000_000)?;
        count("imitation.epochs", self.epochs, 1, 1000)?;
        count("imitation.batch", self.batch as u64, 1, 1_000_000)?;
        within("imitation.expert_share", self.expert_share, 0.0, 1.0)?;
        within("imitation.expert_share_decay", self.expert_share_decay, 0.0, 1.0)?;
        within("imitation.noise_std", self.noise_std.into(), 0.0, 10.0)?;
        within("imitation.learning_rate", self.learning_rate.into(), 1e-8, 1.0)
    }
}

impl PpoConfig {
    fn check(&self) -> anyhow::Result<()> {
        count("ppo.iterations", self.iterations, 0, 10_000_000)?;
        count("ppo.steps", self.steps as u64, 1, 10_000)?;
        count("ppo.epochs", self.epochs, 1, 100)?;
        count("ppo.minibatches", self.minibatches as u64, 1, 10_000)?;
        within("ppo.learning_rate", self.learning_rate.into(), 1e-8, 1.0)?;
        let critic = self.critic_learning_rate.unwrap_or(self.learning_rate);
        within("ppo.critic_learning_rate", critic.into(), 1e-8, 1.0)?;
        within("ppo.desired_divergence", self.desired_divergence.into(), 1e-6, 10.0)?;
        within("ppo.clip", self.clip.into(), 0.001, 10.0)?;
        within("ppo.discount", self.discount.into(), 0.0, 1.0)?;
        within("ppo.trace_decay", self.trace_decay.into(), 0.0, 1.0)?;
        within("ppo.entropy", self.entropy.into(), 0.0, 10.0)?;
        within("ppo.value_loss", self.value_loss.into(), 0.0, 100.0)?;
        within("ppo.longest_gradient", self.longest_gradient.into(), 1e-6, 1e6)?;
        within("ppo.imitation", self.imitation.into(), 0.0, 1000.0)?;
        within("ppo.imitation_decay", self.imitation_decay, 0.0, 1.0)?;
        within("ppo.symmetry", self.symmetry.into(), 0.0, 1000.0)
    }
}

fn count(field: &str, found: u64, low: u64, high: u64) -> anyhow::Result<()> {
    ensure!((low..=high).contains(&found), "{field}: found {found}, wanted {low} to {high}");
    Ok(())
}

fn within(field: &str, found: f64, low: f64, high: f64) -> anyhow::Result<()> {
    // Phrased as "is inside", so that NaN is refused too.
    ensure!((low..=high).contains(&found), "{field}: found {found}, wanted {low} to {high}");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Nothing {}

    fn refusal(text: &str) -> String {
        let text = format!("schema = 1\nenvironments = 8\n{text}\n[environment]\n");
        format!("{:#}", TrainingConfig::<Nothing>::parse(&text).unwrap_err())
    }

    #[test]
    fn what_is_left_out_has_its_default_and_imitation_is_not_done_unasked() {
        let text = "schema = 1\nenvironments = 8\n[environment]\n";
        let config = TrainingConfig::<Nothing>::parse(text).unwrap();
        assert_eq!(config, TrainingConfig::with_environment(8, Nothing {}));
        assert!(config.imitation.is_none());
    }

    #[test]
    fn a_number_outside_its_range_or_none_at_all_is_refused_by_name() {
        assert!(refusal("[ppo]\ndiscount = nan").contains("ppo.discount: found NaN, wanted 0 to 1"));
        assert!(refusal("[ppo]\nclip = 0.0").contains("ppo.clip"));
        assert!(refusal("[network]\nactor = []").contains("network.actor"));
        assert!(refusal("[imitation]\nexpert_share = 1.5").contains("imitation.expert_share"));
    }

    #[test]
    fn an_unknown_field_is_refused() {
        assert!(refusal("[ppo]\ngamma = 0.9").contains("gamma"));
    }
}
