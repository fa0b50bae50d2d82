//! The second half of a tick: who drives, and the targets that come of it.

use std::time::Duration;

use vocaloco_plugin_api::{Command, JointTarget, RobotState, TerrainPatch};

use super::{CallFault, Runtime, Supervision};
use crate::decision::Forced;
use crate::observation::Observation;
use crate::selector::{Choice, Reason, is_zero};
use crate::stand::Sensed;
use crate::switch::Active;
use crate::target::PositionTarget;

/// Where a skill is going.
#[derive(Clone, Copy, Debug)]
pub(super) struct Way {
    target: PositionTarget,
    /// Whether stops and switches wait for its end.
    binds: bool,
}

impl Runtime {
    /// Who drives: the window, unless a fault or a zero command overrules it.
    pub(super) fn decide(&mut self, choice: Choice, observation: &Observation) {
        let active_verdict = match self.filter.active() {
            Active::Skill(skill) => Some(&self.decision.skills[skill]),
            Active::Stand => None,
        };
        let retired = active_verdict.is_some_and(|verdict| verdict.reason.is_out_of_service());
        if self.decision.heightfield_hash.is_empty() {
            self.force(Forced::Terrain);
        } else if retired {
            self.force(Forced::Fault);
        } else if self.has_fallen(observation) {
            self.force(Forced::Fallen);
        } else if is_zero(&observation.command) {
            self.force(Forced::ZeroCommand);
        } else if self.is_committed(observation) {
            let verdicts = &self.decision.skills;
            self.filter.count(choice, |skill| verdicts[skill].viable);
            self.decision.committed = true;
            self.force(Forced::Committed);
        } else {
            let verdicts = &self.decision.skills;
            self.filter.step(choice, |skill| verdicts[skill].viable);
        }
    }

    /// Whether the base is tilted further than skills may drive at; an event says so.
    fn has_fallen(&mut self, observation: &Observation) -> bool {
        let [x, y, z] = observation.projected_gravity.map(f64::from);
        let (tilt_rad, max_tilt_rad) = (libm::atan2(libm::hypot(x, y), -z), self.config.max_tilt_rad);
        let has_fallen = tilt_rad > max_tilt_rad;
        if has_fallen {
            let line = format!(
                "projected_gravity: found a base tilted by {tilt_rad:.2} rad, wanted at most {max_tilt_rad}"
            );
            self.decision.events.push(line);
        }
        has_fallen
    }

    /// Whether the active skill is on its way to a target and must not be stopped there.
    fn is_committed(&self, observation: &Observation) -> bool {
        let Active::Skill(skill) = self.filter.active() else { return false };
        let way = self.targets[skill].filter(|way| way.binds).zip(observation.base_in_odom);
        way.is_some_and(|(way, base)| !way.target.is_over(&base, observation.t_s))
    }

    /// What a skill is told: the command, or the way to its target, which is set when it begins or has got
    /// there. Only a skill that is chosen again commits itself to another; one that was late goes on to the one it
    /// was bound to.
    fn command(&mut self, skill: usize, observation: &Observation, takes_over: bool) -> Command {
        let begins = takes_over && !self.decision.committed;
        let (asked, now_s) = (observation.command, observation.t_s);
        let rule = &self.selector.rules()[skill];
        let (Some(distance_m), Some(base)) = (rule.command.target_distance_m, observation.base_in_odom)
        else {
            return asked;
        };
        let [forward, left, _] = asked.velocity;
        let going = self.targets[skill].filter(|way| !begins && !way.target.is_over(&base, now_s));
        let way = going.unwrap_or_else(|| Way {
            target: PositionTarget::ahead(
                &base,
                [forward, left],
                distance_m as f32,
                rule.time_limit_s,
                now_s,
            ),
            binds: rule.committed && (begins || self.decision.choice == rule.name),
        });
        self.targets[skill] = Some(way);
        way.target.command(&base, asked.velocity, now_s)
    }

    pub(super) fn force(&mut self, why: Forced) {
        self.decision.forced = Some(why);
        match why {
            Forced::ZeroCommand => self.filter.stand_now(),
            // The skill goes on, after an overrun as soon as it answers in time.
            Forced::Overrun | Forced::Committed => {}
            Forced::Terrain | Forced::Observation | Forced::Fallen | Forced::Fault => self.filter.stop_now(),
        }
    }

    /// Targets from whoever drives; a skill that fails is retired, one that is late is passed over, and
    /// the stand takes over.
    pub(super) fn drive(&mut self, observation: &Observation) {
        if let Active::Skill(skill) = self.filter.active() {
            let is_late = self.late == Some(skill);
            let acted = if is_late { Ok(None) } else { self.timed_act(skill, observation) };
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
        if std::mem::take(&mut self.is_orphaned) || self.drives != Some(Active::Stand) {
            let last = self.drives.is_some().then_some(self.joints.as_slice());
            self.stand.begin(sensed, last);
            self.drives = Some(Active::Stand);
        }
        self.stand.step(1.0 / self.config.rate_hz, sensed, &mut self.joints);
    }

    /// Targets of one skill; none when they are late, an error when it is out of service for it.
    fn timed_act(&mut self, skill: usize, observation: &Observation) -> Result<Option<()>, Reason> {
        let takes_over = self.drives != Some(Active::Skill(skill));
        match self.counted_act(skill, observation, takes_over) {
            Ok(()) => Ok(Some(())),
            Err((call, fault)) => match self.fail(skill, call, &fault) {
                Some(reason) => Err(reason),
                None => Ok(None),
            },
        }
    }

    /// As [`act`](Self::act), counted where it is late.
    pub(super) fn counted_act(
        &mut self,
        skill: usize,
        observation: &Observation,
        takes_over: bool,
    ) -> Result<(), (&'static str, CallFault)> {
        let began = self.now();
        let acted = self.act(skill, observation, takes_over);
        let is_late = matches!(acted, Err((_, CallFault::Overrun(_))));
        self.count_overrun(is_late, began, Supervision::act);
        acted
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
        let command = self.command(index, observation, reset);
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
        // A controller that leaves a target out must not drive with what stood there before.
        self.candidate.fill(JointTarget { position_rad: f32::NAN, ..JointTarget::default() });
        if reset {
            skill.controller.begin(&state, &command, &mut self.candidate)?;
        } else {
            let acted = skill.controller.act(&state, &command, &mut self.candidate);
            acted.map_err(|fault| ("act", fault))?;
        }
        self.limits.check(&self.candidate).map_err(|line| ("act", CallFault::Failed(line)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decision_log::Setup;
    use crate::observation::BaseInOdom;
    use crate::replay::as_recorded;
    use crate::runtime::Skill;
    use crate::runtime::fixture::{Fake, Loop, fake, skill};
    use vocaloco_plugin_api::CommandKind;

    /// A skill that goes 1.5 m ahead within 2 s, committed or not.
    fn climber(fake: &Fake, committed: bool) -> Skill {
        let mut climb = skill("climb", fake);
        climb.rule.command.kind = CommandKind::PositionTarget;
        climb.rule.command.target_distance_m = Some(1.5);
        climb.rule.time_limit_s = 2.0;
        climb.rule.committed = committed;
        climb
    }

    fn at(run: &mut Loop, x_m: f64) {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        // Looking along y.
        let base = BaseInOdom { position_m: [3.0, x_m, 0.5], orientation_xyzw: [0.0, 0.0, half, half] };
        run.observation.base_in_odom = Some(base);
    }

    fn climbing(committed: bool) -> (Fake, Loop) {
        let climb = fake(0.99, 0.2);
        let mut run = Loop::new(vec![climber(&climb, committed), skill("walk", &fake(0.99, 0.9))]);
        at(&mut run, 0.0);
        run.until("climb");
        (climb, run)
    }

    #[test]
    fn a_target_is_set_on_activation_and_anew_once_reached() {
        let (climb, mut run) = climbing(false);
        let told = || climb.with(|script| script.told).unwrap().target;
        let close = |found: [f32; 4], wanted: [f32; 4]| {
            let off = found.iter().zip(wanted).map(|(found, wanted)| (found - wanted).abs());
            assert!(off.fold(0.0, f32::max) < 1e-4, "{found:?}, {wanted:?}");
        };
        close(told(), [1.5, 0.0, 0.0, 2.0]);
        at(&mut run, 0.6);
        run.ticks(10);
        close(told(), [0.9, 0.0, 0.0, 1.8]);
        at(&mut run, 1.5);
        run.tick();
        close(told(), [1.5, 0.0, 0.0, 2.0]);
        run.ticks(100);
        close(told(), [1.5, 0.0, 0.0, 2.0]);
    }

    #[test]
    fn a_committed_skill_goes_on_unviable_until_its_target_or_its_time() {
        // The window has agreed long since.
        for (reached, wanted) in [(true, 15), (false, 80)] {
            let (climb, mut run) = climbing(true);
            climb.with(|script| script.prediction = Some((0.1, 0.2)));
            let decision = run.ticks(15);
            assert_eq!((decision.active.as_str(), decision.forced), ("climb", Some(Forced::Committed)));
            assert_eq!(decision.choice, "walk", "what would be chosen is said");
            at(&mut run, if reached { 1.5 } else { 0.7 });
            let ticks = 15 + run.until("walk");
            assert!((wanted..wanted + 25).contains(&ticks), "{ticks} ticks after its start");
        }
    }

    #[test]
    fn a_committed_skill_that_stays_viable_leaves_at_its_target_to_who_has_won_on_the_way() {
        let (climb, mut run) = climbing(true);
        climb.with(|script| script.prediction = Some((0.99, 1.5)));
        assert_eq!(run.ticks(15).active, "climb", "dearer than walking, and half-way");
        at(&mut run, 1.5);
        assert_eq!(run.tick().active, "walk");
    }

    #[test]
    fn a_committed_skill_that_was_late_goes_on_to_the_target_it_was_bound_to() {
        let (climb, mut run) = climbing(true);
        at(&mut run, 1.0);
        run.ticks(20);
        // As after a tick in which it was late.
        run.runtime.drives = Some(Active::Stand);
        assert_eq!(run.tick().active, "climb");
        let [ahead_m, .., left_s] = climb.with(|script| script.told).unwrap().target;
        assert!((ahead_m - 0.5).abs() < 1e-4 && (left_s - 1.58).abs() < 1e-4, "{ahead_m} m in {left_s} s");
    }

    #[test]
    fn a_skill_binds_itself_anew_by_what_is_chosen_in_the_tick_that_ends_its_way() {
        let (climb, mut run) = climbing(true);
        run.ticks(5);
        at(&mut run, 1.5);
        climb.with(|script| script.prediction = Some((0.1, 0.2)));
        assert_eq!(run.tick().choice, "walk");
        let decision = run.tick();
        assert_eq!((decision.active.as_str(), decision.committed), ("climb", false), "nothing binds it");

        let (climb, mut run) = climbing(true);
        climb.with(|script| script.prediction = Some((0.1, 0.2)));
        run.ticks(5);
        at(&mut run, 1.5);
        climb.with(|script| script.prediction = Some((0.99, 0.2)));
        assert_eq!(run.tick().choice, "climb");
        assert!(run.tick().committed, "it has won again");
    }

    #[test]
    fn a_record_of_a_committed_skill_that_fails_decides_itself_again() {
        let (climb, mut run) = climbing(true);
        let setup = Setup::of(&run.runtime, "test");
        run.runtime.restart();
        run.observation.t_s = 0.0;
        let mut decisions = Vec::new();
        for tick in 0..80 {
            match tick {
                // It goes on unviable, and walk has won the window.
                20 => climb.with(|script| script.prediction = Some((0.1, 0.2))),
                40 => climb.with(|script| script.fails = true),
                _ => {}
            }
            decisions.push(run.tick());
        }
        let failed = &decisions[40];
        assert!(failed.committed && failed.forced == Some(Forced::Fault), "{failed:?}");
        for (again, decision) in as_recorded(&setup, &decisions).iter().zip(&decisions) {
            assert!(again.agrees_with(decision), "tick {}: {again:?}, {decision:?}", decision.tick);
        }
    }

    #[test]
    fn a_skill_that_is_not_committed_stops_like_any_other() {
        let (climb, mut run) = climbing(false);
        climb.with(|script| script.prediction = Some((0.1, 0.2)));
        assert_eq!(run.until("walk"), 10);
    }

    #[test]
    fn faults_lost_terrain_and_a_zero_command_wait_for_no_target() {
        let spoils: [fn(&Fake, &mut Loop); 3] = [
            |climb, _| climb.with(|script| script.fails = true),
            |_, run| run.observation.elevation = None,
            |_, run| run.observation.command = Command::velocity(0.0, 0.0, 0.0),
        ];
        for spoil in spoils {
            let (climb, mut run) = climbing(true);
            run.ticks(5);
            spoil(&climb, &mut run);
            assert_eq!(run.tick().active, "stand");
        }
    }

    #[test]
    fn without_odometry_a_target_cannot_be_set_and_the_field_is_named() {
        let (_, mut run) = climbing(true);
        run.observation.base_in_odom = None;
        let decision = run.tick();
        assert_eq!((decision.active.as_str(), decision.forced), ("stand", Some(Forced::Observation)));
        assert!(decision.events[0].starts_with("base_in_odom: found nothing"), "{:?}", decision.events);
    }
}
