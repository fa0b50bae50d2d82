//! Viability by the protocol (docs/method.md): one rollout per fresh pose, and what a table row
//! says about them.

use std::sync::Arc;

use rayon::prelude::*;
use serde::Serialize;
use vocaloco_core::{heightfield::Field, robot::RobotModel};

use crate::{
    collect::{CollectError, noisy_field},
    driver::SensorNoise,
    identity,
    plant::PlantKind,
    rollout::{
        CRUISE_FROM_S, Chance, Motion, Outcome, Perturbations, RolledSkill, Rollout, RolloutRules, Trial,
    },
    scene::{Scene, row_seed},
    spawn::{SpawnRules, Spawner},
    stream::derived_seed,
    terrain::TerrainKind,
};

/// One cell of a table: a terrain, a size, and how many poses.
#[derive(Clone, Debug)]
pub struct Query {
    /// Terrain.
    pub terrain: TerrainKind,
    /// Its size, m.
    pub size_m: f32,
    /// Number of fresh poses.
    pub samples: u64,
    /// Seed; poses and terrains depend on it and on the two above, never on the skill.
    pub seed: u64,
    /// What is asked of the skill.
    pub rules: RolloutRules,
    /// Poses.
    pub spawn: SpawnRules,
    /// What is drawn for each rollout.
    pub perturb: Perturbations,
    /// Half-width of the noise on the plugin's terrain patch, m.
    pub patch_noise_m: f32,
    /// Half-width of the noise on the predictors' field, m.
    pub field_noise_m: f32,
    /// Which plant.
    pub plant: PlantKind,
}

impl Query {
    /// The protocol, with yaw ± 0.3 rad on directed terrain.
    pub fn new(terrain: TerrainKind, size_m: f32, samples: u64, seed: u64) -> Self {
        Self {
            terrain,
            size_m,
            samples,
            seed,
            rules: RolloutRules::default(),
            spawn: SpawnRules { any_yaw_share: 0.0, ..SpawnRules::default() },
            perturb: Perturbations::protocol(),
            patch_noise_m: 0.02,
            field_noise_m: 0.1,
            plant: PlantKind::Reference,
        }
    }
}

/// A fresh pose, what it sees, and the rollout from it.
#[derive(Clone, Debug)]
pub struct Sample {
    /// The field as networks see it, noise included.
    pub field: Field,
    /// The rollout.
    pub rollout: Rollout,
}

/// The scenes and draws of a query, by row.
pub(crate) struct Staging<'a> {
    robot: &'a Arc<RobotModel>,
    query: &'a Query,
    spawner: Spawner,
    seed: u64,
}

impl<'a> Staging<'a> {
    pub(crate) fn new(robot: &'a Arc<RobotModel>, query: &'a Query) -> Self {
        let index = [query.terrain as u64, u64::from(query.size_m.to_bits())];
        let seed = derived_seed(query.seed, "evaluate", &index);
        Self { robot, query, spawner: Spawner::new(robot, query.spawn), seed }
    }

    /// A row's seed, and the robot standing in its pose.
    pub(crate) fn row(&self, row: u64) -> Result<(u64, Scene), CollectError> {
        let Query { terrain, size_m, plant, .. } = *self.query;
        let seed = row_seed(self.seed, row);
        let scene = Scene::stage(self.robot, &self.spawner, (terrain, size_m), seed, plant)
            .map_err(|source| CollectError::Pose { row, source })?;
        Ok((seed, scene))
    }

    /// What is drawn for the one rollout of a row.
    pub(crate) fn chance(&self, row_seed: u64) -> Chance {
        let noise = SensorNoise { patch_m: self.query.patch_noise_m, ..SensorNoise::default() };
        Chance::draw(row_seed, 0, &self.query.perturb, noise)
    }
}

/// Rolls a skill out from fresh poses, in parallel on the current rayon pool, in the order of the
/// poses; `progress` is called once for each, from any thread.
///
/// # Errors
/// When no valid pose is found, or its field is mostly unknown.
pub fn sample(
    robot: &Arc<RobotModel>,
    skill: &RolledSkill,
    query: &Query,
    progress: &(dyn Fn() + Sync),
) -> Result<Vec<Sample>, CollectError> {
    let staging = Staging::new(robot, query);
    let one = |row: usize| {
        let row = row as u64;
        let (seed, mut scene) = staging.row(row)?;
        let field = noisy_field(&scene.spawn.heightfield, query.field_noise_m, seed)
            .map_err(|source| CollectError::Field { row, source })?;
        let trial = Trial { terrain: &scene.terrain, spawn: &scene.spawn, skill, rules: &query.rules };
        let rollout = trial.roll_out(&mut scene.plant, &staging.chance(seed));
        progress();
        Ok(Sample { field, rollout })
    };
    (0..query.samples as usize).into_par_iter().with_max_len(1).map(one).collect()
}

/// A row of `evaluate viability`.
#[derive(Clone, Debug, Serialize)]
pub struct ViabilityRow {
    /// Skill.
    pub skill: String,
    /// Terrain.
    pub terrain: TerrainKind,
    /// Its size, m.
    pub size_m: f32,
    /// Number of rollouts.
    pub n: u64,
    /// Share that reached the horizon.
    pub viable: f64,
    /// Lower end of its 95 % interval.
    pub viable_low: f64,
    /// Upper end of its 95 % interval.
    pub viable_high: f64,
    /// Share that ended by a contact of the base.
    pub base_collision: f64,
    /// Share that ran out of time, off the path or not.
    pub timeout: f64,
    /// Share that the plugin ended by an error or by targets that are not numbers.
    pub fault: f64,
    /// Mean cost of transport of those that reached the horizon, positive work.
    pub cot_mean: Option<f64>,
    /// Its standard deviation.
    pub cot_std: Option<f64>,
    /// Distance asked for, m.
    pub horizon_m: f64,
    /// Time allowed, s.
    pub time_limit_s: f64,
    /// What was drawn for each rollout.
    pub perturb: String,
    /// Plant.
    pub plant: String,
    /// Physics engine.
    pub simulator: String,
    /// Displacement ahead over time, all rollouts together.
    pub mean_speed_m_per_s: f64,
    /// Displacement ahead over time after the first second, of those that reached the horizon later.
    pub cruise_speed_m_per_s: Option<f64>,
    /// 99th percentile of absolute joint torque.
    pub torque_p99_nm: f64,
    /// 99th percentile of absolute joint speed.
    pub speed_p99_rad_per_s: f64,
    /// Share of joint samples beyond the drive's speed limit.
    pub speed_over_limit_share: f64,
    /// Share of physics steps in which something other than a foot touched.
    pub nonfoot_contact_share: f64,
    /// Mean absolute rate of change of the joints' targets, rad/s.
    pub action_rate: f64,
    /// Half-width of the noise on the plugin's terrain patch, m.
    pub patch_noise_m: f32,
}

/// Puts samples into a row.
pub fn summarise(skill: &RolledSkill, query: &Query, samples: &[Sample]) -> ViabilityRow {
    let rollouts: Vec<&Rollout> = samples.iter().map(|sample| &sample.rollout).collect();
    summarise_rollouts(skill, query, &rollouts)
}

/// Puts rollouts into a row, as made by rapier.
pub fn summarise_rollouts(skill: &RolledSkill, query: &Query, rollouts: &[&Rollout]) -> ViabilityRow {
    let n = rollouts.len();
    let rollouts = || rollouts.iter().copied();
    let count = |outcomes: &[Outcome]| rollouts().filter(|one| outcomes.contains(&one.outcome)).count();
    let share = |outcomes: &[Outcome]| if n == 0 { 0.0 } else { count(outcomes) as f64 / n as f64 };
    let reached = count(&[Outcome::Reached]);
    let [viable_low, viable_high] = wilson(reached, n);
    let costs: Vec<f64> =
        rollouts().filter(|one| one.outcome == Outcome::Reached).filter_map(|one| one.cot_positive).collect();
    let mut motion = Motion::new(0.0);
    for rollout in rollouts() {
        motion.merge(&rollout.motion);
    }
    let duration_s: f64 = rollouts().map(|one| one.duration_s).sum();
    let distance_m: f64 = rollouts().map(|one| one.distance_m).sum();
    let simulator = identity::simulator(query.plant);
    ViabilityRow {
        skill: skill.name.clone(),
        terrain: query.terrain,
        size_m: query.size_m,
        n: n as u64,
        viable: share(&[Outcome::Reached]),
        viable_low,
        viable_high,
        base_collision: share(&[Outcome::BaseCollision]),
        timeout: share(&[Outcome::Timeout, Outcome::OffPath]),
        fault: share(&[Outcome::Fault]),
        cot_mean: mean(&costs),
        cot_std: standard_deviation(&costs),
        horizon_m: query.rules.horizon_m,
        time_limit_s: query.rules.time_limit_s,
        perturb: query.perturb.to_string(),
        plant: query.plant.id().to_owned(),
        simulator: format!("{} {}", simulator.name, simulator.version),
        mean_speed_m_per_s: if duration_s > 0.0 { distance_m / duration_s } else { 0.0 },
        cruise_speed_m_per_s: cruise_speed_m_per_s(rollouts()),
        torque_p99_nm: motion.torque_nm.quantile(0.99),
        speed_p99_rad_per_s: motion.speed_rad_per_s.quantile(0.99),
        speed_over_limit_share: motion.speed_over_limit_share(),
        nonfoot_contact_share: motion.nonfoot_contact_share(),
        action_rate: motion.action_rate_rad_per_s(),
        patch_noise_m: query.patch_noise_m,
    }
}

/// Speed ahead once the robot has its speed, of rollouts that reached the horizon; `None` when all of
/// those were over within [`CRUISE_FROM_S`].
///
/// ```text
/// v = Σ_rollout (d_end − d(t₁)) / Σ_rollout (t_end − t₁),   t₁ = 1 s
/// ```
fn cruise_speed_m_per_s<'a>(rollouts: impl Iterator<Item = &'a Rollout>) -> Option<f64> {
    let (mut distance_m, mut duration_s) = (0.0, 0.0);
    for rollout in rollouts.filter(|one| one.outcome == Outcome::Reached) {
        if let Some(from_m) = rollout.cruise_from_m {
            distance_m += rollout.distance_m - from_m;
            duration_s += rollout.duration_s - CRUISE_FROM_S;
        }
    }
    (duration_s > 0.0).then(|| distance_m / duration_s)
}

/// Wilson's 95 % interval of a share.
///
/// ```text
/// (p + z²/2n ± z·√(p(1 − p)/n + z²/4n²)) / (1 + z²/n),   z = 1.96
/// ```
///
/// # Source
/// E. B. Wilson, J. Am. Stat. Assoc. 22 (1927).
pub fn wilson(successes: usize, n: usize) -> [f64; 2] {
    if n == 0 {
        return [0.0, 1.0];
    }
    let z = 1.959_964;
    let (n, p) = (n as f64, successes as f64 / n as f64);
    let centre = p + z * z / (2.0 * n);
    let half = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    let scale = 1.0 + z * z / n;
    [((centre - half) / scale).max(0.0), ((centre + half) / scale).min(1.0)]
}

pub(crate) fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

pub(crate) fn standard_deviation(values: &[f64]) -> Option<f64> {
    let mean = mean(values)?;
    let square: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (values.len() > 1).then(|| (square / (values.len() - 1) as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilsons_interval_has_its_published_values() {
        // 98.1 % is the lower end when all of 200 succeed.
        let [low, high] = wilson(200, 200);
        assert!((low - 0.98115).abs() < 1e-4 && high > 1.0 - 1e-9, "{low} {high}");
        let [low, high] = wilson(5, 10);
        assert!((low - 0.23659).abs() < 1e-4 && (high - 0.76341).abs() < 1e-4, "{low} {high}");
        assert_eq!(wilson(0, 0), [0.0, 1.0]);
    }

    #[test]
    fn cruising_speed_leaves_out_the_first_second_and_what_did_not_arrive() {
        let rollout = |outcome, duration_s, distance_m, cruise_from_m| Rollout {
            outcome,
            duration_s,
            distance_m,
            cruise_from_m,
            cot_positive: None,
            cot_signed: None,
            motion: Motion::new(8.5),
        };
        let rollouts = [
            rollout(Outcome::Reached, 3.0, 1.5, Some(0.3)),
            rollout(Outcome::Reached, 2.0, 1.5, Some(0.7)),
            rollout(Outcome::Reached, 0.9, 1.5, None),
            rollout(Outcome::Timeout, 4.0, 0.2, Some(0.1)),
        ];
        // 1.2 m in 2 s and 0.8 m in 1 s.
        let speed = cruise_speed_m_per_s(rollouts.iter()).unwrap();
        assert!((speed - 2.0 / 3.0).abs() < 1e-12, "{speed}");
        assert_eq!(cruise_speed_m_per_s(rollouts[2..].iter()), None);
    }

    #[test]
    fn the_deviation_is_the_samples_own() {
        assert_eq!(standard_deviation(&[1.0, 3.0]), Some(std::f64::consts::SQRT_2));
        assert_eq!(standard_deviation(&[1.0]), None);
        assert_eq!(mean(&[]), None);
    }
}
