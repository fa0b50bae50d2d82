//! What the policy sees of a tick, and what the critic does.

use rand_chacha::ChaCha8Rng;
use vocaloco_plugin_api::{
    Command, RobotState, TerrainPatch,
    observation::{OBSERVATION_CLIP, Observer},
};

use super::ground::{TrainingGround, standard_patch};
use crate::{
    plant::{Measurement, Variation},
    sensing::{SensorNoise, Sensors, true_patch},
    stream::stream,
    terrain::Terrain,
};

/// Both views of the present tick, filled once, so that noise is drawn once.
pub(super) struct Views {
    sensors: Sensors,
    truth: Sensors,
    patch: TerrainPatch,
    true_heights_m: Vec<f32>,
    policy_observer: Observer,
    true_observer: Observer,
    /// The policy reads no heights, so the critic gets some of its own.
    blind: bool,
    /// By the contract, with noise.
    pub(super) policy: Vec<f32>,
    /// The same without noise, and what no robot measures.
    pub(super) privileged: Vec<f32>,
}

/// What the critic knows beyond the robot's state.
pub(super) struct Known<'a> {
    /// Of the base above the ground, less the stand's.
    pub(super) height_error_m: f32,
    pub(super) variation: &'a Variation,
    pub(super) latency_ticks: u32,
    /// By foot.
    pub(super) air_time_s: &'a [f32],
}

impl Views {
    pub(super) fn new(ground: &TrainingGround) -> Self {
        let rng = || stream(ground.seed, "environment/sensors", &[]);
        let needed = ground.observer.needs().terrain.into_option();
        Self {
            sensors: Sensors::new(ground.config.noise, rng()),
            truth: Sensors::new(SensorNoise::NONE, rng()),
            patch: needed.unwrap_or_else(|| standard_patch().terrain()),
            true_heights_m: Vec::new(),
            policy_observer: ground.observer.clone(),
            true_observer: ground.observer.clone(),
            blind: needed.is_none(),
            policy: vec![0.0; ground.observer.len()],
            privileged: Vec::new(),
        }
    }

    /// Forgets histories; a cycle that is observed starts at `phase`, and `rng` feeds the noise from here on.
    pub(super) fn reset(&mut self, noise: SensorNoise, phase: f32, rng: ChaCha8Rng) {
        self.sensors = Sensors::new(noise, rng);
        for observer in [&mut self.policy_observer, &mut self.true_observer] {
            observer.set_initial_phase(f64::from(phase));
            observer.reset();
        }
    }

    /// The robot as its noisy sensors have it.
    pub(super) fn sensed(&self, time_s: f64) -> RobotState<'_> {
        self.sensors.state(time_s)
    }

    /// Measures, and fills both views.
    pub(super) fn fill(
        &mut self,
        (terrain, measured): (&Terrain, &Measurement),
        time_s: f64,
        command: &Command,
        last_action: &[f32],
        known: &Known<'_>,
    ) {
        true_patch(terrain, &self.patch, &measured.base, &mut self.true_heights_m);
        for sensors in [&mut self.sensors, &mut self.truth] {
            sensors.measure(measured);
            sensors.look_at(&self.true_heights_m);
        }
        self.privileged.clear();
        self.privileged.resize(self.true_observer.len(), 0.0);
        let (noisy, truth) = (self.sensors.state(time_s), self.truth.state(time_s));
        let written = self.policy_observer.write(&noisy, command, last_action, &mut self.policy);
        let written =
            written.and(self.true_observer.write(&truth, command, last_action, &mut self.privileged));
        assert!(written.is_ok(), "buffers are as long as their observers say: {written:?}");
        self.add_known(measured, known);
    }

    /// Beyond the policy's terms without noise, each about 1 in size: base height, friction, mass, motor
    /// strength, latency; contact, time in the air and stumbling of each foot; and the heights of
    /// docs/method.md, where the policy has none.
    fn add_known(&mut self, measured: &Measurement, known: &Known<'_>) {
        let privileged = &mut self.privileged;
        privileged.extend([
            (5.0 * known.height_error_m).clamp(-OBSERVATION_CLIP, OBSERVATION_CLIP),
            (known.variation.friction - 0.875) / 0.375,
            known.variation.base_mass_offset_kg / 5.0,
            (known.variation.motor_strength - 1.0) / 0.1,
            known.latency_ticks as f32,
        ]);
        let flag = |on: &bool| f32::from(u8::from(*on));
        privileged.extend(measured.foot_contact.iter().map(flag));
        privileged.extend(known.air_time_s.iter().map(|time_s| (2.0 * time_s).min(2.0)));
        privileged.extend(measured.foot_stumble.iter().map(flag));
        if self.blind {
            let value = |height_m: &f32| 5.0 * (-0.5 - height_m).clamp(-1.0, 1.0);
            privileged.extend(self.true_heights_m.iter().map(value));
        }
    }
}
