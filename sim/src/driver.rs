//! A skill's plugin on a plant: what the plugin sees each tick, with sensor noise, and what the
//! plant does with its targets. Collection, optimisation and evaluation all drive through here.

use std::collections::VecDeque;

use rand_chacha::ChaCha8Rng;
use vocaloco_core::plugin::PluginInstance;
use vocaloco_plugin_api::{
    Command, Description, ErrorCode, JointTarget, RobotState, SkillError, TerrainPatch,
};

use crate::{
    physics::Physics,
    plant::Plant,
    stream::uniform,
    terrain::{Terrain, Vantage},
};

/// Physics steps to a policy tick: 200 Hz and 50 Hz.
pub const DECIMATION: usize = 4;
/// Duration of a policy tick, s.
pub const TICK_S: f64 = 0.02;

/// Half-widths of the uniform noise on what a plugin measures.
///
/// # Source
/// `legged_gym`'s rough-terrain configuration (METHOD, section 7).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorNoise {
    /// rad.
    pub joint_position_rad: f32,
    /// rad/s.
    pub joint_velocity_rad_per_s: f32,
    /// m/s.
    pub linear_velocity_m_per_s: f32,
    /// rad/s.
    pub angular_velocity_rad_per_s: f32,
    /// Of the unit vector.
    pub gravity: f32,
    /// Of every height of the plugin's terrain patch, m.
    pub patch_m: f32,
}

impl Default for SensorNoise {
    fn default() -> Self {
        Self {
            joint_position_rad: 0.01,
            joint_velocity_rad_per_s: 1.5,
            linear_velocity_m_per_s: 0.1,
            angular_velocity_rad_per_s: 0.2,
            gravity: 0.05,
            patch_m: 0.02,
        }
    }
}

impl SensorNoise {
    /// No noise at all.
    pub const NONE: Self = Self {
        joint_position_rad: 0.0,
        joint_velocity_rad_per_s: 0.0,
        linear_velocity_m_per_s: 0.0,
        angular_velocity_rad_per_s: 0.0,
        gravity: 0.0,
        patch_m: 0.0,
    };
}

/// Drives one plugin instance on one plant over one terrain.
pub struct Driver<'a, P = Plant> {
    /// The plant, for reading between ticks.
    pub plant: &'a mut P,
    terrain: &'a Terrain,
    instance: &'a mut PluginInstance,
    patch: Option<TerrainPatch>,
    noise: SensorNoise,
    rng: ChaCha8Rng,
    time_s: f64,
    seen: Seen,
    targets: Vec<JointTarget>,
    /// Targets on their way to the drives, the oldest first.
    late: VecDeque<Vec<JointTarget>>,
    /// The late targets that the drives follow.
    applied: Vec<JointTarget>,
}

/// Buffers of one observation, kept between ticks.
#[derive(Default)]
struct Seen {
    joint_position_rad: Vec<f32>,
    joint_velocity_rad_per_s: Vec<f32>,
    joint_torque_nm: Vec<f32>,
    foot_contact: Vec<u8>,
    terrain_m: Vec<f32>,
    linear_velocity: [f32; 3],
    angular_velocity: [f32; 3],
    gravity: [f32; 3],
}

impl<'a, P: Physics> Driver<'a, P> {
    /// A driver at time 0; `description` says which terrain the plugin needs, `rng` feeds the noise.
    pub fn new(
        plant: &'a mut P,
        terrain: &'a Terrain,
        instance: &'a mut PluginInstance,
        description: &Description,
        noise: SensorNoise,
        rng: ChaCha8Rng,
    ) -> Self {
        let joints = plant.measure().joint_position_rad.len();
        Self {
            plant,
            terrain,
            instance,
            patch: description.needs.terrain.into_option(),
            noise,
            rng,
            time_s: 0.0,
            seen: Seen::default(),
            targets: vec![JointTarget::default(); joints],
            late: VecDeque::new(),
            applied: Vec::new(),
        }
    }

    /// Lets targets reach the drives `ticks` late; until the first do, the stand holds the joints
    /// where they are.
    #[must_use]
    pub fn late_by(mut self, ticks: usize) -> Self {
        let stand = &self.plant.robot().stand;
        let held = self.plant.measure().joint_position_rad.iter().map(|position_rad| JointTarget {
            position_rad: *position_rad,
            stiffness_nm_per_rad: stand.stiffness_nm_per_rad,
            damping_nms_per_rad: stand.damping_nms_per_rad,
            feed_forward_nm: 0.0,
        });
        let held: Vec<JointTarget> = held.collect();
        self.late = vec![held; ticks].into();
        self
    }

    /// Resets the plugin to the plant's present state.
    ///
    /// # Errors
    /// What the plugin reports.
    pub fn start(&mut self) -> Result<(), SkillError> {
        self.observe();
        self.instance.reset(&self.seen.state(self.time_s))
    }

    /// One policy tick: observe, act, four physics steps. `after_step` runs after each of them.
    ///
    /// # Errors
    /// What the plugin reports, or targets that are not finite; the plant has not moved then.
    pub fn tick(&mut self, command: &Command, mut after_step: impl FnMut(&P)) -> Result<(), SkillError> {
        self.observe();
        self.instance.act(&self.seen.state(self.time_s), command, &mut self.targets)?;
        check_finite(&self.targets)?;
        let applied = match self.late.pop_front() {
            Some(mut due) => {
                // The buffer that is done with carries the newest targets to the end of the queue.
                std::mem::swap(&mut due, &mut self.applied);
                due.clone_from(&self.targets);
                self.late.push_back(due);
                &self.applied
            }
            None => &self.targets,
        };
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

    fn observe(&mut self) {
        let measured = self.plant.measure();
        let (noise, rng) = (&self.noise, &mut self.rng);
        let mut noisy = |value: f32, half_width: f32| {
            if half_width > 0.0 { value + uniform(rng, -half_width, half_width) } else { value }
        };
        let seen = &mut self.seen;
        refill(&mut seen.joint_position_rad, &measured.joint_position_rad, |value| {
            noisy(*value, noise.joint_position_rad)
        });
        refill(&mut seen.joint_velocity_rad_per_s, &measured.joint_velocity_rad_per_s, |value| {
            noisy(*value, noise.joint_velocity_rad_per_s)
        });
        refill(&mut seen.joint_torque_nm, &measured.joint_torque_nm, |value| *value);
        refill(&mut seen.foot_contact, &measured.foot_contact, |touching| u8::from(*touching));
        seen.linear_velocity =
            measured.base_linear_velocity.map(|value| noisy(value, noise.linear_velocity_m_per_s));
        seen.angular_velocity =
            measured.base_angular_velocity.map(|value| noisy(value, noise.angular_velocity_rad_per_s));
        seen.gravity = measured.projected_gravity.map(|value| noisy(value, noise.gravity));
        if let Some(patch) = &self.patch {
            let from = Vantage { position_m: measured.base.position_m, yaw_rad: measured.base.yaw() };
            seen.terrain_m.resize(patch.rows() * patch.columns(), f32::NAN);
            self.terrain.patch(&from, patch, &mut seen.terrain_m);
            for height in &mut seen.terrain_m {
                *height = noisy(*height, noise.patch_m);
            }
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

fn refill<T, U>(to: &mut Vec<U>, from: &[T], convert: impl FnMut(&T) -> U) {
    to.clear();
    to.extend(from.iter().map(convert));
}

impl Seen {
    fn state(&self, time_s: f64) -> RobotState<'_> {
        RobotState {
            time_s,
            joint_position_rad: self.joint_position_rad.as_slice().into(),
            joint_velocity_rad_per_s: self.joint_velocity_rad_per_s.as_slice().into(),
            joint_torque_nm: self.joint_torque_nm.as_slice().into(),
            base_linear_velocity_m_per_s: self.linear_velocity,
            base_angular_velocity_rad_per_s: self.angular_velocity,
            projected_gravity: self.gravity,
            foot_contact: self.foot_contact.as_slice().into(),
            terrain_m: self.terrain_m.as_slice().into(),
        }
    }
}
