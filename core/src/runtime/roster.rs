//! Skills that come and go between two ticks.

use super::{Follower, Runtime, Skill, required, unseen};
use crate::decision::RosterSkill;
use crate::decision_log::SetupSkill;
use crate::manifest::Deadlines;
use crate::moves::Moves;
use crate::selector::Prediction;
use crate::switch::Active;

/// The skills of a deployment as they shall be from the next tick on.
pub struct Roster {
    /// One a skill, in the deployment's order.
    pub places: Vec<Place>,
    /// What happened, for people; part of the next decision.
    pub events: Vec<String>,
    /// Budgets of calls from then on; none leaves them as they are.
    pub deadlines: Option<Deadlines>,
}

/// A skill in a changed deployment.
pub enum Place {
    /// The one of this name goes on as it is; without one the place is empty.
    Kept(String),
    /// This one takes part from now on, in place of one of its name.
    New(Skill),
}

/// What the next decision says of a change.
#[derive(Debug, Default)]
pub(super) struct Pending {
    pub(super) events: Vec<String>,
    pub(super) roster: Option<Vec<RosterSkill>>,
}

impl Runtime {
    /// Takes over what `follower` finds changed, at the start of a tick.
    #[must_use]
    pub fn following(mut self, follower: Follower) -> Self {
        self.follower = Some(follower);
        self
    }

    /// Takes over what has changed once observations have shown what they hold.
    pub(super) fn follow_up(&mut self) {
        if self.held.is_none() {
            return;
        }
        let Some(roster) = self.follower.as_mut().and_then(Follower::changed) else { return };
        let (gone, starved) = self.take_over(roster);
        if let Some(follower) = &self.follower {
            follower.retire(gone, starved);
        }
    }

    /// Other skills from the next tick on; those that are gone, to be dropped where time does not matter.
    ///
    /// A skill that goes on keeps its state, its place in the window and its faults. When the active one
    /// is gone or replaced, the robot stands, as at a stop. One that needs what observations do not hold changes
    /// nothing: with it every one of them would be at fault.
    pub fn adopt(&mut self, roster: Roster) -> Vec<Skill> {
        let (mut gone, starved) = self.take_over(roster);
        gone.extend(starved);
        gone
    }

    /// As [`adopt`](Self::adopt): those that are gone, and those that were not taken up.
    fn take_over(&mut self, roster: Roster) -> (Vec<Skill>, Vec<Skill>) {
        let Roster { places, mut events, deadlines } = roster;
        let (places, starved) = self.fed(places, &mut events);
        let is_here = |name: &str| self.skills.iter().any(|skill| skill.rule.name == name);
        let places: Vec<Place> = places
            .into_iter()
            .filter(|place| !matches!(place, Place::Kept(name) if !is_here(name)))
            .collect();
        let names = places.iter().map(|place| match place {
            Place::Kept(name) => Some(name),
            Place::New(_) => None,
        });
        if names.eq(self.skills.iter().map(|skill| Some(&skill.rule.name))) {
            self.pending.events.append(&mut events);
            self.share_time(deadlines);
            return (Vec::new(), starved);
        }
        let after = places.iter().map(|place| match place {
            Place::Kept(name) => (name.as_str(), false),
            Place::New(skill) => (skill.rule.name.as_str(), true),
        });
        let before = self.skills.iter().map(|skill| skill.rule.name.as_str());
        let moves = Moves::between(before, after);
        if let Active::Skill(active) = self.filter.active()
            && moves.to(active).is_none()
        {
            let name = self.skills[active].rule.name.as_str();
            let is_replaced =
                places.iter().any(|place| matches!(place, Place::New(new) if new.rule.name == name));
            let what = if is_replaced { "replaced" } else { "gone" };
            events.push(format!("skill {name} is {what} while it drives: stop"));
        }
        let news: Vec<bool> = places.iter().map(|place| matches!(place, Place::New(_))).collect();
        let mut places: Vec<Option<Skill>> = places
            .into_iter()
            .map(|place| match place {
                Place::Kept(_) => None,
                Place::New(skill) => Some(skill),
            })
            .collect();
        let before = std::mem::take(&mut self.skills).into_iter().map(Some).collect();
        let (skills, gone) = moves.carry(before, |place| places[place].take());
        self.skills = skills.into_iter().flatten().collect();

        let rules: Vec<_> = self.skills.iter().map(|skill| skill.rule.clone()).collect();
        let entry = |(is_new, rule)| RosterSkill { is_new, setup: SetupSkill::of(rule) };
        self.pending.roster = Some(news.into_iter().zip(&rules).map(entry).collect());
        self.pending.events.append(&mut events);
        self.decision.skills = rules.iter().map(unseen).collect();
        self.predictions = vec![Prediction::NONE; rules.len()];
        self.required = required(&self.skills);
        self.selector.adopt(rules, &moves);
        self.filter.adopt(&moves);
        self.overruns.adopt(&moves);
        self.handover.adopt(&moves);
        self.targets = moves.carry(std::mem::take(&mut self.targets), |_| None).0;
        if let Some(Active::Skill(driver)) = self.drives {
            let driver = moves.to(driver);
            self.drives = Some(driver.map_or(Active::Stand, Active::Skill));
            // The stand begins with what the next tick measures.
            self.is_orphaned |= driver.is_none();
        }
        self.share_time(deadlines);
        (gone.into_iter().flatten().collect(), starved)
    }

    /// The places without the new skills that need what observations have not held so far, and those.
    fn fed(&self, places: Vec<Place>, events: &mut Vec<String>) -> (Vec<Place>, Vec<Skill>) {
        let held = self.held.unwrap_or(self.required);
        let mut starved = Vec::new();
        let place = |place| match place {
            Place::New(skill) => {
                let lacking = required(std::slice::from_ref(&skill)).beyond(held);
                let name = skill.rule.name.clone();
                let Some(field) = lacking.fields().next() else {
                    events.push(format!("skill {name} takes part from now on"));
                    return Place::New(skill);
                };
                events.push(format!(
                    "skill {name} is not taken up: {field}: found nothing in the last observation, wanted it in every one"
                ));
                starved.push(skill);
                Place::Kept(name)
            }
            kept @ Place::Kept(_) => kept,
        };
        (places.into_iter().map(place).collect(), starved)
    }

    /// Other budgets from now on: those of all predictions together must fit into a tick however many there are.
    fn share_time(&mut self, deadlines: Option<Deadlines>) {
        let Some((supervision, deadlines)) = self.supervision.as_mut().zip(deadlines) else { return };
        supervision.deadlines = deadlines;
        let (act, predict) = (supervision.act(), supervision.predict());
        for skill in &mut self.skills {
            skill.controller.set_budget(act);
            skill.predictors.set_budget(predict);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decision_log::Setup;
    use crate::replay::as_recorded;
    use crate::runtime::fixture::{Fake, Loop, fake, skill};
    use crate::selector::Reason;

    fn roster(places: Vec<Place>) -> Roster {
        Roster { places, events: vec!["changed".into()], deadlines: None }
    }

    fn kept(name: &str) -> Place {
        Place::Kept(name.into())
    }

    #[test]
    fn a_skill_that_comes_takes_part_and_the_active_one_is_not_disturbed() {
        let walk = fake(0.99, 0.3);
        let mut it = Loop::new(vec![skill("walk", &walk), skill("ascend", &fake(0.99, 0.9))]);
        it.until("walk");
        let trot = fake(0.99, 0.2);
        let places = vec![Place::New(skill("trot", &trot)), kept("ascend"), kept("walk")];
        assert!(it.runtime.adopt(roster(places)).is_empty(), "nobody is gone");
        let decision = it.tick();
        assert_eq!((decision.active.as_str(), decision.choice.as_str()), ("walk", "trot"));
        let names: Vec<_> = decision.skills.iter().map(|skill| skill.name.as_str()).collect();
        assert_eq!(names, ["trot", "ascend", "walk"], "the deployment's order");
        assert_eq!(decision.events, ["changed", "skill trot takes part from now on"]);
        assert_eq!(decision.roster.as_ref().map(Vec::len), Some(3));
        assert_eq!(it.tick().roster, None, "said once");
        assert_eq!(it.until("trot"), 8);
        assert_eq!(walk.with(|script| script.resets), 1, "walk went on without a reset");
    }

    #[test]
    fn a_skill_that_needs_what_no_observation_holds_changes_nothing() {
        let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.3))]);
        it.until("walk");
        let starved = || {
            let mut starved = skill("walk", &fake(0.99, 0.1));
            starved.needs.joint_torques = true;
            Place::New(starved)
        };
        assert_eq!(it.runtime.adopt(roster(vec![starved()])).len(), 1, "it is handed back");
        let decision = it.tick();
        assert_eq!((decision.active.as_str(), decision.roster.is_some()), ("walk", false));
        assert!(decision.events.iter().any(|event| event.contains("joint_torque_nm: found nothing")));
        it.observation.joint_torque_nm = Some(vec![0.0; it.observation.joint_position_rad.len()]);
        it.tick();
        it.runtime.adopt(roster(vec![starved()]));
        let events =
            ["changed", "skill walk takes part from now on", "skill walk is replaced while it drives: stop"];
        assert_eq!(it.tick().events, events);
    }

    #[test]
    fn a_skill_that_comes_before_anything_is_measured_waits_for_what_the_first_observation_holds() {
        let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.3))]);
        let needy = |name: &str| {
            let mut needy = skill(name, &fake(0.99, 0.1));
            needy.needs.joint_torques = true;
            Place::New(needy)
        };
        let (rosters, changes) = std::sync::mpsc::sync_channel(1);
        let (follower, came_back) = Follower::of(changes);
        it.runtime = it.runtime.following(follower);
        rosters.send(roster(vec![kept("walk"), needy("trot")])).unwrap();
        let fault = crate::observation::ObservationFault::new("line", "nonsense", "JSON");
        assert_eq!(it.runtime.fault_tick(&fault).decision.skills.len(), 1);
        it.observation.joint_torque_nm = Some(vec![0.0; it.observation.joint_position_rad.len()]);
        assert_eq!(it.tick().skills.len(), 2);
        // What is not taken up goes back by its name, for the files to be news again.
        it.runtime.adopt(roster(vec![kept("walk")]));
        it.observation.joint_torque_nm = None;
        it.tick();
        rosters.send(roster(vec![kept("walk"), needy("amble")])).unwrap();
        assert_eq!(it.tick().skills.len(), 1);
        let starved: Vec<_> = came_back.try_iter().flat_map(|back| back.starved).collect();
        assert_eq!(starved.iter().map(|skill| skill.rule.name.as_str()).collect::<Vec<_>>(), ["amble"]);
    }

    #[test]
    fn an_active_skill_that_goes_ends_in_the_stand_and_another_takes_over() {
        let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.3)), skill("trot", &fake(0.99, 0.2))]);
        it.until("trot");
        let gone = it.runtime.adopt(roster(vec![kept("walk")]));
        assert_eq!(gone.len(), 1);
        let decision = it.tick();
        assert_eq!((decision.active.as_str(), decision.choice.as_str()), ("stand", "walk"));
        assert!(decision.events.contains(&"skill trot is gone while it drives: stop".to_owned()));
        assert!(it.runtime.filter.is_stopped());
        assert_eq!(it.until("walk"), 24, "the resume window");
    }

    #[test]
    fn the_stand_after_a_skill_that_goes_is_the_one_after_a_skill_that_fails() {
        let targets = |ends: fn(&Fake, &mut Loop)| {
            let walk = fake(0.99, 0.3);
            let mut it = Loop::new(vec![skill("walk", &walk)]);
            it.until("walk");
            it.observation.joint_position_rad.iter_mut().for_each(|angle| *angle += 0.2);
            ends(&walk, &mut it);
            assert_eq!(it.tick().active, "stand");
            it.runtime.joints.clone()
        };
        let failed = targets(|walk, _| walk.with(|script| script.fails = true));
        let gone = targets(|_, it| drop(it.runtime.adopt(roster(Vec::new()))));
        let replaced = targets(|_, it| {
            drop(it.runtime.adopt(roster(vec![Place::New(skill("walk", &fake(0.99, 0.3)))])));
        });
        assert_eq!((&failed, &failed), (&gone, &replaced), "it begins with what is measured");
    }

    #[test]
    fn a_skill_that_is_replaced_while_it_drives_is_not_called_gone() {
        let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.3))]);
        it.until("walk");
        it.runtime.adopt(roster(vec![Place::New(skill("walk", &fake(0.99, 0.3)))]));
        let events =
            ["changed", "skill walk takes part from now on", "skill walk is replaced while it drives: stop"];
        assert_eq!(it.tick().events, events);
    }

    #[test]
    fn faults_stay_with_who_goes_on_and_a_replacement_begins_anew() {
        let (bad, walk) = (fake(0.99, 0.1), fake(0.99, 0.3));
        let mut it = Loop::new(vec![skill("bad", &bad), skill("walk", &walk)]);
        bad.with(|script| script.fails = true);
        it.ticks(12);
        it.runtime.adopt(roster(vec![kept("walk"), kept("bad")]));
        assert_eq!(it.tick().skills[1].reason, Reason::PluginFailed);
        let good = fake(0.99, 0.1);
        it.runtime.adopt(roster(vec![kept("walk"), Place::New(skill("bad", &good))]));
        assert!(it.tick().skills[1].viable);
    }

    #[test]
    fn without_any_skill_left_it_stops() {
        let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.3))]);
        it.until("walk");
        it.runtime.adopt(roster(vec![kept("unknown")]));
        assert_eq!(it.ticks(30).choice, "stop");
        it.runtime.adopt(roster(vec![Place::New(skill("trot", &fake(0.99, 0.2)))]));
        assert_eq!(it.until("trot"), 25);
    }

    #[test]
    fn a_record_with_changes_of_skills_decides_itself_again() {
        let (walk, trot) = (fake(0.99, 0.3), fake(0.99, 0.2));
        let mut it = Loop::new(vec![skill("walk", &walk)]);
        let setup = Setup::of(&it.runtime, "stairs");
        let mut decisions = Vec::new();
        for tick in 0..120 {
            match tick {
                20 => drop(it.runtime.adopt(roster(vec![Place::New(skill("trot", &trot)), kept("walk")]))),
                60 => drop(it.runtime.adopt(roster(vec![kept("walk")]))),
                70 => drop(it.runtime.adopt(roster(vec![kept("walk"), Place::New(skill("walk_on", &trot))]))),
                100 => drop(it.runtime.adopt(roster(vec![Place::New(skill("walk", &walk))]))),
                _ => {}
            }
            decisions.push(it.tick());
        }
        let drivers: std::collections::BTreeSet<_> =
            decisions.iter().map(|tick| tick.active.clone()).collect();
        assert_eq!(drivers.len(), 4, "{drivers:?}");
        for (again, decision) in as_recorded(&setup, &decisions).iter().zip(&decisions) {
            assert!(again.agrees_with(decision), "tick {}: {again:?}, {decision:?}", decision.tick);
        }
    }
}
