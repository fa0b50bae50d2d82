//! Episodes that candidates are scored on: settled poses on drawn terrain, rolled out by the
//! protocol with drawn friction, mass, gait phase and sensor noise, every candidate from the same ones.

use std::{fmt, sync::Arc};

use rayon::prelude::*;
use serde::Serialize;
use vocaloco_core::robot::RobotModel;
use vocaloco_sim::{
    driver::SensorNoise,
    plant::{Plant, PlantKind},
    rollout::{Chance, Outcome, Perturbations, RolledSkill, Rollout, RolloutRules, Trial},
    spawn::{Spawn, SpawnRules, Spawner},
    stream::{derived_seed, stream, uniform},
    terrain::Terrain,
};

use super::config::{Objective, SearchConfig};

/// The plant that candidates are scored on.
pub(super) const SEARCH_PLANT: PlantKind = PlantKind::Fast;
/// The plant that the result is judged on.
pub(super) const JUDGE_PLANT: PlantKind = PlantKind::Reference;
/// Cost of transport beyond which it no longer matters how bad it is.
const LARGEST_COT: f64 = 4.0;

/// The episodes of one generation.
pub(super) struct Arena {
    episodes: Vec<Episode>,
    plant: PlantKind,
}

struct Episode {
    terrain: Terrain,
    spawn: Spawn,
    chance: Chance,
}

/// How a candidate did, averaged over its episodes.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(super) struct Score {
    /// What the optimiser minimises.
    pub(super) cost: f64,
    pub(super) episodes: usize,
    /// Shares of the episodes.
    pub(super) reached: f64,
    pub(super) crashed: f64,
    /// Over the episodes that reached the horizon.
    pub(super) cost_of_transport: f64,
    pub(super) speed_m_per_s: f64,
    /// Share of time with a contact other than a foot's.
    pub(super) limb_contact: f64,
}

impl Arena {
    /// No episodes.
    pub(super) const fn empty() -> Self {
        Self { episodes: Vec::new(), plant: SEARCH_PLANT }
    }

    /// `count` episodes drawn from (seed, name, index).
    pub(super) fn new(
        robot: &Arc<RobotModel>,
        config: &SearchConfig,
        seed: u64,
        name: &str,
        count: usize,
        plant: PlantKind,
    ) -> Self {
        let spawner = Spawner::new(robot, SpawnRules { any_yaw_share: 0.0, ..SpawnRules::default() });
        let seed = derived_seed(seed, name, &[]);
        let draw = |index| Episode::draw(robot, &spawner, config, seed, (index, count), plant);
        Self { episodes: (0..count).into_par_iter().filter_map(draw).collect(), plant }
    }

    /// Scores a skill, one episode after the other: candidates run side by side.
    pub(super) fn score(&self, robot: &Arc<RobotModel>, skill: &RolledSkill, config: &SearchConfig) -> Score {
        let run = |episode: &Episode| episode.run(robot, skill, config, self.plant);
        Score::of(&self.episodes.iter().map(run).collect::<Vec<_>>(), config)
    }

    /// As [`score`](Self::score), the episodes side by side.
    pub(super) fn score_in_parallel(
        &self,
        robot: &Arc<RobotModel>,
        skill: &RolledSkill,
        config: &SearchConfig,
    ) -> Score {
        let run = |episode: &Episode| episode.run(robot, skill, config, self.plant);
        Score::of(&self.episodes.par_iter().map(run).collect::<Vec<_>>(), config)
    }
}

impl Episode {
    fn draw(
        robot: &Arc<RobotModel>,
        spawner: &Spawner,
        config: &SearchConfig,
        seed: u64,
        (index, count): (usize, usize),
        plant: PlantKind,
    ) -> Option<Self> {
        let row = index as u64;
        let mut rng = stream(seed, "episode", &[row]);
        // Stratified over the mix, so that a generation of few episodes meets all of it.
        let draw = (index as f32 + uniform(&mut rng, 0.0, 1.0)) / count as f32;
        let mix = config.terrain_at(f64::from(draw));
        let size_m = uniform(&mut rng, mix.size_m[0], mix.size_m[1]);
        let terrain = Terrain::tile(mix.kind, size_m, derived_seed(seed, "terrain", &[row]));
        let mut plant = Plant::new(robot, &terrain, plant);
        let spawn = spawner.settle(&mut plant, &terrain, &mut rng).ok()?;
        let disturbed = uniform(&mut rng, 0.0, 1.0) < config.disturbed_share;
        let perturbations = if disturbed { Perturbations::all() } else { Perturbations::protocol() };
        let seed = derived_seed(seed, "chance", &[row]);
        let chance = Chance::draw(seed, 0, &perturbations, SensorNoise::default());
        Some(Self { terrain, spawn, chance })
    }

    fn run(
        &self,
        robot: &Arc<RobotModel>,
        skill: &RolledSkill,
        config: &SearchConfig,
        plant: PlantKind,
    ) -> Rollout {
        let mut plant = Plant::new(robot, &self.terrain, plant);
        let rules = RolloutRules {
            horizon_m: config.horizon_m,
            time_limit_s: config.time_limit_s,
            forward_m_per_s: config.forward_m_per_s,
            ..RolloutRules::default()
        };
        Trial { terrain: &self.terrain, spawn: &self.spawn, skill, rules: &rules }
            .roll_out(&mut plant, &self.chance)
    }
}

/// An episode's cost:
///
/// ```text
/// (1 − d/horizon) + failure·[not reached] + w_cot·CoT + w_slow·max(0, 1 − v/v_cmd)
///     + w_haste·max(0, v/v_cmd − 1) + w_limb·share + w_speed·share
/// ```
fn cost(rollout: &Rollout, weights: &Objective, config: &SearchConfig) -> f64 {
    let reached = rollout.outcome == Outcome::Reached;
    let made = (rollout.distance_m / config.horizon_m).clamp(0.0, 1.0);
    let short = 1.0 - speed_m_per_s(rollout) / f64::from(config.forward_m_per_s);
    let cot = rollout.cot_positive.unwrap_or(LARGEST_COT).clamp(0.0, LARGEST_COT);
    (1.0 - made)
        + if reached { 0.0 } else { weights.failure }
        + weights.cost_of_transport * cot
        + weights.slowness * short.clamp(0.0, 1.0)
        + weights.haste * (-short).clamp(0.0, 1.0)
        + weights.limb_contact * rollout.motion.nonfoot_contact_share()
        + weights.joint_overspeed * rollout.motion.speed_over_limit_share()
}

fn speed_m_per_s(rollout: &Rollout) -> f64 {
    rollout.distance_m / rollout.duration_s.max(0.02)
}

impl Score {
    fn of(rollouts: &[Rollout], config: &SearchConfig) -> Self {
        let count = rollouts.len().max(1) as f64;
        let share = |outcome: Outcome| {
            rollouts.iter().filter(|rollout| rollout.outcome == outcome).count() as f64 / count
        };
        let over_reached = |value: &dyn Fn(&Rollout) -> f64| {
            let reached: Vec<f64> =
                rollouts.iter().filter(|rollout| rollout.outcome == Outcome::Reached).map(value).collect();
            if reached.is_empty() { f64::NAN } else { reached.iter().sum::<f64>() / reached.len() as f64 }
        };
        Self {
            cost: rollouts.iter().map(|rollout| cost(rollout, &config.objective, config)).sum::<f64>()
                / count,
            episodes: rollouts.len(),
            reached: share(Outcome::Reached),
            crashed: share(Outcome::BaseCollision),
            cost_of_transport: over_reached(&|rollout| rollout.cot_positive.unwrap_or(f64::NAN)),
            speed_m_per_s: over_reached(&speed_m_per_s),
            limb_contact: rollouts.iter().map(|rollout| rollout.motion.nonfoot_contact_share()).sum::<f64>()
                / count,
        }
    }
}

impl fmt::Display for Score {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            formatter,
            "{} episodes: {:.1} % reached, {:.1} % base contact; cost of transport {:.3}, {:.2} m/s, \
             limb contact {:.1} % of the time, cost {:.4}",
            self.episodes,
            100.0 * self.reached,
            100.0 * self.crashed,
            self.cost_of_transport,
            self.speed_m_per_s,
            100.0 * self.limb_contact,
            self.cost,
        )
    }
}
