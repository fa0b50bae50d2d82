//! The loop's one step: an observation in, a decision and joint targets out.
//!
//! Source-agnostic and, in simulated time, deterministic: a clock only measures there. It opens
//! nothing and never gives up. Whatever fails, it stands; DESIGN's table of faults is this file.

mod background;
mod deadline;
mod drive;
#[cfg(test)]
pub(crate) mod fixture;
mod follow;
mod frozen;
mod handover;
mod perceive;
mod roster;
mod skill;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use vocaloco_plugin_api::{CommandKind, JointTarget};

pub use background::give_way;
use deadline::{Overruns, WatchedController, WatchedPredictors};
pub use deadline::{Pace, Supervision, TickSummary, TickTimes};
use drive::Way;
pub use follow::{Followed, Follower, Watch};
use frozen::Frozen;
pub use frozen::FrozenLimits;
use handover::Handover;
pub use handover::Switching;
use roster::Pending;
pub use roster::{Place, Roster};
use skill::Limits;
pub use skill::{CallFault, Controller, Networks, Predict, Skill};

use crate::decision::{Decision, Forced, STAND, STOP, SkillVerdict, Timings};
use crate::manifest::{Deployment, HeightfieldLimits, MeasurementLimits};
use crate::observation::{Observation, ObservationFault, Required};
use crate::plugin::PluginError;
use crate::registry::LoadedDeployment;
use crate::robot::RobotModel;
use crate::selector::{Choice, Prediction, Reason, Rule, Selector};
use crate::stand::{Sensed, Stand};
use crate::switch::{Active, SwitchFilter, Windows};

/// Why a loop cannot start.
#[derive(Debug, Error)]
pub enum RuntimeError {
    /// A plugin that passed the registry refused the robot now.
    #[error(transparent)]
    Plugin(#[from] PluginError),
    /// A skill was loaded without its predictors.
    #[error("skill {0}: found no predictors, wanted models.viability and models.cot")]
    NoPredictors(String),
    /// The system gives no thread to watch a skill's calls on.
    #[error("skill {0}: found no thread for its calls ({1}), wanted two")]
    Thread(String, String),
}

/// What the loop needs of a deployment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RuntimeConfig {
    /// Rate of ticks, Hz.
    pub rate_hz: f64,
    /// Oldest terrain that is looked at, s.
    pub max_age_s: f64,
    /// Largest angle between the base's z axis and the vertical at which skills may drive, rad.
    pub max_tilt_rad: f64,
    /// For how long measurements may stay the same.
    pub frozen: FrozenLimits,
    /// The switch filter's windows.
    pub windows: Windows,
}

impl RuntimeConfig {
    /// That of a deployment which says nothing but its windows.
    pub const fn of(windows: Windows) -> Self {
        Self {
            rate_hz: 50.0,
            max_age_s: HeightfieldLimits::DEFAULT.max_age_s,
            max_tilt_rad: MeasurementLimits::DEFAULT.max_tilt_rad,
            frozen: FrozenLimits { measurement_s: None, terrain_s: None },
            windows,
        }
    }
}

impl From<&Deployment> for RuntimeConfig {
    fn from(deployment: &Deployment) -> Self {
        Self {
            rate_hz: deployment.rate_hz,
            max_age_s: deployment.heightfield.max_age_s,
            max_tilt_rad: deployment.measurement.max_tilt_rad,
            frozen: FrozenLimits {
                measurement_s: deployment.measurement.frozen_s,
                terrain_s: deployment.heightfield.frozen_s,
            },
            windows: Windows {
                switch: deployment.switch_window,
                stop: deployment.stop_window,
                resume: deployment.resume_window,
            },
        }
    }
}

/// What a tick came to.
#[derive(Clone, Debug)]
pub struct Tick<'a> {
    /// The record.
    pub decision: &'a Decision,
    /// One target a joint, in the robot's order, to be held until the next tick.
    pub joints: &'a [JointTarget],
    /// Why the observation could not be used, if it could not.
    pub fault: Option<ObservationFault>,
}

/// The runtime of a deployment.
pub struct Runtime {
    robot: Arc<RobotModel>,
    config: RuntimeConfig,
    required: Required,
    /// What the last usable observation held of that; none before the first.
    held: Option<Required>,
    limits: Limits,
    skills: Vec<Skill>,
    selector: Selector,
    filter: SwitchFilter,
    stand: Stand,
    follower: Option<Follower>,
    pending: Pending,
    supervision: Option<Supervision>,
    times: TickTimes,
    overruns: Overruns,
    /// The skill that was active at the start of this tick, if its prediction was over its budget.
    late: Option<usize>,
    handover: Handover,
    /// Where each skill that goes to position targets is going.
    targets: Vec<Option<Way>>,
    mixing: bool,
    /// Who made the targets in `joints`; none before the first usable observation.
    drives: Option<Active>,
    /// The stand drives because the skill that made `joints` is gone, and has measured nothing yet.
    is_orphaned: bool,
    last_t_s: Option<f64>,
    frozen: Frozen,
    ticks: u64,
    decision: Decision,
    joints: Vec<JointTarget>,
    candidate: Vec<JointTarget>,
    predictions: Vec<Prediction>,
    reasons: Vec<Reason>,
    contacts: Vec<u8>,
    terrain_m: Vec<f32>,
}

impl Runtime {
    /// The runtime of a loaded deployment, an instance of each skill's plugin made.
    ///
    /// # Errors
    /// A plugin refuses, or a skill lacks its predictors.
    pub fn new(loaded: LoadedDeployment) -> Result<Self, RuntimeError> {
        let config = RuntimeConfig::from(&loaded.deployment);
        let mut skills = Vec::new();
        for skill in loaded.skills {
            skills.push(Skill::of(skill, &loaded.robot.description)?);
        }
        Ok(Self::from_skills(config, loaded.robot, skills).with_switching(loaded.deployment.switching))
    }

    /// A runtime of any skills: what predicts and what drives need not come from files.
    pub fn from_skills(config: RuntimeConfig, robot: Arc<RobotModel>, skills: Vec<Skill>) -> Self {
        let joints = vec![JointTarget::default(); robot.joint_count()];
        let skill_count = skills.len();
        let verdicts = skills.iter().map(|skill| unseen(&skill.rule)).collect();
        Self {
            decision: Decision { skills: verdicts, ..Decision::default() },
            limits: Limits::of(&robot.description),
            selector: Selector::new(skills.iter().map(|skill| skill.rule.clone()).collect()),
            filter: SwitchFilter::new(config.windows),
            stand: Stand::new(Arc::clone(&robot)),
            predictions: vec![Prediction::NONE; skills.len()],
            reasons: Vec::with_capacity(skills.len()),
            candidate: joints.clone(),
            joints,
            required: required(&skills),
            held: None,
            skills,
            config,
            robot,
            follower: None,
            pending: Pending::default(),
            supervision: None,
            times: TickTimes::new(config.rate_hz),
            overruns: Overruns::new(config.rate_hz, skill_count),
            late: None,
            handover: Handover::default(),
            targets: vec![None; skill_count],
            mixing: false,
            drives: None,
            is_orphaned: false,
            last_t_s: None,
            frozen: Frozen::default(),
            ticks: 0,
            contacts: Vec::new(),
            terrain_m: Vec::new(),
        }
    }

    /// Measures every tick and, in real time, stands rather than wait for a call over its budget; in
    /// simulated time decisions stay what they are.
    ///
    /// # Errors
    /// In real time, when the system has no threads for the skills' calls.
    pub fn supervised(mut self, supervision: Supervision) -> Result<Self, RuntimeError> {
        if supervision.pace == Pace::Real {
            let (act, predict) = (supervision.act(), supervision.predict());
            self.skills = std::mem::take(&mut self.skills)
                .into_iter()
                .map(|skill| skill.watched(act, predict))
                .collect::<Result<_, _>>()?;
        }
        self.supervision = Some(supervision);
        Ok(self)
    }

    /// How long ticks took so far; of none where nothing measures them.
    pub fn times(&self) -> TickSummary {
        self.times.summary()
    }

    /// Back to the start of the loop: standing, every skill in service, time and ticks from zero.
    pub fn restart(&mut self) {
        for skill in &mut self.skills {
            skill.controller.revive();
        }
        self.selector.restart();
        self.filter = SwitchFilter::new(self.config.windows);
        self.overruns.restart();
        self.handover.end();
        self.targets.fill(None);
        self.drives = None;
        self.is_orphaned = false;
        self.last_t_s = None;
        self.held = None;
        self.frozen.forget();
        self.ticks = 0;
    }

    /// The robot.
    pub fn robot(&self) -> &Arc<RobotModel> {
        &self.robot
    }

    /// What the loop was configured with.
    pub fn config(&self) -> RuntimeConfig {
        self.config
    }

    /// What every observation must hold besides joints and base.
    pub fn required(&self) -> Required {
        self.required
    }

    /// The selector's rules, in the deployment's order.
    pub fn rules(&self) -> &[Rule] {
        self.selector.rules()
    }

    /// Whether an observation can be used in the next tick.
    ///
    /// # Errors
    /// The first field that is missing, not a number, or runs backwards in time.
    pub fn check(&self, observation: &Observation) -> Result<(), ObservationFault> {
        observation.check(&self.robot.description, self.required)?;
        match self.last_t_s {
            Some(last) if observation.t_s < last => {
                Err(ObservationFault::new("t_s", observation.t_s, format!("{last} or later")))
            }
            _ => Ok(()),
        }
    }

    /// One tick, with the skills that a [`Follower`] has ready. An observation that cannot be used stands, as [`fault_tick`](Self::fault_tick).
    pub fn tick(&mut self, observation: &Observation) -> Tick<'_> {
        let began = self.now();
        let checked = self.check(observation);
        if checked.is_ok() {
            self.held = Some(Required::held_by(observation));
        }
        self.follow_up();
        if let Err(fault) = checked {
            if observation.t_s.is_finite() {
                // Only the tick in which time jumps back is at fault, not all that follow.
                self.last_t_s = Some(observation.t_s);
            }
            return Tick { fault: Some(fault.clone()), ..self.stand_for(&fault, began) };
        }
        let last_t_s = self.last_t_s.replace(observation.t_s);
        let (now_s, limit_s) = (self.ticks as f64 / self.config.rate_hz, self.config.frozen.measurement_s);
        if let Err(fault) = self.frozen.check(observation, now_s, self.is_driven_by_a_skill(), limit_s) {
            return self.stand_for(&fault, began);
        }
        self.begin(observation.t_s, observation.command.velocity);
        self.note_pace(last_t_s);

        let field = self.field(observation);
        let choice = self.choose(field.as_ref(), observation);
        self.decision.field = field;
        let predicted = self.now();

        self.record_choice(choice);
        self.decide(choice, observation);
        self.drive(observation);
        self.time(began, predicted);
        self.record(choice);
        Tick { decision: &self.decision, joints: &self.joints, fault: None }
    }

    /// A tick without a usable observation: the robot stands, at once.
    pub fn fault_tick(&mut self, fault: &ObservationFault) -> Tick<'_> {
        let began = self.now();
        self.follow_up();
        Tick { fault: Some(fault.clone()), ..self.stand_for(fault, began) }
    }

    fn stand_for(&mut self, fault: &ObservationFault, began: Option<Duration>) -> Tick<'_> {
        self.begin(self.last_t_s.unwrap_or(0.0), [0.0; 3]);
        self.decision.heightfield_hash.clear();
        self.decision.field = None;
        self.decision.events.push(fault.to_string());
        for (skill, verdict) in self.decision.skills.iter_mut().enumerate() {
            let reason = self.selector.out_of_service(skill).unwrap_or(Reason::NoObservation);
            let name = std::mem::take(&mut verdict.name);
            *verdict =
                SkillVerdict { name, viability: None, cot: None, strangeness: None, viable: false, reason };
        }
        self.force(Forced::Observation);
        if self.drives.is_some() {
            self.stand(Sensed::default());
        } else {
            // Nothing was measured yet: the stand begins with the first joints that are.
            self.stand.pose(&mut self.joints);
        }
        self.time(began, began);
        self.record(Choice::Stop);
        Tick { decision: &self.decision, joints: &self.joints, fault: None }
    }

    /// Says so when this observation is much earlier or later than a tick after the last: what skills do goes by
    /// ticks.
    fn note_pace(&mut self, last_t_s: Option<f64>) {
        let Some(last_t_s) = last_t_s else { return };
        let (step_s, period_s) = (self.decision.t_s - last_t_s, 1.0 / self.config.rate_hz);
        if !(0.5 * period_s..=5.0 * period_s).contains(&step_s) {
            let line =
                format!("t_s: found {step_s:.3} s after the last observation, wanted about {period_s} s");
            self.decision.events.push(line);
        }
    }

    fn is_driven_by_a_skill(&self) -> bool {
        self.filter.active() != Active::Stand
    }

    /// By the clock that measures ticks, where one does.
    pub(crate) fn now(&self) -> Option<Duration> {
        self.supervision.map(|supervision| (supervision.clock)())
    }

    /// Counts the tick that ends now; only in real time are its timings part of the record.
    fn time(&mut self, began: Option<Duration>, predicted: Option<Duration>) {
        self.decision.timings = None;
        let Some(((began, predicted), ended)) = began.zip(predicted).zip(self.now()) else { return };
        self.times.add(ended.saturating_sub(began));
        if self.supervision.is_some_and(|supervision| supervision.pace == Pace::Real) {
            self.decision.timings = Some(Timings {
                predict_us: micros(began, predicted),
                act_us: micros(predicted, ended),
                total_us: micros(began, ended),
            });
        }
    }

    fn begin(&mut self, t_s: f64, command: [f32; 3]) {
        let decision = &mut self.decision;
        decision.t_s = t_s;
        decision.tick = self.ticks;
        decision.command = command;
        decision.forced = None;
        decision.committed = false;
        decision.events.clear();
        decision.events.append(&mut self.pending.events);
        decision.roster = self.pending.roster.take();
        self.late = None;
        self.ticks += 1;
    }

    fn record_choice(&mut self, choice: Choice) {
        let name = match choice {
            Choice::Stop => STOP,
            Choice::Skill(skill) => &self.selector.rules()[skill].name,
        };
        set(&mut self.decision.choice, name);
    }

    fn record(&mut self, choice: Choice) {
        let choice = if self.decision.forced.is_some_and(Forced::is_stop) { Choice::Stop } else { choice };
        self.record_choice(choice);
        let active = match self.decision.forced {
            Some(Forced::Overrun) => Active::Stand,
            _ => self.filter.active(),
        };
        let name = match active {
            Active::Stand => STAND,
            Active::Skill(skill) => &self.selector.rules()[skill].name,
        };
        set(&mut self.decision.active, name);
        self.decision.stopped = self.filter.is_stopped();
        self.decision.explain(choice, active, &self.filter);
    }
}

/// What every observation must hold for these skills.
fn required(skills: &[Skill]) -> Required {
    Required {
        joint_torques: skills.iter().any(|skill| skill.needs.joint_torques),
        foot_contacts: skills.iter().any(|skill| skill.needs.foot_contacts),
        base_in_odom: skills.iter().any(|skill| skill.rule.command.kind == CommandKind::PositionTarget),
    }
}

/// The verdict on a skill that nothing was predicted for yet.
fn unseen(rule: &Rule) -> SkillVerdict {
    SkillVerdict {
        name: rule.name.clone(),
        viability: None,
        cot: None,
        strangeness: None,
        viable: false,
        reason: Reason::NoObservation,
    }
}

fn set(text: &mut String, value: &str) {
    text.clear();
    text.push_str(value);
}

fn micros(from: Duration, to: Duration) -> f64 {
    to.saturating_sub(from).as_secs_f64() * 1e6
}
