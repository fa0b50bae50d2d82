//! Fills a policy's observation, tick by tick.

use std::f64::consts::TAU;

use abi_stable::std_types::{RNone, ROption};
use serde::{Deserialize, Serialize};

use super::{HeightPatch, Term};
use crate::contract::{Contract, ContractError, MAX_TERMS, inside, number_by_name};
use crate::{Command, ErrorCode, Needs, RobotDescription, RobotState, SkillError};

/// Every value of an observation is clipped to ± this, after its scale, as in `legged_gym`.
pub const OBSERVATION_CLIP: f32 = 100.0;

/// How terms with a history lie in the observation; the oldest value comes first in both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HistoryLayout {
    /// Term by term, each with its whole history: Isaac Lab.
    #[default]
    TermMajor,
    /// Tick by tick, each with all its terms, whose histories are equally long.
    TimeMajor,
}

/// Turns states into observations by a contract; one to an environment or plugin instance.
///
/// [`write`](Self::write) allocates nothing, and gives the same bytes for the same states since
/// [`reset`](Self::reset) on every machine.
#[derive(Clone, Debug)]
pub struct Observer {
    slots: Vec<Slot>,
    time_major: bool,
    len: usize,
    /// Index on the robot of each joint in the policy's order.
    joints: Vec<usize>,
    default_position_rad: Vec<f32>,
    feet: usize,
    initial_phase: f64,
    tick_s: f64,
    ticks: u32,
    /// The histories, slot by slot, the oldest value of each first.
    memory: Vec<f32>,
}

/// A term, checked, and where its history lies in the memory.
#[derive(Clone, Debug)]
struct Slot {
    term: Term,
    /// One for each component.
    scale: Vec<f32>,
    clip: f32,
    history: usize,
    period_s: f64,
    patch: Option<HeightPatch>,
    start: usize,
}

impl Slot {
    fn width(&self) -> usize {
        self.scale.len()
    }

    fn end(&self) -> usize {
        self.start + self.width() * self.history
    }
}

impl Observer {
    /// The observer of a contract on `robot`.
    ///
    /// # Errors
    /// A joint or a default position that does not fit, a term whose numbers make no sense, two patches
    /// of heights, or histories of different lengths in time-major layout.
    pub fn new(contract: &Contract, robot: &RobotDescription) -> Result<Self, ContractError> {
        let joints = contract.joints_on(robot)?;
        let default_position_rad = number_by_name(
            "action.default_position_rad",
            &contract.action.default_position_rad,
            &contract.joints,
        )?;
        let rate_hz = inside("rate_hz", contract.rate_hz, 1.0..=1000.0)?;
        let initial_phase = inside("initial_phase", contract.initial_phase, 0.0..=1.0)?;
        contract.command()?;
        inside("observation", contract.observation.len() as f64, 1.0..=MAX_TERMS as f64)?;
        let mut slots: Vec<Slot> = Vec::new();
        let mut len = 0;
        for (index, term) in contract.observation.iter().enumerate() {
            let field = format!("observation[{index}]");
            term.check(&field)?;
            if let Some(earlier) = slots.iter().find(|slot| slot.term == term.term) {
                let found = format!("{} again", earlier.term.name());
                return Err(ContractError::new(format!("{field}.term"), found, "every term once"));
            }
            let patch = term.patch;
            let width = match term.term {
                Term::BaseLinearVelocity
                | Term::BaseAngularVelocity
                | Term::ProjectedGravity
                | Term::VelocityCommand => 3,
                Term::PositionTarget => 4,
                Term::JointPosition | Term::JointVelocity | Term::JointTorque | Term::LastAction => {
                    joints.len()
                }
                Term::FootContact => robot.feet.len(),
                Term::GaitPhase => 2,
                Term::Heights => patch.map_or(0, |patch| patch.terrain().rows() * patch.terrain().columns()),
            };
            let default_clip = if term.term == Term::Heights { 1.0 } else { f64::INFINITY };
            let slot = Slot {
                term: term.term,
                scale: term.scale.in_order(&format!("{field}.scale"), width)?,
                clip: term.clip.unwrap_or(default_clip) as f32,
                history: term.history,
                period_s: term.period_s.unwrap_or(1.0),
                patch,
                start: len,
            };
            len = slot.end();
            slots.push(slot);
        }
        let time_major = contract.history_layout == HistoryLayout::TimeMajor;
        if let Some(odd) = slots.iter().position(|slot| time_major && slot.history != slots[0].history) {
            let field = format!("observation[{odd}].history");
            let wanted = format!("{}, one length for all in time_major", slots[0].history);
            return Err(ContractError::new(field, slots[odd].history, wanted));
        }
        Ok(Self {
            slots,
            time_major,
            len,
            joints,
            default_position_rad: default_position_rad.iter().map(|position| *position as f32).collect(),
            feet: robot.feet.len(),
            initial_phase,
            tick_s: 1.0 / rate_hz,
            ticks: 0,
            memory: vec![0.0; len],
        })
    }

    /// Number of values in an observation.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether an observation has no value; a contract asks for one at least.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// What it reads of a state beyond what every state has.
    pub fn needs(&self) -> Needs {
        let has = |term| self.slots.iter().any(|slot| slot.term == term);
        let patch = self.slots.iter().find_map(|slot| slot.patch);
        Needs {
            policy: true,
            terrain: patch.map_or(RNone, |patch| ROption::RSome(patch.terrain())),
            foot_contacts: has(Term::FootContact),
            joint_torques: has(Term::JointTorque),
        }
    }

    /// Each term in order, and how many values it has in an observation.
    pub fn layout(&self) -> impl Iterator<Item = (Term, usize)> {
        self.slots.iter().map(|slot| (slot.term, slot.width() * slot.history))
    }

    /// Forget everything: histories, and the phase.
    pub fn reset(&mut self) {
        self.ticks = 0;
    }

    /// Starts the cycle of `gait_phase` elsewhere from the next reset on, 0 to 1.
    pub fn set_initial_phase(&mut self, phase: f64) {
        self.initial_phase = phase;
    }

    /// The observation of this tick into `out`.
    ///
    /// | argument | meaning | shape |
    /// |---|---|---|
    /// | `state` | the robot, joints in its own order | terrain as [`needs`](Self::needs) asks |
    /// | `last_action` | the policy's previous output, clipped; zero after a reset | `[joint]`, the policy's order |
    /// | `out` | the observation | [`len`](Self::len) |
    ///
    /// # Errors
    /// `state`, `last_action` or `out` have other lengths; nothing has changed then.
    pub fn write(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        last_action: &[f32],
        out: &mut [f32],
    ) -> Result<(), SkillError> {
        self.check(state, last_action, out)?;
        for index in 0..self.slots.len() {
            let slot = &self.slots[index];
            let (start, end, width) = (slot.start, slot.end(), slot.width());
            let newest = end - width;
            self.memory.copy_within(start + width..end, start);
            self.measure(index, state, command, last_action);
            if self.ticks == 0 {
                for earlier in (start..newest).step_by(width) {
                    self.memory.copy_within(newest..end, earlier);
                }
            }
        }
        self.ticks = self.ticks.saturating_add(1);
        if self.time_major {
            let frames = self.slots[0].history;
            let mut at = 0;
            for frame in 0..frames {
                for slot in &self.slots {
                    let width = slot.width();
                    let from = slot.start + frame * width;
                    out[at..at + width].copy_from_slice(&self.memory[from..from + width]);
                    at += width;
                }
            }
        } else {
            out.copy_from_slice(&self.memory);
        }
        Ok(())
    }

    /// The newest value of a term, clipped and scaled, into its place in the memory.
    fn measure(&mut self, index: usize, state: &RobotState<'_>, command: &Command, last_action: &[f32]) {
        let slot = &self.slots[index];
        let end = slot.end();
        let out = &mut self.memory[end - slot.width()..end];
        match slot.term {
            Term::BaseLinearVelocity => out.copy_from_slice(&state.base_linear_velocity_m_per_s),
            Term::BaseAngularVelocity => out.copy_from_slice(&state.base_angular_velocity_rad_per_s),
            Term::ProjectedGravity => out.copy_from_slice(&state.projected_gravity),
            Term::VelocityCommand => out.copy_from_slice(&command.velocity),
            Term::PositionTarget => out.copy_from_slice(&command.target),
            Term::JointPosition => {
                for ((value, &joint), default_rad) in
                    out.iter_mut().zip(&self.joints).zip(&self.default_position_rad)
                {
                    *value = state.joint_position_rad[joint] - default_rad;
                }
            }
            Term::JointVelocity => by_joint(out, &self.joints, &state.joint_velocity_rad_per_s),
            Term::JointTorque => by_joint(out, &self.joints, &state.joint_torque_nm),
            Term::LastAction => out.copy_from_slice(last_action),
            Term::FootContact => {
                for (value, touches) in out.iter_mut().zip(state.foot_contact.iter()) {
                    *value = f32::from(u8::from(*touches > 0));
                }
            }
            Term::GaitPhase => {
                let cycles = f64::from(self.ticks) * self.tick_s / slot.period_s + self.initial_phase;
                let (sin, cos) = libm::sincos(TAU * (cycles - cycles.floor()));
                out.copy_from_slice(&[sin as f32, cos as f32]);
            }
            Term::Heights => {
                if let Some(patch) = &slot.patch {
                    patch.write(&state.terrain_m, out);
                }
            }
        }
        for (value, scale) in out.iter_mut().zip(&slot.scale) {
            *value = (value.clamp(-slot.clip, slot.clip) * scale).clamp(-OBSERVATION_CLIP, OBSERVATION_CLIP);
        }
    }

    fn check(&self, state: &RobotState<'_>, last_action: &[f32], out: &[f32]) -> Result<(), SkillError> {
        let length = |field: &str, found: usize, wanted: usize| {
            if found == wanted {
                return Ok(());
            }
            let message = format!("{field}: found {found} values, wanted {wanted}");
            Err(SkillError::new(ErrorCode::Input, message))
        };
        let joints = self.joints.len();
        length("joint_position_rad", state.joint_position_rad.len(), joints)?;
        length("joint_velocity_rad_per_s", state.joint_velocity_rad_per_s.len(), joints)?;
        length("last_action", last_action.len(), joints)?;
        length("observation", out.len(), self.len)?;
        for slot in &self.slots {
            match slot.term {
                Term::JointTorque => length("joint_torque_nm", state.joint_torque_nm.len(), joints)?,
                Term::FootContact => length("foot_contact", state.foot_contact.len(), self.feet)?,
                Term::Heights => length("terrain_m", state.terrain_m.len(), slot.width())?,
                _ => {}
            }
        }
        Ok(())
    }
}

fn by_joint(out: &mut [f32], joints: &[usize], values: &[f32]) {
    for (value, &joint) in out.iter_mut().zip(joints) {
        *value = values[joint];
    }
}
