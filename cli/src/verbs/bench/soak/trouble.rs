//! What goes wrong during a soak: measurements, terrain and predictions, each by its own stream of the seed.

use std::sync::{Arc, Mutex, PoisonError};

use vocaloco_core::decision::{Decision, Forced};
use vocaloco_core::heightfield::Field;
use vocaloco_core::observation::{BaseInOdom, Observation};
use vocaloco_core::robot::RobotModel;
use vocaloco_core::runtime::{CallFault, Predict, Skill};
use vocaloco_core::selector::Prediction;
use vocaloco_plugin_api::Command;
use vocaloco_sim::stream::derived_seed;

use super::tally::Tally;
use crate::verbs::bench::approach::{APPROACH_TICKS, approach};

/// Numbers of one purpose, in order.
#[derive(Debug)]
pub(super) struct Draws {
    seed: u64,
    purpose: &'static str,
    index: u64,
    count: u64,
}

impl Draws {
    pub(super) const fn new(seed: u64, purpose: &'static str, index: u64) -> Self {
        Self { seed, purpose, index, count: 0 }
    }

    /// The next number, below `end`.
    pub(super) fn below(&mut self, end: u64) -> u64 {
        self.count += 1;
        derived_seed(self.seed, self.purpose, &[self.index, self.count]) % end.max(1)
    }

    /// Of these, at least the first and less than the second.
    pub(super) fn between(&mut self, [least, end]: [u64; 2]) -> u64 {
        least + self.below(end - least)
    }

    /// True once in `count` times, on average.
    pub(super) fn is_one_in(&mut self, count: u64) -> bool {
        self.below(count) == 0
    }
}

/// Way after which the robot's odometry begins anew, m.
const LAP_M: f64 = 1000.0;
/// Ticks between two spoiled observations, on average.
const SPOILED_EVERY: u64 = 150;
/// Ticks between two commands, on average.
const COMMANDED_EVERY: u64 = 400;

type Spoil = fn(&mut Observation);

/// Ways to spoil an observation, what they are counted as, and what overrules the window for it, if anything.
const SPOILS: [(&str, Option<Forced>, Spoil); 10] = [
    ("terrain: missing", Some(Forced::Terrain), |o| o.elevation = None),
    ("terrain: stale", Some(Forced::Terrain), |o| each_elevation(o, |e| e.t_s -= 1.0)),
    ("terrain: no heights", Some(Forced::Terrain), |o| each_elevation(o, |e| e.height_m.clear())),
    ("terrain: all NaN", Some(Forced::Terrain), |o| each_elevation(o, |e| e.height_m.fill(f32::NAN))),
    ("terrain: half NaN", Some(Forced::Terrain), |o| {
        each_elevation(o, |e| {
            let half = e.height_m.len() / 2;
            e.height_m[..half].fill(f32::NAN);
        });
    }),
    ("terrain: one in seven NaN", None, |o| {
        each_elevation(o, |e| e.height_m.iter_mut().step_by(7).for_each(|height| *height = f32::NAN));
    }),
    ("measurement: NaN", Some(Forced::Observation), |o| o.joint_velocity_rad_per_s[4] = f32::NAN),
    ("measurement: infinite", Some(Forced::Observation), |o| o.projected_gravity[1] = f32::INFINITY),
    ("measurement: a joint short", Some(Forced::Observation), |o| o.joint_position_rad.truncate(11)),
    // Earlier than any before it, two in a row as well.
    ("measurement: from the past", Some(Forced::Observation), |o| o.t_s = -1.0 - o.t_s),
];

fn each_elevation(observation: &mut Observation, change: fn(&mut vocaloco_core::elevation::Elevation)) {
    observation.elevation.iter_mut().for_each(change);
}

/// Kinds of what goes wrong beside the plugins.
pub(super) fn kinds() -> Vec<&'static str> {
    SPOILS.iter().map(|(kind, ..)| *kind).chain(SPELLS.iter().map(|(kind, _)| *kind)).collect()
}

/// What the robot measures and is told.
pub(super) struct Senses {
    approach: Vec<Observation>,
    command: Command,
    draws: Draws,
    tally: Tally,
}

impl Senses {
    pub(super) fn new(robot: &RobotModel, seed: u64, tally: &Tally) -> Self {
        let draws = Draws::new(seed, "soak.senses", 0);
        Self { approach: approach(robot), command: FORWARD, draws, tally: tally.clone() }
    }

    /// The observation of a tick, and what has to overrule the window when it is spoiled.
    pub(super) fn at(&mut self, tick: u64, t_s: f64) -> (Observation, Option<Forced>) {
        let mut observation = self.approach[tick as usize % APPROACH_TICKS].clone();
        observation.t_s = t_s;
        // A day's way is 50 km; odometry begins anew before it is no longer taken.
        let position_m = [(0.6 * t_s) % LAP_M, 0.0, 0.5];
        observation.base_in_odom = Some(BaseInOdom { position_m, orientation_xyzw: [0.0, 0.0, 0.0, 1.0] });
        observation.elevation.iter_mut().for_each(|elevation| elevation.t_s = t_s);
        if self.draws.is_one_in(COMMANDED_EVERY) {
            // Now and then none, and one that no skill takes.
            let forward_m_per_s = match self.draws.below(16) {
                0 => 0.0,
                1 => 2.0,
                2..6 => 0.3,
                _ => 0.6,
            };
            self.command = Command::velocity(forward_m_per_s, 0.0, 0.0);
        }
        observation.command = self.command;
        if !self.draws.is_one_in(SPOILED_EVERY) {
            return (observation, None);
        }
        let (kind, forced, spoil) = SPOILS[self.draws.below(SPOILS.len() as u64) as usize];
        spoil(&mut observation);
        self.tally.count(kind);
        (observation, forced)
    }
}

const FORWARD: Command = Command::velocity(0.6, 0.0, 0.0);

/// Predictions between two spells of bad ones, on average.
const SPELL_EVERY: u64 = 1500;
/// Length of such a spell; three in a row are enough to take a skill out of service.
const SPELL_TICKS: [u64; 2] = [1, 5];
/// Predictions between two moods, on average.
const MOOD_EVERY: u64 = 150;

/// Ways to spoil a prediction, and what they are counted as.
#[derive(Clone, Copy, Debug)]
enum Spell {
    Nan,
    Infinite,
    Beyond,
    NotPositive,
    Strange,
    Fails,
    Panics,
}

const SPELLS: [(&str, Spell); 7] = [
    ("prediction: NaN", Spell::Nan),
    ("prediction: infinite cost", Spell::Infinite),
    ("prediction: viability over 1", Spell::Beyond),
    ("prediction: cost below 0", Spell::NotPositive),
    ("prediction: unknown terrain", Spell::Strange),
    ("prediction: error", Spell::Fails),
    ("prediction: panic", Spell::Panics),
];

/// Skills whose prediction was spoiled since they were asked for last.
#[derive(Clone, Debug, Default)]
pub(super) struct Spoilt(Arc<Mutex<Vec<String>>>);

impl Spoilt {
    fn add(&self, skill: &str) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(skill.to_owned());
    }

    /// One that counts as viable in the tick that its prediction was spoiled in.
    pub(super) fn believed(&self, decision: &Decision) -> Option<String> {
        let mut spoilt = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let is_viable = |name: &String| decision.skills.iter().any(|it| it.name == *name && it.viable);
        let believed = spoilt.iter().find(|name| is_viable(name)).cloned();
        spoilt.clear();
        believed
    }
}

/// A skill's own predictors, whose answers are changed: now dearer, now cheaper, and at times nonsense.
pub(super) struct Moody {
    inner: Box<dyn Predict>,
    skill: String,
    draws: Draws,
    tally: Tally,
    spoilt: Spoilt,
    /// Share of the cost that is predicted.
    cost_share: f32,
    /// Viability in place of the predicted one.
    viability: Option<f32>,
    spell: Option<(Spell, u64)>,
}

impl Moody {
    /// The skill with such predictors.
    pub(super) fn around(skill: Skill, draws: Draws, tally: &Tally, spoilt: &Spoilt) -> Skill {
        let predictors = Self {
            inner: skill.predictors,
            skill: skill.rule.name.clone(),
            draws,
            tally: tally.clone(),
            spoilt: spoilt.clone(),
            cost_share: 1.0,
            viability: Some(0.995),
            spell: None,
        };
        Skill { predictors: Box::new(predictors), ..skill }
    }

    fn change_mood(&mut self) {
        if self.draws.is_one_in(MOOD_EVERY) {
            self.cost_share = 0.6 + 0.001 * self.draws.below(800) as f32;
            self.viability =
                [Some(0.995), Some(0.995), Some(0.995), Some(0.2), None][self.draws.below(5) as usize];
        }
        if self.spell.is_none() && self.draws.is_one_in(SPELL_EVERY) {
            let (kind, spell) = SPELLS[self.draws.below(SPELLS.len() as u64) as usize];
            self.tally.count(kind);
            self.spell = Some((spell, self.draws.between(SPELL_TICKS)));
        }
    }
}

impl Predict for Moody {
    fn predict(&mut self, field: &Field) -> (Prediction, Option<CallFault>) {
        self.change_mood();
        let (mut prediction, mut failed) = self.inner.predict(field);
        prediction.cot *= self.cost_share;
        if let Some(viability) = self.viability {
            prediction.viability = viability;
            prediction.strangeness = None;
        }
        let Some((spell, left)) = self.spell.take() else { return (prediction, failed) };
        self.spell = (left > 1).then_some((spell, left - 1));
        self.spoilt.add(&self.skill);
        match spell {
            Spell::Nan => prediction.viability = f32::NAN,
            Spell::Infinite => prediction.cot = f32::INFINITY,
            Spell::Beyond => prediction.viability = 1.5,
            Spell::NotPositive => prediction.cot = -0.1,
            Spell::Strange => prediction.strangeness = Some(9.0),
            Spell::Fails => {
                prediction = Prediction::NONE;
                failed = Some(CallFault::Failed("a prediction that fails as it was told".to_owned()));
            }
            // Without the message that a panic prints.
            Spell::Panics => std::panic::resume_unwind(Box::new("a prediction that panics as it was told")),
        }
        (prediction, failed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_repeat_by_seed_purpose_and_index_and_stay_within_their_bounds() {
        let numbers = |seed, purpose, index| {
            let mut draws = Draws::new(seed, purpose, index);
            [(); 64].map(|()| draws.between([3, 9]))
        };
        let first = numbers(7, "a", 0);
        assert_eq!(first, numbers(7, "a", 0));
        assert!(first.iter().all(|number| (3..9).contains(number)), "{first:?}");
        for other in [numbers(8, "a", 0), numbers(7, "b", 0), numbers(7, "a", 1)] {
            assert_ne!(first, other);
        }
    }

    #[test]
    fn a_spoiled_prediction_that_is_believed_in_its_tick_is_noticed() {
        use vocaloco_core::decision::SkillVerdict;
        use vocaloco_core::selector::Reason;
        let decision = |viable| {
            let verdict = SkillVerdict {
                name: "walk".to_owned(),
                viability: None,
                cot: None,
                strangeness: None,
                viable,
                reason: Reason::Unusable,
            };
            Decision { skills: vec![verdict], ..Decision::default() }
        };
        let spoilt = Spoilt::default();
        assert_eq!(spoilt.believed(&decision(true)), None);
        spoilt.add("walk");
        assert_eq!(spoilt.believed(&decision(true)), Some("walk".to_owned()));
        assert_eq!(spoilt.believed(&decision(true)), None, "of the tick before");
        spoilt.add("walk");
        assert_eq!(spoilt.believed(&decision(false)), None);
    }

    #[test]
    fn every_kind_of_spoiled_observation_comes() {
        let robots = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        let robot = RobotModel::load(&robots, "anymal_d").unwrap();
        let tally = Tally::default();
        let mut senses = Senses::new(&robot, 1, &tally);
        let spoiled =
            (0..20_000_u32).filter(|&tick| senses.at(tick.into(), 0.02 * f64::from(tick)).1.is_some());
        assert!((80..160).contains(&spoiled.count()));
        assert_eq!(tally.counts().len(), SPOILS.len(), "{:?}", tally.counts());
    }
}
