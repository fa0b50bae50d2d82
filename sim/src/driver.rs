//! A skill's plugin on a plant: what the plugin sees each tick, with sensor noise, and what the
//! plant does with its targets. Collection, optimisation and evaluation all drive through here.

use rand_chacha::ChaCha8Rng;
use vocaloco_core::{
    observation::BaseInOdom,
    plugin::PluginInstance,
    target::{PositionTarget, TargetRule},
};
use vocaloco_plugin_api::{Command, ErrorCode, JointTarget, SkillError, TerrainPatch};

pub use crate::sensing::SensorNoise;
use crate::{latency::Latency, physics::Physics, plant::Plant, sensing::Sensors, terrain::Terrain};

/// Physics steps to a policy tick: 200 Hz and 50 Hz.
pub const DECIMATION: usize = 4;
/// Duration of a policy tick, s.
pub const TICK_S: f64 = 0.02;

/// Drives one plugin instance on one plant over one terrain.
pub struct Driver<'a, P = Plant> {
    /// The plant, for reading between ticks.
    pub plant: &'a mut P,
    terrain: &'a Terrain,
    instance: &'a mut PluginInstance,
    patch: Option<TerrainPatch>,
    aim: Option<TargetRule>,
    /// Where the skill is going, if it takes targets and is on its way.
    target: Option<PositionTarget>,
    sensors: Sensors,
    time_s: f64,
    targets: Vec<JointTarget>,
    latency: Latency,
}

impl<'a, P: Physics> Driver<'a, P> {
    /// A driver at time 0; `rng` feeds the noise.
    pub fn new(
        plant: &'a mut P,
        terrain: &'a Terrain,
        instance: &'a mut PluginInstance,
        noise: SensorNoise,
        rng: ChaCha8Rng,
    ) -> Self {
        let joints = plant.measure().joint_position_rad.len();
        Self {
            plant,
            terrain,
            patch: instance.needs().terrain.into_option(),
            instance,
            aim: None,
            target: None,
            sensors: Sensors::new(noise, rng),
            time_s: 0.0,
            targets: vec![JointTarget::default(); joints],
            latency: Latency::default(),
        }
    }

    /// Gives the plugin position targets by this rule, as the runtime does, in place of the velocities that
    /// [`tick`](Self::tick) is told; the odometry frame is the world.
    #[must_use]
    pub fn aiming(mut self, rule: Option<TargetRule>) -> Self {
        self.aim = rule;
        self
    }

    /// Lets targets reach the drives `ticks` late; until the first do, the stand holds the joints
    /// where they are.
    #[must_use]
    pub fn late_by(mut self, ticks: usize) -> Self {
        self.latency = Latency::new(ticks, self.plant.robot(), &self.plant.measure().joint_position_rad);
        self
    }

    /// Draws the noise anew from here on.
    pub fn sense_with(&mut self, noise: SensorNoise, rng: ChaCha8Rng) {
        self.sensors = Sensors::new(noise, rng);
    }

    /// Resets the plugin to the plant's present state; a position target is set at the next tick.
    ///
    /// # Errors
    /// What the plugin reports.
    pub fn start(&mut self) -> Result<(), SkillError> {
        self.target = None;
        self.observe();
        self.instance.reset(&self.sensors.state(self.time_s))
    }

    /// Lets another plugin drive from here on, reset to the plant's present state and
    /// [`aiming`](Self::aiming) by its own rule. Time goes on, sensors stay, and targets on their way still
    /// arrive.
    ///
    /// # Errors
    /// What the plugin reports.
    pub fn hand_over(
        &mut self,
        instance: &'a mut PluginInstance,
        rule: Option<TargetRule>,
    ) -> Result<(), SkillError> {
        self.patch = instance.needs().terrain.into_option();
        self.instance = instance;
        self.aim = rule;
        if self.patch.is_none() {
            self.sensors.look_at(&[]);
        }
        self.start()
    }

    /// One policy tick: observe, act, four physics steps. `after_step` runs after each of them.
    ///
    /// `command` is a velocity; a plugin that takes targets is told the way to its own, which is set along
    /// that velocity.
    ///
    /// # Errors
    /// What the plugin reports, or targets that are not finite; the plant has not moved then.
    pub fn tick(&mut self, command: &Command, mut after_step: impl FnMut(&P)) -> Result<(), SkillError> {
        self.observe();
        let told = self.told(command);
        self.instance.act(&self.sensors.state(self.time_s), &told, &mut self.targets)?;
        check_finite(&self.targets)?;
        let applied = self.latency.pass(&self.targets);
        for _ in 0..DECIMATION {
            self.plant.step(applied);
            after_step(self.plant);
        }
        self.time_s += TICK_S;
        Ok(())
    }

    /// The targets of the latest tick.
    pub fn targets(&self) -> &[JointTarget] {
        &self.targets
    }

    fn told(&mut self, asked: &Command) -> Command {
        let Some(rule) = self.aim else { return *asked };
        let base = BaseInOdom::from(&self.plant.measure().base);
        let [forward, left, _] = asked.velocity;
        let target = rule.follow(self.target, &base, [forward, left], self.time_s);
        self.target = Some(target);
        target.command(&base, asked.velocity, self.time_s)
    }

    fn observe(&mut self) {
        let measured = self.plant.measure();
        self.sensors.measure(measured);
        if let Some(patch) = &self.patch {
            self.sensors.look(self.terrain, patch, &measured.base);
        }
    }
}

fn check_finite(targets: &[JointTarget]) -> Result<(), SkillError> {
    for (joint, target) in targets.iter().enumerate() {
        let JointTarget { position_rad, stiffness_nm_per_rad, damping_nms_per_rad, feed_forward_nm } =
            *target;
        let parts = [position_rad, stiffness_nm_per_rad, damping_nms_per_rad, feed_forward_nm];
        if !parts.iter().all(|part| part.is_finite()) {
            let message = format!("target of joint {joint}: found {target:?}, wanted finite numbers");
            return Err(SkillError::new(ErrorCode::Internal, message));
        }
    }
    Ok(())
}
