//! One rollout of the protocol (docs/method.md): from a settled pose straight ahead at 0.6 m/s
//! until the horizon is passed, the base touches something, or time is up.

mod chance;
mod motion;
mod skill;

pub use chance::{Chance, Perturbation, Perturbations, Push};
pub use motion::{Histogram, Motion};
pub use skill::{RolledSkill, SkillRefused};

use serde::{Deserialize, Serialize};
use vocaloco_plugin_api::Command;

use crate::{
    angle::wrapped_rad,
    driver::{Driver, TICK_S},
    physics::Physics,
    plant::{BasePose, GRAVITY_M_PER_S2, Measurement, Plant},
    spawn::Spawn,
    terrain::Terrain,
};

/// What a rollout asks of a skill. The default is that of docs/method.md.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RolloutRules {
    /// Displacement along the spawn's yaw that counts as reached.
    pub horizon_m: f64,
    /// Largest displacement sideways at that moment.
    pub sideways_m: f64,
    /// Time allowed.
    pub time_limit_s: f64,
    /// Commanded forward velocity.
    pub forward_m_per_s: f32,
    /// Commanded yaw rate per heading error, 1/s, clipped to ± 1 rad/s.
    pub steering_per_s: f32,
    /// Cost of transport counts from here on.
    pub cot_from_s: f64,
}

impl Default for RolloutRules {
    fn default() -> Self {
        Self {
            horizon_m: 1.5,
            sideways_m: 0.5,
            time_limit_s: 4.0,
            forward_m_per_s: 0.6,
            steering_per_s: 0.5,
            cot_from_s: 0.5,
        }
    }
}

/// How a rollout ended. Only [`Reached`](Self::Reached) is a success.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The base passed the horizon in time.
    Reached,
    /// The base touched something.
    BaseCollision,
    /// Time ran out beyond the horizon, but too far to the side.
    OffPath,
    /// Time ran out.
    Timeout,
    /// The plugin reported an error or gave targets that are not numbers.
    Fault,
}

impl Outcome {
    /// Every outcome.
    pub const ALL: [Self; 5] =
        [Self::Reached, Self::BaseCollision, Self::OffPath, Self::Timeout, Self::Fault];

    /// The id used in data sets.
    pub const fn id(self) -> &'static str {
        match self {
            Self::Reached => "reached",
            Self::BaseCollision => "base_collision",
            Self::OffPath => "off_path",
            Self::Timeout => "timeout",
            Self::Fault => "fault",
        }
    }
}

/// What one rollout gave.
#[derive(Clone, Debug)]
pub struct Rollout {
    /// How it ended.
    pub outcome: Outcome,
    /// When it ended, s.
    pub duration_s: f64,
    /// Displacement along the spawn's yaw, m.
    pub distance_m: f64,
    /// The same at [`CRUISE_FROM_S`]; `None` when the rollout ended before.
    pub cruise_from_m: Option<f64>,
    /// Cost of transport, positive work; `None` when the base moved less than 1 cm after 0.5 s.
    pub cot_positive: Option<f64>,
    /// Cost of transport, work as signed.
    pub cot_signed: Option<f64>,
    /// What joints and contacts did.
    pub motion: Motion,
}

/// A robot that starts from a stand has its speed from here on, s.
pub const CRUISE_FROM_S: f64 = 1.0;
/// Less distance than this gives no cost of transport, m.
const LEAST_DISTANCE_M: f64 = 0.01;

/// A skill, the pose it starts from, and what is asked of it.
#[derive(Clone, Copy)]
pub struct Trial<'a> {
    /// The terrain of the plant and the pose.
    pub terrain: &'a Terrain,
    /// The settled pose.
    pub spawn: &'a Spawn,
    /// The skill.
    pub skill: &'a RolledSkill,
    /// What is asked of it.
    pub rules: &'a RolloutRules,
}

impl Trial<'_> {
    /// Rolls the skill out on the plant that the pose was settled on.
    pub fn roll_out(&self, plant: &mut Plant, chance: &Chance) -> Rollout {
        plant.restore(&self.spawn.snapshot);
        self.roll_on(plant, chance)
    }

    /// Rolls the skill out on any simulator's plant that stands in the pose.
    ///
    /// ```text
    /// command = (0.6, 0, clip(0.5·(ψ_spawn − ψ), ±1))
    /// CoT     = Σ_step Σ_joint max(0, τ·½(q̇₀ + q̇₁))·Δt / (m·g·d)
    /// ```
    ///
    /// with the mass drawn for the rollout, work and distance both from 0.5 s on. Position is looked
    /// at every tick, contact every physics step. A skill that takes position targets is given them as by
    /// the runtime: along that velocity, as far ahead and for as long as its manifest says.
    ///
    /// # Source
    /// Wu et al. (2025), eq. 1, with positive power only; docs/method.md.
    pub fn roll_on<P: Physics>(&self, plant: &mut P, chance: &Chance) -> Rollout {
        self.roll_watched(plant, chance, &mut |_| ())
    }

    /// As [`roll_on`](Self::roll_on); `watch` sees the plant before every tick.
    pub(crate) fn roll_watched<P: Physics>(
        &self,
        plant: &mut P,
        chance: &Chance,
        watch: &mut dyn FnMut(&Measurement),
    ) -> Rollout {
        self.roll(plant, chance, None, watch)
    }

    /// Rolls the skill out from where a run-up has brought it, which is the trial's pose: the skill goes on,
    /// and what differs between rollouts is drawn anew there; phase and latency stay the run-up's.
    pub fn roll_in_stride(&self, run_up: &RunUp, plant: &mut Plant, chance: &Chance) -> Rollout {
        plant.restore(&run_up.from.snapshot);
        self.roll(plant, chance, Some(run_up), &mut |_| ())
    }

    fn roll<P: Physics>(
        &self,
        plant: &mut P,
        chance: &Chance,
        run_up: Option<&RunUp>,
        watch: &mut dyn FnMut(&Measurement),
    ) -> Rollout {
        let first = run_up.map_or(chance, |run_up| &run_up.chance);
        plant.vary(&first.variation);
        let path = Path::from(&self.spawn.base);
        let mut motion = Motion::new(plant.robot().drive.velocity_limit_rad_per_s);
        let Ok(mut instance) = self.skill.instance(first.initial_phase, plant.robot()) else {
            return Rollout::fault_at_start(motion);
        };
        let mut driver = Driver::new(plant, self.terrain, &mut instance, first.noise, first.noise_stream())
            .late_by(first.latency_ticks)
            .aiming(self.skill.target());
        let mut is_fit = driver.start().is_ok();
        if let Some(run_up) = run_up.filter(|_| is_fit) {
            is_fit = run_up.run(self.rules, &mut driver);
            driver.plant.vary(&chance.variation);
            driver.sense_with(chance.noise, chance.noise_stream());
        }
        let end = if is_fit {
            let mut witness = Witness { motion: &mut motion, watch };
            self.rules.follow(&mut driver, &path, chance.push, &mut witness)
        } else {
            End { outcome: Outcome::Fault, ticks: 0, marks: Marks::default() }
        };
        let [distance_m, _] = path.displacement_m(&plant.measure().base);
        let cot = |work_j: f64| {
            let counted_m = distance_m - end.marks.counted_from_m?;
            let weight_n = f64::from(plant.total_mass_kg() * GRAVITY_M_PER_S2);
            (counted_m >= LEAST_DISTANCE_M).then(|| work_j / (weight_n * counted_m))
        };
        Rollout {
            outcome: end.outcome,
            duration_s: end.ticks as f64 * TICK_S,
            distance_m,
            cruise_from_m: end.marks.cruise_from_m,
            cot_positive: cot(plant.positive_work_j()),
            cot_signed: cot(plant.signed_work_j()),
            motion,
        }
    }
}

impl RolloutRules {
    /// The default with a skill's own horizon and time limit.
    pub fn of(own: &vocaloco_core::manifest::Rollout) -> Self {
        Self { horizon_m: own.horizon_m, time_limit_s: own.time_limit_s, ..Self::default() }
    }

    /// Ticks a driver that has started along a path until the outcome is decided.
    pub(crate) fn follow<P: Physics>(
        &self,
        driver: &mut Driver<'_, P>,
        path: &Path,
        push: Option<Push>,
        witness: &mut Witness<'_>,
    ) -> End {
        let tick_at = |time_s: f64| (time_s / TICK_S).round() as usize;
        let ticks = tick_at(self.time_limit_s);
        let (counted_from_tick, cruise_from_tick) = (tick_at(self.cot_from_s), tick_at(CRUISE_FROM_S));
        let mut marks = Marks::default();
        for tick in 0..ticks {
            (witness.watch)(driver.plant.measure());
            let base = driver.plant.measure().base;
            if tick == counted_from_tick {
                marks.counted_from_m = Some(path.displacement_m(&base)[0]);
                driver.plant.reset_work();
            }
            if tick == cruise_from_tick {
                marks.cruise_from_m = Some(path.displacement_m(&base)[0]);
            }
            if let Some(push) = push.filter(|push| push.tick == tick) {
                driver.plant.push(push.velocity_in_world);
            }
            let mut base_contact = false;
            let ticked = driver.tick(&path.command(&base, self), |plant| {
                let measured = plant.measure();
                base_contact |= measured.base_contact;
                witness.motion.add_step(measured);
            });
            let [ahead_m, sideways_m] = path.displacement_m(&driver.plant.measure().base);
            if ticked.is_err() || !ahead_m.is_finite() || !sideways_m.is_finite() {
                return End { outcome: Outcome::Fault, ticks: tick, marks };
            }
            witness.motion.add_targets(driver.targets());
            if base_contact {
                return End { outcome: Outcome::BaseCollision, ticks: tick + 1, marks };
            }
            if ahead_m >= self.horizon_m && sideways_m.abs() <= self.sideways_m {
                return End { outcome: Outcome::Reached, ticks: tick + 1, marks };
            }
        }
        let [ahead_m, _] = path.displacement_m(&driver.plant.measure().base);
        let outcome = if ahead_m >= self.horizon_m { Outcome::OffPath } else { Outcome::Timeout };
        End { outcome, ticks, marks }
    }
}

/// How a skill came to where a rollout begins in stride.
pub struct RunUp {
    /// Where it set off.
    pub from: Spawn,
    /// For how long, ticks.
    pub ticks: usize,
    /// What was drawn for it.
    pub chance: Chance,
}

impl RunUp {
    /// Ticks a driver that has started; false after a fault.
    fn run<P: Physics>(&self, rules: &RolloutRules, driver: &mut Driver<'_, P>) -> bool {
        let rules = RolloutRules { time_limit_s: self.ticks as f64 * TICK_S, ..*rules };
        let mut unseen = Motion::new(driver.plant.robot().drive.velocity_limit_rad_per_s);
        let mut witness = Witness { motion: &mut unseen, watch: &mut |_| () };
        let end = rules.follow(driver, &Path::from(&self.from.base), self.chance.push, &mut witness);
        end.outcome != Outcome::Fault
    }
}

/// Who sees a rollout.
pub(crate) struct Witness<'a> {
    /// Counts what joints and contacts do.
    pub(crate) motion: &'a mut Motion,
    /// Sees the plant before every tick.
    pub(crate) watch: &'a mut dyn FnMut(&Measurement),
}

/// How a rollout ended, and after how many ticks.
pub(crate) struct End {
    pub(crate) outcome: Outcome,
    pub(crate) ticks: usize,
    marks: Marks,
}

/// Displacements at moments on the way, where the rollout came to them.
#[derive(Default)]
struct Marks {
    /// When work begins to count, m.
    counted_from_m: Option<f64>,
    /// When speed begins to count, m.
    cruise_from_m: Option<f64>,
}

impl Rollout {
    fn fault_at_start(motion: Motion) -> Self {
        Self {
            outcome: Outcome::Fault,
            duration_s: 0.0,
            distance_m: 0.0,
            cruise_from_m: None,
            cot_positive: None,
            cot_signed: None,
            motion,
        }
    }
}

/// The straight line ahead of a spawn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Path {
    start_m: [f64; 2],
    yaw_rad: f32,
    cos_sin: [f64; 2],
}

impl From<&BasePose> for Path {
    fn from(base: &BasePose) -> Self {
        let yaw_rad = base.yaw();
        Self {
            start_m: [f64::from(base.position_m[0]), f64::from(base.position_m[1])],
            yaw_rad,
            cos_sin: [libm::cos(f64::from(yaw_rad)), libm::sin(f64::from(yaw_rad))],
        }
    }
}

impl Path {
    /// Displacement ahead and to the left, m.
    pub(crate) fn displacement_m(&self, base: &BasePose) -> [f64; 2] {
        let dx = f64::from(base.position_m[0]) - self.start_m[0];
        let dy = f64::from(base.position_m[1]) - self.start_m[1];
        let [cos, sin] = self.cos_sin;
        [cos * dx + sin * dy, cos * dy - sin * dx]
    }

    /// Turn to the left that the path asks for, −π to π.
    pub(crate) fn heading_error_rad(&self, base: &BasePose) -> f32 {
        wrapped_rad(self.yaw_rad - base.yaw())
    }

    /// Ahead at the commanded velocity, steering back to the path's direction.
    pub(crate) fn command(&self, base: &BasePose, rules: &RolloutRules) -> Command {
        let yaw_rate = (rules.steering_per_s * self.heading_error_rad(base)).clamp(-1.0, 1.0);
        Command::velocity(rules.forward_m_per_s, 0.0, yaw_rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displacement_is_along_and_left_of_the_spawns_yaw() {
        let spawn = BasePose::from_yaw([1.0, 2.0, 0.5], 0.5);
        let path = Path::from(&spawn);
        let (cos, sin) = (0.5_f32.cos(), 0.5_f32.sin());
        // 1.5 m ahead and 0.2 m to the left.
        let there = BasePose::from_yaw([1.0 + 1.5 * cos - 0.2 * sin, 2.0 + 1.5 * sin + 0.2 * cos, 0.9], 0.1);
        let [ahead_m, left_m] = path.displacement_m(&there);
        assert!((ahead_m - 1.5).abs() < 1e-5 && (left_m - 0.2).abs() < 1e-5, "{ahead_m} {left_m}");
    }

    #[test]
    fn the_command_steers_back_to_the_spawns_yaw() {
        let rules = RolloutRules::default();
        let path = Path::from(&BasePose::from_yaw([0.0; 3], 3.1));
        let turned_left = path.command(&BasePose::from_yaw([0.0; 3], -3.1), &rules);
        // −3.1 is 0.083 rad to the left of 3.1, across ±π.
        assert!((turned_left.velocity[2] + 0.5 * 0.0832).abs() < 1e-3, "{:?}", turned_left.velocity);
        let opposite = Path::from(&BasePose::from_yaw([0.0; 3], 0.0));
        let command = opposite.command(&BasePose::from_yaw([0.0; 3], -3.0), &rules);
        assert_eq!(command.velocity, [0.6, 0.0, 1.0], "clipped at 1 rad/s");
    }
}
