//! One row: a scene, its field, and rollouts from its pose.

use std::sync::Arc;

use vocaloco_core::{
    heightfield::{CELLS, COLUMNS, Field, Heightfield, HeightfieldError, Noise, ROWS},
    robot::RobotModel,
};

use super::midway::{donor, in_stride, midway};
use super::{CollectConfig, CollectError};
use crate::{
    dataset::{Cost, Kind, Row},
    rollout::{Chance, Outcome, RolledSkill, Rollout, RunUp, Trial},
    scene::{Scene, row_seed},
    spawn::Spawner,
    stream::{stream, uniform},
};

/// What all rows share.
pub(super) struct Work<'a> {
    pub(super) robot: &'a Arc<RobotModel>,
    pub(super) skill: &'a RolledSkill,
    pub(super) kind: Kind,
    pub(super) config: &'a CollectConfig,
    pub(super) spawner: Spawner,
}

impl Work<'_> {
    /// The row with this number, or `None` where the data set leaves it out: a cost whose rollout
    /// ended by a base collision or a fault of the plugin.
    pub(super) fn row(&self, row: u64) -> Result<Option<Row>, CollectError> {
        self.row_and_steps(row).map(|(row, _)| row)
    }

    /// The row, and the physics steps that its settling and its rollouts took.
    pub(super) fn row_and_steps(&self, row: u64) -> Result<(Option<Row>, u64), CollectError> {
        let config = self.config;
        let seed = row_seed(config.seed, row);
        let (terrain, size_m) = config.mixture.draw(&mut stream(seed, "terrain", &[]));
        let mut scene = Scene::stage(self.robot, &self.spawner, (terrain, size_m), seed, config.plant)
            .map_err(|source| CollectError::Pose { row, source })?;
        let run_up = self.start_midway(&mut scene, seed);
        let field = noisy_field(&scene.spawn.heightfield, config.field_noise_m, seed)
            .map_err(|source| CollectError::Field { row, source })?;
        let rollouts = self.roll_out(&mut scene, run_up.as_ref(), seed);
        let steps = scene.plant.steps_taken();
        let Some(labelled) = self.label(&rollouts) else { return Ok((None, steps)) };
        let base = &scene.spawn.base;
        let [x_m, y_m, z_m] = base.position_m;
        let count = |outcome: Outcome| rollouts.iter().filter(|one| one.outcome == outcome).count() as u32;
        let mut heightfield_m = [0.0; CELLS];
        heightfield_m.copy_from_slice(scene.spawn.heightfield.cells_m.as_flattened());
        let row = Row {
            row,
            seed,
            terrain,
            size_m,
            difficulty: terrain.difficulty(size_m),
            spawn: [x_m, y_m, z_m, base.yaw()],
            spawn_attempts: scene.spawn.attempts,
            heightfield_m,
            field_m: *field.as_slice(),
            label: labelled.label,
            trainable: labelled.trainable,
            rollouts: rollouts.len() as u32,
            successes: count(Outcome::Reached),
            base_collisions: count(Outcome::BaseCollision),
            cost: labelled.cost,
        };
        Ok((Some(row), steps))
    }

    /// Moves the pose to where a rollout of the skill's own had the robot, if this row is one of the shares that
    /// begin so; gives the way up to there where the skill is to go on from it.
    fn start_midway(&self, scene: &mut Scene, seed: u64) -> Option<RunUp> {
        let config = self.config;
        let own = config.own_starts_share.unwrap_or(0.0);
        let in_stride_below = own + config.in_stride_share.unwrap_or(0.0);
        let mut rng = stream(seed, "own_start", &[]);
        let (kind, draw) = (uniform(&mut rng, 0.0, 1.0), uniform(&mut rng, 0.0, 1.0));
        let (skill, rules) = (self.skill, &config.rollout);
        let trial = Trial { terrain: &scene.terrain, spawn: &scene.spawn, skill, rules };
        let plant = &mut scene.plant;
        if kind < own {
            scene.spawn = midway(&trial, plant, &donor(seed, config), draw)?;
            return None;
        }
        if kind >= in_stride_below {
            return None;
        }
        let (spawn, run_up) = in_stride(&trial, plant, donor(seed, config), draw)?;
        scene.spawn = spawn;
        Some(run_up)
    }

    fn roll_out(&self, scene: &mut Scene, run_up: Option<&RunUp>, seed: u64) -> Vec<Rollout> {
        let config = self.config;
        let trial =
            Trial { terrain: &scene.terrain, spawn: &scene.spawn, skill: self.skill, rules: &config.rollout };
        let noise = config.sensor_noise();
        (0..config.repeats)
            .map(|repeat| {
                let chance = Chance::draw(seed, u64::from(repeat), &config.perturb, noise);
                match run_up {
                    Some(run_up) => trial.roll_in_stride(run_up, &mut scene.plant, &chance),
                    None => trial.roll_out(&mut scene.plant, &chance),
                }
            })
            .collect()
    }

    fn label(&self, rollouts: &[Rollout]) -> Option<Labelled> {
        match self.kind {
            Kind::Viability => {
                let successes = rollouts.iter().filter(|one| one.outcome == Outcome::Reached).count();
                let label = successes as f32 / rollouts.len() as f32;
                Some(Labelled { label, trainable: true, cost: None })
            }
            Kind::Cot => {
                let rollout = rollouts.first()?;
                if matches!(rollout.outcome, Outcome::BaseCollision | Outcome::Fault) {
                    return None;
                }
                let or_nan = |cot: Option<f64>| cot.map_or(f32::NAN, |cot| cot as f32);
                Some(Labelled {
                    label: or_nan(rollout.cot_positive),
                    trainable: rollout.outcome == Outcome::Reached && rollout.cot_positive.is_some(),
                    cost: Some(Cost { outcome: rollout.outcome, signed: or_nan(rollout.cot_signed) }),
                })
            }
        }
    }
}

struct Labelled {
    label: f32,
    trainable: bool,
    cost: Option<Cost>,
}

/// The field as networks see it, with a row's own noise of ± `noise_m` in every cell.
///
/// # Errors
/// When too little of the field is known.
pub(crate) fn noisy_field(
    heightfield: &Heightfield,
    noise_m: f32,
    row_seed: u64,
) -> Result<Field, HeightfieldError> {
    heightfield.prepare(Some(&field_noise(noise_m, row_seed)))
}

/// A row's own noise on its field, ± `noise_m` in every cell.
pub fn field_noise(noise_m: f32, row_seed: u64) -> Noise {
    let mut rng = stream(row_seed, "field_noise", &[]);
    let mut noise: Noise = [[0.0; COLUMNS]; ROWS];
    for cell in noise.as_flattened_mut() {
        *cell = uniform(&mut rng, -noise_m, noise_m);
    }
    noise
}
