//! One legged robot in training: it observes, is moved by a network's actions, is rewarded, falls,
//! and starts again where the curriculum puts it. Hundreds share one [`TrainingGround`].
//!
//! Knows no learner: who steps it, and on which thread, changes nothing. What it gives after
//! [`restart`](Environment::restart) depends on (seed, index, segment, level) and the actions alone.

mod config;
mod curriculum;
mod episode;
mod ground;
mod mirror;
mod reward;
mod shadow;
pub mod speed;
mod views;

#[cfg(test)]
mod tests;

use std::sync::Arc;

use vocaloco_plugin_api::{Command, JointTarget};

pub use config::{
    CommandRules, ConfigError, CurriculumRules, EnvironmentConfig, PushRules, StartRules, TerrainShare,
    VariationRules,
};
pub use ground::{EnvironmentError, TrainingGround, standard_contract};
pub use mirror::Mirror;
pub use reward::{RewardConfig, RewardTerm, RewardWeights};

use crate::{
    driver::{DECIMATION, TICK_S},
    latency::Latency,
    plant::{BasePose, GRAVITY_M_PER_S2, Plant},
    rollout::Path,
    stream::{stream, uniform},
    terrain::TerrainKind,
};
use curriculum::Travel;
use episode::Episode;
use ground::Stage;
use reward::{Deed, Judge};
use shadow::Shadow;
use views::{Known, Views};

/// An episode ends this far before the map does, m: nothing in sight is unknown.
const MAP_MARGIN_M: f32 = 1.5;
/// The ground's height is the mean over a square of this half-width around the base, m.
const GROUND_HALF_WIDTH_M: f32 = 0.25;

/// Why an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The base touched something.
    Terminated,
    /// Time was up, or the robot came to the end of the tile: nothing that the policy did wrong.
    TimedOut,
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
            episode: Episode::draw(&ground.config, true, stream(ground.seed, "environment/episode", &[])),
            tick: 0,
            end: None,
            path: Path::from(&stage.spawns[0].base),
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
    /// An episode that had less than half of the full time moves nothing: it says little about the level.
    pub fn begin_episode(&mut self) {
        let config = &self.ground.config;
        let full = (f64::from(config.episode_s) / TICK_S) as u32;
        if let Some(end) = self.end
            && self.episode.ticks >= full / 2
        {
            let base = &self.plant.measure().base;
            let time_s = f64::from(self.episode.ticks) * TICK_S;
            let travel = Travel {
                distance_m: self.path.displacement_m(base)[0] as f32,
                commanded_m: self.episode.rules.forward_m_per_s * time_s as f32,
                fell: end == End::Terminated,
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
        if self.shadow.is_none() {
            let Some(skill) = ground.experts.get(&self.kind()) else { return false };
            let rng = self.stream("environment/expert");
            let noise_m = ground.config.expert_patch_noise_m;
            self.shadow = Shadow::new(skill, self.episode.phase, &ground.robot, noise_m, rng);
        }
        let Some(shadow) = &mut self.shadow else { return false };
        let measured = self.plant.measure();
        let terrain = &ground.stage(self.terrain, self.level, self.episode.variant).terrain;
        let state = self.views.sensed(f64::from(self.tick) * TICK_S);
        let Some(targets) = shadow.targets(self.tick, &state, &self.command, terrain, &measured.base) else {
            return false;
        };
        let (q, qd) = (&measured.joint_position_rad, &measured.joint_velocity_rad_per_s);
        ground.action_map.action_of(targets, q, qd, action);
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
        let config = &ground.config;
        self.episode = Episode::draw(config, self.episodes == 0, self.stream("environment/episode"));
        let stage = ground.stage(self.terrain, self.level, self.episode.variant);
        let spawn = &stage.spawns[self.episode.pose];
        self.plant.restore(&spawn.snapshot);
        self.plant.vary(&self.episode.variation);
        self.plant.reset_work();
        self.path = Path::from(&spawn.base);
        if self.episode.start_m_per_s > 0.0 {
            let level = BasePose::from_yaw([0.0; 3], spawn.base.yaw());
            self.plant.push(level.vector_in_world([self.episode.start_m_per_s, 0.0, 0.0]));
        }
        let joints = &self.plant.measure().joint_position_rad;
        self.latency = Latency::new(self.episode.latency_ticks as usize, &ground.robot, joints);
        self.views.reset(config.noise, self.episode.phase, self.stream("environment/sensors"));
        self.last_action.fill(0.0);
        self.air_time_s.fill(0.0);
        self.shadow = None;
        self.tick = 0;
        self.end = None;
        self.sense();
    }

    /// Four physics steps under the targets that arrive; what they did, and whether the base touched.
    fn advance(&mut self) -> (Deed, bool) {
        let targets = self.latency.pass(&self.targets);
        let limit = self.plant.robot().drive.velocity_limit_rad_per_s;
        let work_before_j = self.plant.positive_work_j();
        let share = 1.0 / DECIMATION as f32;
        let mut deed = Deed::default();
        let mut touched = false;
        let (mut contacts, mut stumbles) = (0_u32, 0_u32);
        for _ in 0..DECIMATION {
            self.plant.step(targets);
            let measured = self.plant.measure();
            touched |= measured.base_contact;
            deed.limb_contact_share += if measured.nonfoot_contact { share } else { 0.0 };
            for (torque, speed) in measured.joint_torque_nm.iter().zip(&measured.joint_velocity_rad_per_s) {
                deed.torque_squared += torque * torque * share;
                deed.overspeed_rad_per_s += (speed.abs() - limit).max(0.0) * share;
            }
            for (foot, (touches, stumble)) in
                measured.foot_contact.iter().zip(&measured.foot_stumble).enumerate()
            {
                contacts |= u32::from(*touches) << foot;
                stumbles |= u32::from(*stumble) << foot;
            }
        }
        let work_j = (self.plant.positive_work_j() - work_before_j) as f32;
        deed.power_per_weight = work_j / (TICK_S as f32 * self.plant.total_mass_kg() * GRAVITY_M_PER_S2);
        deed.stumbles = stumbles.count_ones() as f32;
        for (foot, air_time_s) in self.air_time_s.iter_mut().enumerate() {
            let touches = contacts >> foot & 1 == 1;
            if touches && *air_time_s > 0.0 {
                deed.air_time_s += *air_time_s + TICK_S as f32 - self.ground.config.reward.air_time_s;
            }
            *air_time_s = if touches { 0.0 } else { *air_time_s + TICK_S as f32 };
        }
        (deed, touched)
    }

    /// The rest of what the tick did: how the robot moves at its end.
    fn add_motion(&self, deed: &mut Deed) {
        let measured = self.plant.measure();
        let [x, y, _] = measured.base.vector_in_world(measured.base_linear_velocity);
        let yaw = measured.base.yaw();
        let (sin, cos) = (libm::sinf(yaw), libm::cosf(yaw));
        deed.command = self.command.velocity;
        deed.velocity_in_yaw = [cos * x + sin * y, cos * y - sin * x];
        deed.vertical_m_per_s = measured.base_linear_velocity[2];
        deed.angular_velocity = measured.base_angular_velocity;
        deed.heading_error_rad = self.path.heading_error_rad(&measured.base);
        deed.projected_gravity = measured.projected_gravity;
        deed.height_error_m = self.height_error_m();
        let changes = measured.joint_velocity_rad_per_s.iter().zip(&self.joint_velocity_before);
        deed.joint_acceleration_squared =
            changes.map(|(after, before)| ((after - before) / TICK_S as f32).powi(2)).sum();
        deed.action_change_squared =
            self.action.iter().zip(&self.last_action).map(|(now, last)| (now - last).powi(2)).sum();
    }

    /// Height of the base over the ground around it, less the stand's.
    fn height_error_m(&self) -> f32 {
        let terrain = &self.ground.stage(self.terrain, self.level, self.episode.variant).terrain;
        let [x_m, y_m, z_m] = self.plant.measure().base.position_m;
        let steps = [-GROUND_HALF_WIDTH_M, 0.0, GROUND_HALF_WIDTH_M];
        let column = |dx: f32| steps.map(|dy| terrain.height_m(x_m + dx, y_m + dy)).iter().sum::<f32>();
        let ground_m = steps.map(column).iter().sum::<f32>() / 9.0;
        z_m - ground_m - self.ground.robot.description.stand_height_m as f32
    }

    fn find_end(&self, stage: &Stage, base_touched: bool) -> Option<End> {
        let [x_m, y_m, z_m] = self.plant.measure().base.position_m;
        if base_touched || !(x_m + y_m + z_m).is_finite() {
            return Some(End::Terminated);
        }
        let terrain = &stage.terrain;
        let inside = [(x_m, 0), (y_m, 1)].into_iter().all(|(at_m, axis)| {
            at_m >= terrain.min_m[axis] + MAP_MARGIN_M && at_m <= terrain.max_m[axis] - MAP_MARGIN_M
        });
        (self.tick >= self.episode.ticks || !inside).then_some(End::TimedOut)
    }

    /// The command, and both views of the present tick.
    fn sense(&mut self) {
        let ground = Arc::clone(&self.ground);
        let terrain = &ground.stage(self.terrain, self.level, self.episode.variant).terrain;
        let known = Known {
            height_error_m: self.height_error_m(),
            variation: &self.episode.variation,
            latency_ticks: self.episode.latency_ticks,
            air_time_s: &self.air_time_s,
        };
        let measured = self.plant.measure();
        self.command = self.path.command(&measured.base, &self.episode.rules);
        let time_s = f64::from(self.tick) * TICK_S;
        self.views.fill((terrain, measured), time_s, &self.command, &self.last_action, &known);
    }
}
