//! What a robot's sensors make of a plant: true values with uniform noise, in the form that plugins
//! and networks read. Drivers, pilots and training environments all see through here.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use vocaloco_plugin_api::{RobotState, TerrainPatch};

use crate::{
    plant::{BasePose, Measurement},
    stream::uniform,
    terrain::{Terrain, Vantage},
};

/// Half-widths of the uniform noise on what a plugin measures.
///
/// # Source
/// `legged_gym`'s rough-terrain configuration (docs/method.md).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
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

/// The sensors of one robot, and their latest readings.
///
/// Noise is drawn for every value each time it is measured, in the order of the fields of
/// [`Readings`]; a half-width of zero draws nothing.
pub struct Sensors {
    noise: SensorNoise,
    rng: ChaCha8Rng,
    readings: Readings,
}

/// What was measured last, by the conventions of [`RobotState`].
#[derive(Clone, Debug, Default)]
#[allow(missing_docs, reason = "fields of the same name in RobotState")]
pub struct Readings {
    pub joint_position_rad: Vec<f32>,
    pub joint_velocity_rad_per_s: Vec<f32>,
    pub joint_torque_nm: Vec<f32>,
    pub foot_contact: Vec<u8>,
    pub base_linear_velocity_m_per_s: [f32; 3],
    pub base_angular_velocity_rad_per_s: [f32; 3],
    pub projected_gravity: [f32; 3],
    pub terrain_m: Vec<f32>,
}

impl Sensors {
    /// Sensors that have measured nothing yet; `rng` feeds their noise.
    pub fn new(noise: SensorNoise, rng: ChaCha8Rng) -> Self {
        Self { noise, rng, readings: Readings::default() }
    }

    /// Measures joints, base and feet. Torques and contacts have no noise.
    pub fn measure(&mut self, measured: &Measurement) {
        let (noise, rng) = (&self.noise, &mut self.rng);
        let mut noisy = |value: f32, half_width: f32| noisy(rng, value, half_width);
        let readings = &mut self.readings;
        refill(&mut readings.joint_position_rad, &measured.joint_position_rad, |value| {
            noisy(*value, noise.joint_position_rad)
        });
        refill(&mut readings.joint_velocity_rad_per_s, &measured.joint_velocity_rad_per_s, |value| {
            noisy(*value, noise.joint_velocity_rad_per_s)
        });
        refill(&mut readings.joint_torque_nm, &measured.joint_torque_nm, |value| *value);
        refill(&mut readings.foot_contact, &measured.foot_contact, |touching| u8::from(*touching));
        readings.base_linear_velocity_m_per_s =
            measured.base_linear_velocity.map(|value| noisy(value, noise.linear_velocity_m_per_s));
        readings.base_angular_velocity_rad_per_s =
            measured.base_angular_velocity.map(|value| noisy(value, noise.angular_velocity_rad_per_s));
        readings.projected_gravity = measured.projected_gravity.map(|value| noisy(value, noise.gravity));
    }

    /// Measures the terrain around a base.
    pub fn look(&mut self, terrain: &Terrain, patch: &TerrainPatch, base: &BasePose) {
        true_patch(terrain, patch, base, &mut self.readings.terrain_m);
        for height_m in &mut self.readings.terrain_m {
            *height_m = noisy(&mut self.rng, *height_m, self.noise.patch_m);
        }
    }

    /// As [`look`](Self::look), where the true heights are known already.
    pub fn look_at(&mut self, true_m: &[f32]) {
        let (half_width_m, rng) = (self.noise.patch_m, &mut self.rng);
        refill(&mut self.readings.terrain_m, true_m, |height_m| noisy(rng, *height_m, half_width_m));
    }

    /// A height with the patch's noise.
    pub fn height_m(&mut self, true_m: f32) -> f32 {
        noisy(&mut self.rng, true_m, self.noise.patch_m)
    }

    /// The latest readings.
    pub fn readings(&self) -> &Readings {
        &self.readings
    }

    /// The latest readings, as plugins take them.
    pub fn state(&self, time_s: f64) -> RobotState<'_> {
        let readings = &self.readings;
        RobotState {
            time_s,
            joint_position_rad: readings.joint_position_rad.as_slice().into(),
            joint_velocity_rad_per_s: readings.joint_velocity_rad_per_s.as_slice().into(),
            joint_torque_nm: readings.joint_torque_nm.as_slice().into(),
            base_linear_velocity_m_per_s: readings.base_linear_velocity_m_per_s,
            base_angular_velocity_rad_per_s: readings.base_angular_velocity_rad_per_s,
            projected_gravity: readings.projected_gravity,
            foot_contact: readings.foot_contact.as_slice().into(),
            terrain_m: readings.terrain_m.as_slice().into(),
        }
    }
}

/// The true heights of a patch around a base, by the conventions of [`RobotState::terrain_m`].
pub fn true_patch(terrain: &Terrain, patch: &TerrainPatch, base: &BasePose, heights_m: &mut Vec<f32>) {
    let from = Vantage { position_m: base.position_m, yaw_rad: base.yaw() };
    heights_m.resize(patch.rows() * patch.columns(), f32::NAN);
    terrain.patch(&from, patch, heights_m);
}

fn noisy(rng: &mut ChaCha8Rng, value: f32, half_width: f32) -> f32 {
    if half_width > 0.0 { value + uniform(rng, -half_width, half_width) } else { value }
}

fn refill<T, U>(to: &mut Vec<U>, from: &[T], convert: impl FnMut(&T) -> U) {
    to.clear();
    to.extend(from.iter().map(convert));
}

#[cfg(test)]
mod tests {
    use std::{path::Path, sync::Arc};

    use vocaloco_core::robot::RobotModel;

    use super::*;
    use crate::{
        plant::{Plant, PlantKind},
        stream::stream,
        terrain::TerrainKind,
    };

    const PATCH: TerrainPatch =
        TerrainPatch { back_m: 0.4, front_m: 0.8, half_width_m: 0.3, resolution_m: 0.1 };

    /// A robot in mid-air over stairs, moving: nothing about it is zero or symmetric.
    fn moving() -> (Terrain, Plant) {
        let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        let robot = Arc::new(RobotModel::load(&robots, "anymal_d").unwrap());
        let terrain = Terrain::tile(TerrainKind::StairsUp, 0.15, 1);
        let mut plant = Plant::new(&robot, &terrain, PlantKind::Fast);
        let base = BasePose::from_roll_pitch_yaw([2.0, 0.1, 1.5], 0.1, -0.2, 0.4);
        plant.place(&base, &robot.stand_position_rad());
        plant.push([0.4, -0.3, 0.1]);
        (terrain, plant)
    }

    fn values(readings: &Readings) -> Vec<f32> {
        let Readings { joint_position_rad, joint_velocity_rad_per_s, terrain_m, .. } = readings;
        let mut values = [joint_position_rad.as_slice(), joint_velocity_rad_per_s, terrain_m].concat();
        values.extend(readings.base_linear_velocity_m_per_s);
        values.extend(readings.base_angular_velocity_rad_per_s);
        values.extend(readings.projected_gravity);
        values
    }

    fn read(noise: SensorNoise) -> Readings {
        let (terrain, plant) = moving();
        let mut sensors = Sensors::new(noise, stream(1, "sensors", &[]));
        sensors.measure(plant.measure());
        sensors.look(&terrain, &PATCH, &plant.measure().base);
        sensors.readings().clone()
    }

    #[test]
    fn without_noise_the_readings_are_the_plants_own() {
        let (terrain, plant) = moving();
        let readings = read(SensorNoise::NONE);
        let measured = plant.measure();
        assert_eq!(readings.joint_position_rad, measured.joint_position_rad);
        assert_eq!(readings.base_linear_velocity_m_per_s, measured.base_linear_velocity);
        assert_eq!(readings.projected_gravity, measured.projected_gravity);
        let mut heights_m = Vec::new();
        true_patch(&terrain, &PATCH, &measured.base, &mut heights_m);
        assert_eq!(readings.terrain_m, heights_m);
        assert!(heights_m.iter().any(|height_m| *height_m > heights_m[0] + 0.1), "a step is in sight");
    }

    #[test]
    fn noise_stays_inside_its_half_width_and_touches_every_value() {
        let (with, without) = (read(SensorNoise::default()), read(SensorNoise::NONE));
        for (index, (noisy, truth)) in values(&with).iter().zip(values(&without)).enumerate() {
            assert!(*noisy != truth, "value {index} has no noise");
            assert!((noisy - truth).abs() <= 1.5, "value {index}: {noisy} for {truth}");
        }
        for (noisy, truth) in with.terrain_m.iter().zip(&without.terrain_m) {
            assert!((noisy - truth).abs() <= 0.02);
        }
    }

    #[test]
    fn looking_at_known_heights_is_looking() {
        let (terrain, plant) = moving();
        let mut heights_m = Vec::new();
        true_patch(&terrain, &PATCH, &plant.measure().base, &mut heights_m);
        let mut sensors = Sensors::new(SensorNoise::default(), stream(1, "sensors", &[]));
        sensors.measure(plant.measure());
        sensors.look_at(&heights_m);
        assert_eq!(values(sensors.readings()), values(&read(SensorNoise::default())));
    }
}
