//! The second half of a tick: who drives, and the targets that come of it.

use vocaloco_plugin_api::{JointTarget, RobotState, TerrainPatch};

use super::Runtime;
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
            Forced::Terrain | Forced::Observation | Forced::Fault => self.filter.stop_now(),
        }
    }

    /// Targets from whoever drives; a skill that fails is retired and the stand takes over.
    pub(super) fn drive(&mut self, observation: &Observation) {
        if let Active::Skill(skill) = self.filter.active() {
            let takes_over = self.drives != Some(Active::Skill(skill));
            match self.act(skill, observation, takes_over) {
                Ok(()) => {
                    self.hand_over(skill, observation);
                    std::mem::swap(&mut self.joints, &mut self.candidate);
                    self.drives = Some(Active::Skill(skill));
                    return;
                }
                Err(fault) => {
                    let name = &self.selector.rules()[skill].name;
                    self.decision.events.push(format!("skill {name} is taken out of service: {fault}"));
                    self.selector.retire(skill, Reason::PluginFailed);
                    self.decision.skills[skill].viable = false;
                    self.decision.skills[skill].reason = Reason::PluginFailed;
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

    /// Targets of one skill into `candidate`, `reset` first if it did not drive before.
    pub(super) fn act(&mut self, index: usize, observation: &Observation, reset: bool) -> Result<(), String> {
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
            skill.controller.reset(&state).map_err(|error| format!("reset: {error}"))?;
        }
        // A controller that leaves a target out must not drive with what stood there before.
        self.candidate.fill(JointTarget { position_rad: f32::NAN, ..JointTarget::default() });
        let acted = skill.controller.act(&state, &observation.command, &mut self.candidate);
        acted.map_err(|error| format!("act: {error}"))?;
        self.limits.check(&self.candidate)
    }
}
