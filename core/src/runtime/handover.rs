//! From one driver's targets to the next one's over a window, so that no drive is told to jump.

use vocaloco_plugin_api::JointTarget;

use super::Runtime;
use crate::moves::Moves;
use crate::observation::Observation;
use crate::switch::Active;

/// How targets go over from one driver to the next skill.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Switching {
    /// Length of the window, s; 0 switches at once.
    pub ramp_s: f64,
    /// Whether the outgoing skill goes on acting within the window; otherwise its last targets fade.
    pub mixing: bool,
}

impl Switching {
    /// At once.
    pub const NONE: Self = Self { ramp_s: 0.0, mixing: false };
}

/// A handover under way.
#[derive(Clone, Debug, Default)]
pub(super) struct Handover {
    /// Ticks of a window.
    pub(super) ticks: usize,
    /// Ticks of this one that are left.
    left: usize,
    /// What fades out.
    from: Vec<JointTarget>,
    /// The skill that goes on acting, by its place in the deployment.
    outgoing: Option<usize>,
}

impl Handover {
    /// Forgets the handover under way: whoever drives next begins from nothing.
    pub(super) const fn end(&mut self) {
        self.left = 0;
        self.outgoing = None;
    }

    /// Other skills from now on: one that is gone acts no more, its last targets fade.
    pub(super) fn adopt(&mut self, moves: &Moves) {
        self.outgoing = self.outgoing.and_then(|outgoing| moves.to(outgoing));
    }

    /// Begins at the targets that were sent last.
    fn begin(&mut self, sent: &[JointTarget], outgoing: Option<usize>) {
        self.left = self.ticks;
        self.from.clear();
        self.from.extend_from_slice(sent);
        self.outgoing = outgoing;
    }
}

impl Runtime {
    /// Makes switches as `switching` says.
    #[must_use]
    pub fn with_switching(mut self, switching: Switching) -> Self {
        self.handover.ticks = (switching.ramp_s * self.config.rate_hz).round().max(0.0) as usize;
        self.mixing = switching.mixing;
        self
    }

    /// Brings `candidate`, the targets of `skill`, to what is sent within a window.
    pub(super) fn hand_over(&mut self, skill: usize, observation: &Observation) {
        if self.drives != Some(Active::Skill(skill)) {
            let outgoing = match self.drives {
                Some(Active::Skill(outgoing)) if self.mixing => Some(outgoing),
                _ => None,
            };
            match self.drives {
                Some(_) => self.handover.begin(&self.joints, outgoing),
                // Nothing was sent yet.
                None => self.handover.end(),
            }
        }
        if self.handover.left == 0 {
            return;
        }
        if let Some(outgoing) = self.handover.outgoing {
            self.keep_acting(outgoing, observation);
        }
        let handover = &mut self.handover;
        let share = 1.0 - handover.left as f32 / (handover.ticks + 1) as f32;
        for (target, from) in self.candidate.iter_mut().zip(&handover.from) {
            *target = blend(from, target, share);
        }
        handover.left -= 1;
    }

    /// Fresh targets of the outgoing skill; from a fault on its last ones fade, and it is out of service.
    fn keep_acting(&mut self, outgoing: usize, observation: &Observation) {
        // `act` fills `candidate`, where the incoming skill's targets are.
        std::mem::swap(&mut self.candidate, &mut self.handover.from);
        let acted = match self.selector.out_of_service(outgoing) {
            None => self.counted_act(outgoing, observation, false).map_err(Some),
            Some(_) => Err(None),
        };
        std::mem::swap(&mut self.candidate, &mut self.handover.from);
        let Err(fault) = acted else { return };
        // What it left there is nothing to fade from: what was sent last is.
        self.handover.from.copy_from_slice(&self.joints);
        self.handover.outgoing = None;
        let reason = fault.and_then(|(call, fault)| self.fail(outgoing, call, &fault));
        if let Some(reason) = reason {
            self.decision.skills[outgoing].viable = false;
            self.decision.skills[outgoing].reason = reason;
        }
    }
}

/// The drive between two, `share` of the way to the second: its torque is the mean of theirs at every
/// position and speed.
///
/// ```text
/// k = (1−s)·k₀ + s·k₁    d, τ_ff alike    q* = ((1−s)·k₀·q*₀ + s·k₁·q*₁) / k
/// ```
///
/// | argument | meaning | unit |
/// |---|---|---|
/// | `from`, `to` | k₀ d₀ τ₀ q*₀ and k₁ d₁ τ₁ q*₁ | N·m/rad, N·m·s/rad, N·m, rad |
/// | `share` | s, 0 to 1 | |
///
/// A gain is 0 only where both are.
fn blend(from: &JointTarget, to: &JointTarget, share: f32) -> JointTarget {
    let mean = |from: f32, to: f32| (1.0 - share) * from + share * to;
    let stiffness = mean(from.stiffness_nm_per_rad, to.stiffness_nm_per_rad);
    let pull = mean(from.stiffness_nm_per_rad * from.position_rad, to.stiffness_nm_per_rad * to.position_rad);
    JointTarget {
        position_rad: pull / stiffness,
        stiffness_nm_per_rad: stiffness,
        damping_nms_per_rad: mean(from.damping_nms_per_rad, to.damping_nms_per_rad),
        feed_forward_nm: mean(from.feed_forward_nm, to.feed_forward_nm),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runtime::fixture::{Fake, Loop, fake, skill};
    use crate::selector::Reason;

    /// Targets that no two skills share.
    fn at(joints: &mut [JointTarget], position_rad: f32, stiffness_nm_per_rad: f32) {
        for joint in joints {
            *joint = JointTarget {
                position_rad,
                stiffness_nm_per_rad,
                damping_nms_per_rad: 2.0,
                feed_forward_nm: 0.0,
            };
        }
    }

    /// Two skills at 0.1 and 0.3 rad, the first driving; and a switch of it to the second, tick by tick.
    fn switched(switching: Switching, spoil: impl FnOnce(&Fake)) -> (Vec<JointTarget>, [Fake; 2], Loop) {
        let [one, other] = [fake(0.99, 0.2), fake(0.99, 0.9)];
        one.with(|script| script.act = Some(|joints| at(joints, 0.1, 60.0)));
        other.with(|script| script.act = Some(|joints| at(joints, 0.3, 80.0)));
        let mut run = Loop::new(vec![skill("one", &one), skill("other", &other)]);
        run.runtime = run.runtime.with_switching(switching);
        run.until("one");
        run.ticks(20);
        spoil(&one);
        one.with(|script| script.prediction = Some((0.99, 0.9)));
        other.with(|script| script.prediction = Some((0.99, 0.2)));
        run.until("other");
        let mut sent = vec![run.runtime.joints[0]];
        sent.extend((0..8).map(|_| {
            run.tick();
            run.runtime.joints[0]
        }));
        (sent, [one, other], run)
    }

    #[test]
    fn without_a_window_the_next_skill_drives_at_once() {
        let (sent, ..) = switched(Switching::NONE, |_| ());
        assert!(sent.iter().all(|joint| joint.position_rad == 0.3 && joint.stiffness_nm_per_rad == 80.0));
    }

    #[test]
    fn targets_go_over_in_even_steps_and_gains_are_never_zero() {
        let (sent, [one, _], _) = switched(Switching { ramp_s: 0.08, mixing: false }, |_| ());
        let stiffness: Vec<f32> = sent.iter().take(6).map(|joint| joint.stiffness_nm_per_rad).collect();
        assert_eq!(stiffness, [64.0, 68.0, 72.0, 76.0, 80.0, 80.0]);
        assert!(sent.windows(2).all(|pair| pair[1].position_rad >= pair[0].position_rad));
        assert!(sent[0].position_rad > 0.1 && sent[3].position_rad < 0.3 && sent[4].position_rad == 0.3);
        assert!(
            sent.iter().all(|joint| joint.stiffness_nm_per_rad >= 60.0 && joint.damping_nms_per_rad == 2.0)
        );
        let acts = one.with(|script| script.acts);
        let (_, [again, _], _) = switched(Switching::NONE, |_| ());
        assert_eq!(acts, again.with(|script| script.acts), "the outgoing skill does not act");
    }

    #[test]
    fn the_torque_of_a_blend_is_the_mean_of_the_torques() {
        let one = JointTarget {
            position_rad: 0.1,
            stiffness_nm_per_rad: 60.0,
            damping_nms_per_rad: 2.0,
            feed_forward_nm: 5.0,
        };
        let other = JointTarget {
            position_rad: -0.4,
            stiffness_nm_per_rad: 90.0,
            damping_nms_per_rad: 1.0,
            feed_forward_nm: -3.0,
        };
        let torque = |joint: &JointTarget| {
            joint.stiffness_nm_per_rad * (joint.position_rad - 0.7) - joint.damping_nms_per_rad * 1.3
                + joint.feed_forward_nm
        };
        let wanted = 0.75 * torque(&one) + 0.25 * torque(&other);
        assert!((torque(&blend(&one, &other, 0.25)) - wanted).abs() < 1e-4);
    }

    #[test]
    fn mixing_lets_the_outgoing_skill_act_on_without_a_reset() {
        let (sent, [one, other], _) = switched(Switching { ramp_s: 0.08, mixing: true }, |one| {
            one.with(|script| script.act = Some(|joints| at(joints, 0.0, 60.0)));
        });
        assert!(sent[0].position_rad < 0.1, "it fades from what the outgoing skill says now, not from 0.1");
        assert_eq!(sent[4].position_rad, 0.3);
        let [(one_resets, one_acts), (other_resets, _)] =
            [one, other].map(|skill| skill.with(|script| (script.resets, script.acts)));
        assert_eq!((one_resets, other_resets), (1, 1), "each once, on its activation");
        let (_, [alone, _], _) = switched(Switching::NONE, |_| ());
        assert_eq!(one_acts, alone.with(|script| script.acts) + 4);
    }

    #[test]
    fn an_outgoing_skill_that_fails_is_retired_and_the_incoming_one_drives_on() {
        let [one, other] = [fake(0.99, 0.2), fake(0.99, 0.9)];
        one.with(|script| script.act = Some(|joints| at(joints, 0.1, 60.0)));
        other.with(|script| script.act = Some(|joints| at(joints, 0.3, 80.0)));
        let mut run = Loop::new(vec![skill("one", &one), skill("other", &other)]);
        run.runtime = run.runtime.with_switching(Switching { ramp_s: 0.08, mixing: true });
        run.until("one");
        run.ticks(20);
        one.with(|script| script.prediction = Some((0.99, 0.9)));
        other.with(|script| script.prediction = Some((0.99, 0.2)));
        assert_eq!(run.ticks(9).active, "one");
        one.with(|script| script.fails = true);
        let decision = run.tick();
        assert_eq!(decision.active, "other");
        assert_eq!(decision.skills[0].reason, Reason::PluginFailed);
        assert!(decision.events.iter().any(|event| event.contains("skill one is taken out of service")));
        assert_eq!(run.runtime.joints[0].stiffness_nm_per_rad, 64.0, "it fades from what was sent last");
        assert_eq!(run.ticks(4).active, "other");
        assert_eq!(run.runtime.joints[0].position_rad, 0.3);
    }

    #[test]
    fn a_switch_to_the_stand_waits_for_no_window() {
        let (_, [_, other], mut run) = switched(Switching { ramp_s: 0.08, mixing: false }, |_| ());
        other.with(|script| script.fails = true);
        assert_eq!(run.tick().active, "stand");
        assert!(run.stands_with_stand_gains());
    }
}
