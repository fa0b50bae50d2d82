//! The second half of a tick: who drives, and the targets that come of it.

use std::time::Duration;

use vocaloco_plugin_api::{JointTarget, RobotState, TerrainPatch};

use super::{CallFault, Runtime, Supervision};
use crate::decision::Forced;
use crate::observation::Observation;
use crate::selector::{Choice, Reason, is_zero};
use crate::stand::Sensed;
use crate::switch::Active;

impl Runtime {
    /// Who drives: the window, unless a fault or a zero command overrules it.
    pub(super) fn decide(&mut self, choice: Choice, observation: &Observation) {
        let active_verdict = match self.filter.active() {
            Active::Skill(skill) => Some(&self.decision.skills[skill]),
            Active::Stand => None,
        };
        let active_is_viable = active_verdict.is_none_or(|verdict| verdict.viable);
        let retired = active_verdict.is_some_and(|verdict| verdict.reason.is_out_of_service());
        if self.decision.heightfield_hash.is_empty() {
            self.force(Forced::Terrain);
        } else if retired {
            self.force(Forced::Fault);
        } else if is_zero(&observation.command) {
            self.force(Forced::ZeroCommand);
        } else {
            self.filter.step(choice, active_is_viable);
        }
    }

    pub(super) fn force(&mut self, why: Forced) {
        self.decision.forced = Some(why);
        match why {
            Forced::ZeroCommand => self.filter.stand_now(),
            // The skill goes on as soon as it answers in time.
            Forced::Overrun => {}
            Forced::Terrain | Forced::Observation | Forced::Fault => self.filter.stop_now(),
        }
    }

    /// Targets from whoever drives; a skill that fails is retired, one that is late is passed over, and
    /// the stand takes over.
    pub(super) fn drive(&mut self, observation: &Observation) {
        if let Active::Skill(skill) = self.filter.active() {
            let acted = if self.is_late { Ok(None) } else { self.timed_act(skill, observation) };
            match acted {
                Ok(Some(())) => {
                    self.hand_over(skill, observation);
                    std::mem::swap(&mut self.joints, &mut self.candidate);
                    self.drives = Some(Active::Skill(skill));
                    return;
                }
                Ok(None) => self.force(Forced::Overrun),
                Err(reason) => {
                    self.decision.skills[skill].viable = false;
                    self.decision.skills[skill].reason = reason;
                    self.force(Forced::Fault);
                }
            }
        }
        self.stand(Sensed {
            position_rad: Some(&observation.joint_position_rad),
            torque_nm: observation.joint_torque_nm.as_deref(),
            contact: observation.foot_contact.as_deref(),
            gravity: Some(observation.projected_gravity),
            velocity_m_per_s: Some(observation.base_linear_velocity),
        });
    }

    pub(super) fn stand(&mut self, sensed: Sensed<'_>) {
        if self.drives != Some(Active::Stand) {
            let last = self.drives.is_some().then_some(self.joints.as_slice());
            self.stand.begin(sensed, last);
            self.drives = Some(Active::Stand);
        }
        self.stand.step(1.0 / self.config.rate_hz, sensed, &mut self.joints);
    }

    /// Targets of one skill; none when they are late, an error when it is out of service for it.
    fn timed_act(&mut self, skill: usize, observation: &Observation) -> Result<Option<()>, Reason> {
        let began = self.now();
        let takes_over = self.drives != Some(Active::Skill(skill));
        let acted = self.act(skill, observation, takes_over);
        let is_late = matches!(acted, Err((_, CallFault::Overrun(_))));
        self.count_overrun(is_late, began, Supervision::act);
        match acted {
            Ok(()) => Ok(Some(())),
            Err((call, fault)) => match self.fail(skill, call, &fault) {
                Some(reason) => Err(reason),
                None => Ok(None),
            },
        }
    }

    /// Records why a call of a skill came to nothing; the reason, if it is out of service for it.
    pub(super) fn fail(&mut self, skill: usize, call: &str, fault: &CallFault) -> Option<Reason> {
        let reason = match fault {
            CallFault::Failed(_) => Some(Reason::PluginFailed),
            CallFault::Overrun(_) => self.overruns.note(skill, self.decision.tick).then_some(Reason::TooSlow),
        };
        let name = &self.selector.rules()[skill].name;
        self.decision.events.push(match reason {
            Some(Reason::TooSlow) => {
                format!("skill {name} is taken out of service: {call}: {fault}, three times within a second")
            }
            Some(_) => format!("skill {name} is taken out of service: {call}: {fault}"),
            None => format!("skill {name} is late: {call}: {fault}"),
        });
        if let Some(reason) = reason {
            self.selector.retire(skill, reason);
        }
        reason
    }

    /// Counts a call that is late, or took longer than its budget, whatever comes of it.
    pub(super) fn count_overrun(
        &mut self,
        is_late: bool,
        began: Option<Duration>,
        budget: fn(&Supervision) -> Duration,
    ) {
        let Some((supervision, (began, ended))) = self.supervision.zip(began.zip(self.now())) else { return };
        if is_late || ended.saturating_sub(began) > budget(&supervision) {
            self.times.add_overrun();
        }
    }

    /// Targets of one skill into `candidate`, `reset` first if it did not drive before; of a fault also
    /// the call that it is of.
    pub(super) fn act(
        &mut self,
        index: usize,
        observation: &Observation,
        reset: bool,
    ) -> Result<(), (&'static str, CallFault)> {
        let skill = &mut self.skills[index];
        self.contacts.clear();
        let contacts = observation.foot_contact.iter().flatten();
        self.contacts.extend(contacts.map(|&touches| u8::from(touches)));
        self.terrain_m.clear();
        if let Some(patch) = skill.needs.terrain.as_ref().into_option() {
            let patch: &TerrainPatch = patch;
            self.terrain_m.resize(patch.rows() * patch.columns(), f32::NAN);
            if let Some(elevation) = &observation.elevation {
                elevation.patch(patch, &mut self.terrain_m);
            }
        }
        let state = RobotState {
            time_s: observation.t_s,
            joint_position_rad: observation.joint_position_rad.as_slice().into(),
            joint_velocity_rad_per_s: observation.joint_velocity_rad_per_s.as_slice().into(),
            joint_torque_nm: observation.joint_torque_nm.as_deref().unwrap_or_default().into(),
            base_linear_velocity_m_per_s: observation.base_linear_velocity,
            base_angular_velocity_rad_per_s: observation.base_angular_velocity,
            projected_gravity: observation.projected_gravity,
            foot_contact: self.contacts.as_slice().into(),
            terrain_m: self.terrain_m.as_slice().into(),
        };
        if reset {
            skill.controller.reset(&state).map_err(|fault| ("reset", fault))?;
        }
        // A controller that leaves a target out must not drive with what stood there before.
        self.candidate.fill(JointTarget { position_rad: f32::NAN, ..JointTarget::default() });
        let acted = skill.controller.act(&state, &observation.command, &mut self.candidate);
        acted.map_err(|fault| ("act", fault))?;
        self.limits.check(&self.candidate).map_err(|line| ("act", CallFault::Failed(line)))
    }
}
