//! The handover of docs/method.md: one skill climbs a staircase, another takes over while the hind
//! feet are still on the last step, and has to clear it.

mod moment;

pub use moment::{LAST_RISER_X_M, STEPS};

use std::sync::Arc;

use moment::{Feet, feet_of};
use rayon::prelude::*;
use serde::Serialize;
use thiserror::Error;
use vocaloco_core::{plugin::PluginError, robot::RobotModel};

use crate::{
    driver::{Driver, SensorNoise, TICK_S},
    evaluate::{mean, wilson},
    plant::{BasePose, Plant, PlantKind},
    rollout::{Chance, Motion, Outcome, Path, Perturbations, RolledSkill, RolloutRules, Witness},
    scene::row_seed,
    spawn::{NoValidPose, SpawnRules, Spawner},
    stream::{derived_seed, stream, uniform},
    terrain::{CourseKind, Terrain},
};

/// How far past the last riser the base is when the switch is due, m, uniform.
const DUE_PAST_M: [f32; 2] = [0.0, 0.3];
/// Beyond this the feet have missed the moment, m.
const MISSED_PAST_M: f32 = 0.6;
/// Time allowed for the way to the last step, s.
const APPROACH_S: f64 = 12.0;
/// Approaches drawn for one handover before it is given up.
const APPROACHES: u64 = 50;

/// Which skills on which staircase, how often, and what is uncertain about it.
#[derive(Clone, Debug)]
pub struct HandoverQuery {
    /// Up or down.
    pub course: CourseKind,
    /// Height of a step, m.
    pub size_m: f32,
    /// Number of handovers.
    pub samples: u64,
    /// Seed; approaches depend on it, the course and the skill that approaches.
    pub seed: u64,
    /// What is asked of the skill that takes over, from the moment it does.
    pub rules: RolloutRules,
    /// How the robot is set down on the near flat.
    pub spawn: SpawnRules,
    /// What is drawn for each approach; a push comes after the handover.
    pub perturb: Perturbations,
    /// Half-width of the noise on the plugins' terrain patches, m.
    pub patch_noise_m: f32,
    /// Which plant.
    pub plant: PlantKind,
}

impl HandoverQuery {
    /// The protocol's rules and perturbations, yaw ± 0.1 rad.
    pub fn new(course: CourseKind, size_m: f32, samples: u64, seed: u64) -> Self {
        Self {
            course,
            size_m,
            samples,
            seed,
            rules: RolloutRules::default(),
            spawn: SpawnRules { any_yaw_share: 0.0, yaw_rad: 0.1, ..SpawnRules::default() },
            perturb: Perturbations::protocol(),
            patch_noise_m: 0.02,
            plant: PlantKind::Reference,
        }
    }
}

/// One handover.
#[derive(Clone, Debug)]
pub struct Handover {
    /// Approaches before it that did not come to one: the first skill fell, ran out of time, or never
    /// had its feet as they have to be.
    pub failed_approaches: u64,
    /// The base at the switch.
    pub base: BasePose,
    /// Centres of the feet at the switch, in the order of the robot's feet, m.
    pub feet_in_world_m: Vec<[f32; 3]>,
    /// Speed along the course at the switch.
    pub speed_m_per_s: f64,
    /// What the second skill made of it.
    pub outcome: Outcome,
}

/// Handovers that cannot be measured.
#[derive(Debug, Error)]
pub enum HandoverError {
    /// The robot could not be set down.
    #[error(transparent)]
    Spawn(#[from] NoValidPose),
    /// A plugin did not take its parameters.
    #[error(transparent)]
    Plugin(#[from] PluginError),
    /// The first skill does not get there.
    #[error("handover {row}: none of {APPROACHES} approaches of `{skill}` came to the last step, wanted one")]
    NeverThere {
        /// Number of the handover.
        row: u64,
        /// The skill that approaches.
        skill: String,
    },
}

/// Lets `from` climb and `to` take over, in parallel on the current rayon pool, in the order of the
/// handovers; `progress` is called once for each, from any thread.
///
/// `from` is commanded as in a rollout, along the course. The switch is at the first tick at which the
/// base is past the last riser by a length drawn from 0 to 0.3 m, every fore foot is past it too, and
/// every hind foot is over the tread before it. `to` is then reset to the state as it is, on the same
/// plant, and has the rollout's rules from there, along the course. An approach that does not come to
/// a switch is counted and drawn anew.
///
/// # Errors
/// When the robot cannot be set down, a plugin refuses, or no approach comes to a switch.
pub fn hand_over(
    robot: &Arc<RobotModel>,
    [from, to]: [&RolledSkill; 2],
    query: &HandoverQuery,
    progress: &(dyn Fn() + Sync),
) -> Result<Vec<Handover>, HandoverError> {
    let stairs = Stairs {
        robot,
        from,
        to,
        query,
        terrain: Terrain::course(query.course, query.size_m, STEPS),
        spawner: Spawner::new(robot, query.spawn),
        feet: Feet::of(robot),
    };
    let index = [query.course as u64, u64::from(query.size_m.to_bits())];
    let seed = derived_seed(query.seed, "handover", &index);
    let one = |row: usize| {
        let handover = stairs.handover(row as u64, row_seed(seed, row as u64))?;
        progress();
        Ok(handover)
    };
    (0..query.samples as usize).into_par_iter().with_max_len(1).map(one).collect()
}

/// What all handovers of a query share.
struct Stairs<'a> {
    robot: &'a Arc<RobotModel>,
    from: &'a RolledSkill,
    to: &'a RolledSkill,
    query: &'a HandoverQuery,
    terrain: Terrain,
    spawner: Spawner,
    feet: Feet,
}

impl Stairs<'_> {
    fn handover(&self, row: u64, row_seed: u64) -> Result<Handover, HandoverError> {
        for failed_approaches in 0..APPROACHES {
            let seed = derived_seed(row_seed, "approach", &[failed_approaches]);
            if let Some(handover) = self.attempt(seed)? {
                return Ok(Handover { failed_approaches, ..handover });
            }
        }
        Err(HandoverError::NeverThere { row, skill: self.from.name.clone() })
    }

    fn attempt(&self, seed: u64) -> Result<Option<Handover>, HandoverError> {
        let HandoverQuery { rules, perturb, patch_noise_m, plant, .. } = self.query;
        let mut plant = Plant::new(self.robot, &self.terrain, *plant);
        self.spawner.settle(&mut plant, &self.terrain, &mut stream(seed, "pose", &[]))?;
        let noise = SensorNoise { patch_m: *patch_noise_m, ..SensorNoise::default() };
        let chance = Chance::draw(seed, 0, perturb, noise);
        plant.vary(&chance.variation);
        let due_past_m = uniform(&mut stream(seed, "handover_due", &[]), DUE_PAST_M[0], DUE_PAST_M[1]);
        let mut first = self.from.instance(chance.initial_phase, self.robot)?;
        let mut second = self.to.instance(None, self.robot)?;
        let noise_stream = chance.noise_stream();
        let mut driver = Driver::new(&mut plant, &self.terrain, &mut first, chance.noise, noise_stream)
            .late_by(chance.latency_ticks)
            .aiming(self.from.target());
        let Some(feet_in_world_m) = self.approach(&mut driver, due_past_m) else { return Ok(None) };
        let measured = driver.plant.measure();
        let base = measured.base;
        let speed_m_per_s = f64::from(base.vector_in_world(measured.base_linear_velocity)[0]);
        let outcome = match driver.hand_over(&mut second, self.to.target()) {
            Ok(()) => {
                let mut motion = Motion::new(self.robot.drive.velocity_limit_rad_per_s);
                let mut witness = Witness { motion: &mut motion, watch: &mut |_| () };
                rules.follow(&mut driver, &along_the_course(&base), chance.push, &mut witness).outcome
            }
            Err(_) => Outcome::Fault,
        };
        Ok(Some(Handover { failed_approaches: 0, base, feet_in_world_m, speed_m_per_s, outcome }))
    }

    /// Drives up to the moment of the switch; where the feet are then, or `None` when it never comes.
    fn approach(&self, driver: &mut Driver<'_>, due_past_m: f32) -> Option<Vec<[f32; 3]>> {
        driver.start().ok()?;
        let path = along_the_course(&driver.plant.measure().base);
        for _ in 0..(APPROACH_S / TICK_S) as usize {
            let measured = driver.plant.measure();
            let past_m = measured.base.position_m[0] - LAST_RISER_X_M;
            if past_m >= due_past_m {
                let feet = feet_of(&self.robot.description, measured);
                if self.feet.straddle_the_last_riser(&feet) {
                    return Some(feet);
                }
            }
            // Phrased as "is inside", so that NaN is missed.
            if !(..=MISSED_PAST_M).contains(&past_m) {
                return None;
            }
            let command = path.command(&measured.base, &self.query.rules);
            let mut base_contact = false;
            driver.tick(&command, |plant| base_contact |= plant.measure().base_contact).ok()?;
            if base_contact {
                return None;
            }
        }
        None
    }
}

/// The line along the course through a base.
fn along_the_course(base: &BasePose) -> Path {
    Path::from(&BasePose::from_yaw(base.position_m, 0.0))
}

/// A row of `evaluate handover`.
#[derive(Clone, Debug, Serialize)]
pub struct HandoverRow {
    /// The skill that climbs.
    pub from: String,
    /// The skill that takes over.
    pub to: String,
    /// Course.
    pub course: &'static str,
    /// Height of a step, m.
    pub size_m: f32,
    /// Number of handovers.
    pub n: u64,
    /// Share in which the second skill reached the horizon.
    pub cleared: f64,
    /// Lower end of its 95 % interval.
    pub cleared_low: f64,
    /// Upper end of its 95 % interval.
    pub cleared_high: f64,
    /// Share that ended by a contact of the base.
    pub base_collision: f64,
    /// Share that ran out of time, off the path or not.
    pub timeout: f64,
    /// Share that the second plugin ended by an error or by targets that are not numbers.
    pub fault: f64,
    /// Approaches that did not come to a handover and are not among the n.
    pub not_handed_over: u64,
    /// Mean speed along the course at the switch.
    pub speed_at_handover_m_per_s: Option<f64>,
    /// Distance asked for after the switch, m.
    pub horizon_m: f64,
    /// Time allowed for it, s.
    pub time_limit_s: f64,
    /// What was drawn for each approach.
    pub perturb: String,
    /// Plant.
    pub plant: String,
    /// Half-width of the noise on the plugins' terrain patches, m.
    pub patch_noise_m: f32,
}

/// Puts handovers into a row.
pub fn summarise(
    [from, to]: [&RolledSkill; 2],
    query: &HandoverQuery,
    handovers: &[Handover],
) -> HandoverRow {
    let n = handovers.len();
    let count = |outcomes: &[Outcome]| handovers.iter().filter(|one| outcomes.contains(&one.outcome)).count();
    let share = |outcomes: &[Outcome]| if n == 0 { 0.0 } else { count(outcomes) as f64 / n as f64 };
    let [cleared_low, cleared_high] = wilson(count(&[Outcome::Reached]), n);
    let speeds: Vec<f64> = handovers.iter().map(|one| one.speed_m_per_s).collect();
    HandoverRow {
        from: from.name.clone(),
        to: to.name.clone(),
        course: query.course.id(),
        size_m: query.size_m,
        n: n as u64,
        cleared: share(&[Outcome::Reached]),
        cleared_low,
        cleared_high,
        base_collision: share(&[Outcome::BaseCollision]),
        timeout: share(&[Outcome::Timeout, Outcome::OffPath]),
        fault: share(&[Outcome::Fault]),
        not_handed_over: handovers.iter().map(|one| one.failed_approaches).sum(),
        speed_at_handover_m_per_s: mean(&speeds),
        horizon_m: query.rules.horizon_m,
        time_limit_s: query.rules.time_limit_s,
        perturb: query.perturb.to_string(),
        plant: query.plant.id().to_owned(),
        patch_noise_m: query.patch_noise_m,
    }
}
