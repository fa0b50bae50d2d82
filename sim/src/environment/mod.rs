//! One legged robot in training: it observes, is moved by a network's actions, is rewarded, falls,
//! and starts again where the curriculum puts it. Hundreds share one [`TrainingGround`].
//!
//! Knows no learner: who steps it, and on which thread, changes nothing. What it gives after
//! [`restart`](Environment::restart) depends on (seed, index, segment, level) and the actions alone.

mod config;
mod curriculum;
mod episode;
mod ground;
mod lead;
mod mirror;
mod reward;
mod shadow;
pub mod speed;
mod target;
mod tick;
mod views;

#[cfg(test)]
mod tests;

use std::sync::Arc;

use vocaloco_core::{observation::BaseInOdom, target::PositionTarget};
use vocaloco_plugin_api::{Command, JointTarget};

pub use config::{
    CommandRules, ConfigError, CurriculumRules, EnvironmentConfig, LedRules, PushRules, StartRules,
    TerrainShare, VariationRules,
};
pub use ground::{EnvironmentError, TrainingGround, standard_contract};
pub use mirror::Mirror;
pub use reward::{RewardConfig, RewardTerm, RewardWeights};
pub use target::{TargetReward, TargetRules};

use crate::{
    driver::TICK_S,
    latency::Latency,
    plant::{BasePose, Plant},
    rollout::Path,
    spawn::Spawn,
    stream::{stream, uniform},
    terrain::TerrainKind,
};
use curriculum::Travel;
use episode::Episode;
use reward::Judge;
use shadow::Shadow;
use views::Views;

/// Why an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The base touched something.
    Terminated,
    /// Time was up, or the robot came to the end of the tile: nothing that the policy did wrong.
    TimedOut,
    /// The time for the way to the target is over, as the policy saw it coming: nothing follows.
    Finished,
}

/// What a step gave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The reward of the tick.
    pub reward: f32,
    /// Whether the episode is over; [`Environment::begin_episode`] starts the next.
    pub end: Option<End>,
}

/// One robot in training.
pub struct Environment {
    ground: Arc<TrainingGround>,
    index: u32,
    /// Index in the mix.
    terrain: usize,
    level: u32,
    segment: u64,
    episodes: u64,
    episode: Episode,
    tick: u32,
    end: Option<End>,
    path: Path,
    /// Where to go, in place of the path's velocity.
    target: Option<PositionTarget>,
    /// Ticks for which the base has been touching something without a break.
    base_contact_ticks: u32,
    /// It has touched something in this episode.
    base_has_touched: bool,
    plant: Plant,
    latency: Latency,
    command: Command,
    views: Views,
    action: Vec<f32>,
    last_action: Vec<f32>,
    targets: Vec<JointTarget>,
    joint_velocity_before: Vec<f32>,
    air_time_s: Vec<f32>,
    judge: Judge,
    shadow: Option<Shadow>,
}

impl Environment {
    /// The environment of an index, on its initial level at the start of segment 0.
    pub fn new(ground: &Arc<TrainingGround>, index: u32) -> Self {
        let terrain = ground.config.terrain_of(index);
        let stage = ground.stage(terrain, 0, 0);
        let plant = Plant::from_snapshot(&stage.spawns[0].snapshot);
        let robot = &ground.robot;
        let joints = robot.joint_count();
        let mut environment = Self {
            index,
            terrain,
            level: 0,
            segment: 0,
            episodes: 0,
            episode: Episode::draw(
                &ground.config,
                terrain,
                true,
                stream(ground.seed, "environment/episode", &[]),
            ),
            tick: 0,
            end: None,
            path: Path::from(&stage.spawns[0].base),
            target: None,
            base_contact_ticks: 0,
            base_has_touched: false,
            latency: Latency::new(0, robot, &plant.measure().joint_position_rad),
            plant,
            command: Command::velocity(0.0, 0.0, 0.0),
            views: Views::new(ground),
            action: vec![0.0; joints],
            last_action: vec![0.0; joints],
            targets: vec![JointTarget::default(); joints],
            joint_velocity_before: vec![0.0; joints],
            air_time_s: vec![0.0; robot.description.feet.len()],
            judge: Judge::new(&ground.config.reward),
            shadow: None,
            ground: Arc::clone(ground),
        };
        environment.restart(0, environment.initial_level());
        environment
    }

    /// Number of values that the policy observes.
    pub fn observation_len(&self) -> usize {
        self.views.policy.len()
    }

    /// Number of values that the critic observes.
    pub fn privileged_len(&self) -> usize {
        self.views.privileged.len()
    }

    /// Number of values of an action.
    pub fn action_len(&self) -> usize {
        self.action.len()
    }

    /// The terrain that this environment stays on.
    pub fn kind(&self) -> TerrainKind {
        self.ground.config.terrain[self.terrain].kind
    }

    /// The level of a fresh run, drawn from 0 to the configuration's `initial_level`.
    pub fn initial_level(&self) -> u32 {
        let most = self.ground.config.initial_level;
        let mut rng = stream(self.ground.seed, "environment/level", &[u64::from(self.index)]);
        (uniform(&mut rng, 0.0, (most + 1) as f32) as u32).min(most)
    }

    /// Forgets everything and starts a segment's first episode on a level.
    pub fn restart(&mut self, segment: u64, level: u32) {
        self.segment = segment;
        self.level = level.min(self.ground.config.levels - 1);
        self.episodes = 0;
        self.start_episode();
    }

    /// Moves the curriculum by the episode that ended, and starts the next one.
    ///
    /// An episode that had less than half of the full time, or less than a target is ever given, moves nothing:
    /// it says little about the level.
    pub fn begin_episode(&mut self) {
        let config = &self.ground.config;
        let enough_s = config.target.map_or(0.5 * config.episode_s, |target| target.time_s[0]);
        let enough = (f64::from(enough_s) / TICK_S) as u32;
        if let Some(end) = self.end
            && self.episode.ticks >= enough
        {
            let base = &self.plant.measure().base;
            let time_s = f64::from(self.episode.ticks) * TICK_S;
            let by_velocity_m = self.episode.rules.forward_m_per_s * time_s as f32;
            let travel = Travel {
                distance_m: self.path.displacement_m(base)[0] as f32,
                commanded_m: self.episode.target.map_or(by_velocity_m, |target| target.distance_m),
                fell: end == End::Terminated || self.base_has_touched,
                left_the_tile: self.tick < self.episode.ticks,
            };
            let draw = uniform(&mut self.stream("environment/curriculum"), 0.0, 1.0);
            self.level = curriculum::next_level(self.level, config.levels, &travel, config.curriculum, draw);
        }
        self.episodes += 1;
        self.start_episode();
    }

    /// Copies what the policy sees, noisy and by the contract, and what the critic sees.
    pub fn observe(&self, policy: &mut [f32], privileged: &mut [f32]) {
        policy.copy_from_slice(&self.views.policy);
        privileged.copy_from_slice(&self.views.privileged);
    }

    /// One policy tick of 20 ms. `action` is the network's output, in the contract's order, unclipped.
    pub fn step(&mut self, action: &[f32]) -> Step {
        let ground = Arc::clone(&self.ground);
        self.action.copy_from_slice(action);
        ground.action_map.clip(&mut self.action);
        ground.action_map.targets(&self.action, &mut self.targets);
        if let Some(velocity_in_world) = self.episode.push_at(self.tick, &ground.config) {
            self.plant.push(velocity_in_world);
        }
        self.joint_velocity_before.copy_from_slice(&self.plant.measure().joint_velocity_rad_per_s);
        let (mut deed, touched) = self.advance();
        self.tick += 1;
        self.add_motion(&mut deed);
        self.end = self.find_end(ground.stage(self.terrain, self.level, self.episode.variant), touched);
        let reward = self.judge.reward(&deed, self.end == Some(End::Terminated));
        self.last_action.copy_from_slice(&self.action);
        self.sense();
        Step { reward, end: self.end }
    }

    /// What the terrain's expert would do in the present state, as an action that asks for its torques;
    /// false if there is none or it fails.
    ///
    /// It keeps its own time as long as it is asked in every tick, whoever drives; after a tick in which
    /// it was not asked it starts anew.
    pub fn expert_action(&mut self, action: &mut [f32]) -> bool {
        let ground = Arc::clone(&self.ground);
        if !self.ask(ground.experts.get(&self.kind())) {
            return false;
        }
        let Some(targets) = self.shadow.as_ref().and_then(Shadow::latest) else { return false };
        let measured = self.plant.measure();
        let (q, qd) = (&measured.joint_position_rad, &measured.joint_velocity_rad_per_s);
        self.ground.action_map.action_of(targets, q, qd, action);
        true
    }

    /// The joint targets behind the latest [`expert_action`](Self::expert_action), if it gave one.
    pub fn expert_targets(&self) -> Option<&[JointTarget]> {
        self.shadow.as_ref()?.latest()
    }

    /// How left and right are exchanged, on a robot that is its own mirror image.
    pub fn mirror(&self) -> Option<&Mirror> {
        self.ground.mirror.as_ref()
    }

    /// The latest step's reward by term, times weight and time step.
    pub fn reward_terms(&self) -> &[(&'static str, f32)] {
        self.judge.terms()
    }

    /// Curriculum level, from 0.
    pub fn level(&self) -> u32 {
        self.level
    }

    /// The plant, for reading between steps.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// What is commanded at this tick.
    pub fn command(&self) -> &Command {
        &self.command
    }

    fn stream(&self, name: &str) -> rand_chacha::ChaCha8Rng {
        stream(self.ground.seed, name, &[u64::from(self.index), self.segment, self.episodes])
    }

    fn start_episode(&mut self) {
        let ground = Arc::clone(&self.ground);
        let rng = self.stream("environment/episode");
        self.episode = Episode::draw(&ground.config, self.terrain, self.episodes == 0, rng);
        let stage = ground.stage(self.terrain, self.level, self.episode.variant);
        let spawn = &stage.spawns[self.episode.pose];
        self.set_down(spawn);
        if let Some(before_m) = self.episode.led_to_m
            && let Some(obstacle_m) = stage.terrain.obstacle_x_m
        {
            if self.lead_to(obstacle_m - before_m) {
                let base = self.plant.measure().base;
                return self.begin_at(&base);
            }
            self.set_down(spawn);
        }
        if self.episode.start_m_per_s > 0.0 {
            let level = BasePose::from_yaw([0.0; 3], spawn.base.yaw());
            self.plant.push(level.vector_in_world([self.episode.start_m_per_s, 0.0, 0.0]));
        }
        self.begin_at(&spawn.base);
    }

    /// A settled robot, as it is in this episode.
    fn set_down(&mut self, spawn: &Spawn) {
        self.plant.restore(&spawn.snapshot);
        self.plant.vary(&self.episode.variation);
    }

    /// Tick 0 of the episode, wherever the plant is; path and target lead away from `base`.
    fn begin_at(&mut self, base: &BasePose) {
        let ground = Arc::clone(&self.ground);
        self.plant.reset_work();
        self.path = Path::from(base);
        let forward_m_per_s = self.episode.rules.forward_m_per_s;
        self.target = self
            .episode
            .target
            .map(|rule| rule.follow(None, &BaseInOdom::from(base), [forward_m_per_s, 0.0], 0.0));
        (self.base_contact_ticks, self.base_has_touched) = (0, false);
        let joints = &self.plant.measure().joint_position_rad;
        self.latency = Latency::new(self.episode.latency_ticks as usize, &ground.robot, joints);
        self.views.reset(ground.config.noise, self.episode.phase, self.stream("environment/sensors"));
        self.last_action.fill(0.0);
        self.air_time_s.fill(0.0);
        self.shadow = None;
        self.tick = 0;
        self.end = None;
        self.sense();
    }
}
