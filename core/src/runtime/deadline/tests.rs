use super::*;
use crate::decision::{Decision, Forced};
use crate::manifest::Deadlines;
use crate::replay::as_recorded;
use crate::runtime::fixture::{Fake, Gate, Loop, fake, skill};
use crate::runtime::{Place, Roster, Switching};
use crate::selector::Reason;

/// Long enough for a thread to answer on a busy machine.
const DEADLINES: Deadlines = Deadlines { act_s: 0.5, predict_s: 0.5 };

fn clock() -> Duration {
    #[expect(clippy::disallowed_methods, reason = "budgets are of the world's time")]
    static START: std::sync::LazyLock<std::time::Instant> = std::sync::LazyLock::new(std::time::Instant::now);
    START.elapsed()
}

fn walking(walk: &Fake, other: &Fake, pace: Pace) -> Loop {
    let mut it = Loop::new(vec![skill("walk", walk), skill("ascend", other)]);
    let supervision = Supervision { clock, deadlines: DEADLINES, pace };
    it.runtime = it.runtime.supervised(supervision).unwrap();
    assert_eq!(it.until("walk"), 10);
    it
}

fn faults(decision: &Decision) -> (&str, Option<Forced>, &str) {
    (decision.active.as_str(), decision.forced, decision.events.first().map_or("", String::as_str))
}

#[test]
fn a_call_that_hangs_stands_within_the_tick_and_is_out_after_three() {
    let (walk, gate) = (fake(0.99, 0.2), Gate::default());
    let mut it = walking(&walk, &fake(0.99, 0.9), Pace::Real);
    walk.with(|script| script.act_hangs = Some(gate.clone()));
    let began = clock();
    // Having stood, the skill is reset before it acts: that is what the second call waits to do.
    for call in ["act", "reset and act"] {
        let decision = it.tick();
        let late = format!("skill walk is late: {call}: found no answer, wanted one within 500.0 ms");
        assert_eq!(faults(&decision), ("stand", Some(Forced::Overrun), late.as_str()));
        assert!(it.stands_with_stand_gains() && !decision.stopped, "{call}");
        assert!(decision.skills[0].viable, "it may answer yet");
    }
    let third = it.tick();
    assert_eq!((third.active.as_str(), third.forced), ("stand", Some(Forced::Fault)));
    assert!(
        third.events[0].starts_with("skill walk is taken out of service: reset and act: found no answer")
    );
    assert_eq!(third.skills[0].reason, Reason::TooSlow);
    // The budget was waited for once: a call that hangs is not waited for again.
    let waited = clock().saturating_sub(began);
    assert!(waited < 2 * Duration::from_secs_f64(DEADLINES.act_s), "{waited:?}");
    assert_eq!(it.until("ascend"), 25, "the others go on");
    gate.open();
}

/// A quarter of a number of ticks: what else the machine does may hold up any of them.
#[test]
fn with_the_budgets_of_a_robot_a_tick_in_which_calls_hang_is_no_longer_than_a_period() {
    let hung = |_| {
        let (walk, other, gate) = (fake(0.99, 0.2), fake(0.99, 0.9), Gate::default());
        let mut it = walking(&walk, &other, Pace::Real);
        let places = ["walk", "ascend"].map(|name| Place::Kept(name.to_owned())).into();
        // What a deployment of two skills has that says nothing of deadlines.
        let deadlines = Some(Deadlines { act_s: 0.008, predict_s: 0.005 });
        it.runtime.adopt(Roster { places, events: Vec::new(), deadlines });
        walk.with(|script| script.act_hangs = Some(gate.clone()));
        other.with(|script| script.predict_hangs = Some(gate.clone()));
        time_of_a_late_tick(&mut it, &gate)
    };
    assert_some_are_within_a_period((0..21).map(hung).collect());
}

/// In a tick of the window the outgoing skill's plugin acts besides.
#[test]
fn with_mixing_a_tick_in_which_the_outgoing_skills_calls_hang_is_no_longer_than_a_period_either() {
    let hung = |_| {
        let (walk, other, gate) = (fake(0.99, 0.2), fake(0.99, 0.9), Gate::default());
        let mut it = Loop::new(vec![skill("walk", &walk), skill("ascend", &other)]);
        it.runtime = it.runtime.with_switching(Switching { ramp_s: 0.2, mixing: true });
        let supervision = Supervision { clock, deadlines: DEADLINES, pace: Pace::Real };
        it.runtime = it.runtime.supervised(supervision).unwrap();
        assert_eq!(it.until("walk"), 10);
        other.with(|script| script.prediction = Some((0.99, 0.1)));
        assert_eq!(it.until("ascend"), 10);
        let acts = walk.with(|script| script.acts);
        it.tick();
        assert_eq!(walk.with(|script| script.acts), acts + 1, "both act in the window");
        let places = ["walk", "ascend"].map(|name| Place::Kept(name.to_owned())).into();
        // What a deployment of two skills with mixing has that says nothing of deadlines.
        let deadlines = Some(Deadlines { act_s: 0.004, predict_s: 0.005 });
        it.runtime.adopt(Roster { places, events: Vec::new(), deadlines });
        walk.with(|script| {
            script.act_hangs = Some(gate.clone());
            script.predict_hangs = Some(gate.clone());
        });
        let began = clock();
        let decision = it.tick();
        let took = clock().saturating_sub(began);
        gate.open();
        assert!(decision.events.iter().any(|event| event.starts_with("skill walk is late")), "{decision:?}");
        took
    };
    assert_some_are_within_a_period((0..21).map(hung).collect());
}

fn time_of_a_late_tick(it: &mut Loop, gate: &Gate) -> Duration {
    let began = clock();
    let decision = it.tick();
    let took = clock().saturating_sub(began);
    gate.open();
    assert_eq!((decision.active.as_str(), decision.forced), ("stand", Some(Forced::Overrun)));
    took
}

fn assert_some_are_within_a_period(mut took: Vec<Duration>) {
    took.sort();
    assert!(took[took.len() / 4] < Duration::from_millis(20), "{took:?}");
}

#[test]
fn the_reset_and_the_first_call_share_one_budget() {
    let (walk, trot) = (fake(0.99, 0.9), fake(0.2, 0.2));
    let mut it = Loop::new(vec![skill("walk", &walk), skill("trot", &trot)]);
    let deadlines = Deadlines { act_s: 0.3, predict_s: 0.5 };
    it.runtime = it.runtime.supervised(Supervision { clock, deadlines, pace: Pace::Real }).unwrap();
    it.until("walk");
    let slow = || std::thread::sleep(Duration::from_millis(200));
    trot.with(|script| {
        script.prediction = Some((0.99, 0.2));
        script.reset = Some(slow);
        script.act = Some(|_| std::thread::sleep(Duration::from_millis(200)));
    });
    let decision = it.ticks(10);
    let late = "skill trot is late: reset and act: found no answer, wanted one within 300.0 ms";
    assert_eq!(faults(&decision), ("stand", Some(Forced::Overrun), late), "each alone is in time");
}

#[test]
fn skills_that_come_share_the_time_of_a_tick_with_those_that_are_there() {
    let (walk, gate) = (fake(0.99, 0.2), Gate::default());
    let mut it = walking(&walk, &fake(0.99, 0.9), Pace::Real);
    let kept = |name: &str| Place::Kept(name.to_owned());
    for places in [vec![kept("walk"), kept("ascend")], vec![kept("ascend"), kept("walk")]] {
        let predict_s = 0.1 + 0.1 * it.runtime.decision.tick as f64;
        let deadlines = Some(Deadlines { act_s: 0.5, predict_s });
        it.runtime.adopt(Roster { places, events: Vec::new(), deadlines });
        walk.with(|script| script.predict_hangs = Some(gate.clone()));
        let late = format!("wanted one within {:.1} ms", 1e3 * predict_s);
        let decision = it.tick();
        assert!(decision.events[0].ends_with(&late), "{late}: {:?}", decision.events);
    }
    gate.open();
}

#[test]
fn a_call_that_answers_late_once_is_reset_and_goes_on() {
    let (walk, gate) = (fake(0.99, 0.2), Gate::default());
    let mut it = walking(&walk, &fake(0.99, 0.9), Pace::Real);
    walk.with(|script| script.act_hangs = Some(gate.clone()));
    assert_eq!(it.tick().active, "stand");
    let (resets, acts) = walk.with(|script| (script.resets, script.acts));
    walk.with(|script| script.act_hangs = None);
    gate.open();
    let answered = (0..2000).any(|_| {
        std::thread::sleep(Duration::from_millis(1));
        walk.with(|script| script.acts) > acts
    });
    assert!(answered);
    std::thread::sleep(Duration::from_millis(50));
    let decision = it.tick();
    assert_eq!((decision.active.as_str(), decision.forced), ("walk", None));
    assert_eq!(walk.with(|script| script.resets), resets + 1, "the late answer is forgotten");
}

#[test]
fn a_prediction_that_hangs_stands_if_it_is_the_active_skills() {
    let (walk, gate) = (fake(0.99, 0.2), Gate::default());
    let mut it = walking(&walk, &fake(0.99, 0.9), Pace::Real);
    walk.with(|script| script.predict_hangs = Some(gate.clone()));
    let late = "skill walk is late: predict: found no answer, wanted one within 500.0 ms";
    assert_eq!(faults(&it.tick()), ("stand", Some(Forced::Overrun), late));
    assert_eq!(faults(&it.tick()), ("stand", Some(Forced::Overrun), late));
    let third = it.tick();
    assert_eq!((third.forced, third.skills[0].reason), (Some(Forced::Fault), Reason::TooSlow));
    assert_eq!(it.until("ascend"), 25);
    gate.open();
}

#[test]
fn a_prediction_that_hangs_costs_another_skill_nothing_but_its_own_place() {
    let (ascend, gate) = (fake(0.99, 0.9), Gate::default());
    let mut it = walking(&fake(0.99, 0.2), &ascend, Pace::Real);
    ascend.with(|script| script.predict_hangs = Some(gate.clone()));
    for tick in 0..5 {
        let decision = it.tick();
        assert_eq!(decision.active, "walk", "tick {tick}");
        assert_eq!(decision.skills[1].reason == Reason::TooSlow, tick >= 2, "tick {tick}");
    }
    gate.open();
}

#[test]
fn a_prediction_that_is_late_where_another_skill_takes_over_keeps_nobody_from_driving() {
    let (walk, ascend, gate) = (fake(0.99, 0.2), fake(0.99, 0.9), Gate::default());
    let mut it = walking(&walk, &ascend, Pace::Real);
    ascend.with(|script| script.prediction = Some((0.99, 0.1)));
    assert_eq!(it.ticks(9).active, "walk");
    walk.with(|script| script.predict_hangs = Some(gate.clone()));
    let decision = it.tick();
    assert_eq!((decision.active.as_str(), decision.forced), ("ascend", None), "{decision:?}");
    gate.open();
}

#[test]
fn a_log_of_late_calls_replays_as_it_was_decided() {
    let (walk, gate) = (fake(0.99, 0.2), Gate::default());
    let mut it = walking(&walk, &fake(0.99, 0.9), Pace::Real);
    let setup = crate::decision_log::Setup::of(&it.runtime, "test");
    it.runtime.restart();
    it.observation.t_s = 0.0;
    let mut decisions: Vec<Decision> = (0..15).map(|_| it.tick()).collect();
    for hangs in [Some(gate.clone()), None] {
        walk.with(|script| script.act_hangs.clone_from(&hangs));
        decisions.push(it.tick());
        gate.open();
        std::thread::sleep(Duration::from_millis(100));
    }
    let gate = Gate::default();
    walk.with(|script| script.predict_hangs = Some(gate.clone()));
    decisions.extend((0..40).map(|_| it.tick()));
    gate.open();
    assert_eq!(decisions.last().unwrap().active, "ascend");
    for (again, decision) in as_recorded(&setup, &decisions).iter().zip(&decisions) {
        assert!(again.agrees_with(decision), "tick {}: {again:?}, then {decision:?}", decision.tick);
    }
}

#[test]
fn in_simulated_time_a_slow_call_is_counted_and_changes_nothing() {
    let slow = |deadlines: Option<Deadlines>| {
        let walk = fake(0.99, 0.2);
        let mut it = Loop::new(vec![skill("walk", &walk)]);
        if let Some(deadlines) = deadlines {
            let supervision = Supervision { clock, deadlines, pace: Pace::Simulated };
            it.runtime = it.runtime.supervised(supervision).unwrap();
        }
        walk.with(|script| script.act = Some(|_| std::thread::sleep(Duration::from_millis(2))));
        let decisions: Vec<Decision> = (0..30).map(|_| it.tick()).collect();
        (decisions, it.runtime.times())
    };
    let (unwatched, none) = slow(None);
    let (watched, times) = slow(Some(Deadlines { act_s: 0.001, predict_s: 1.0 }));
    assert_eq!(unwatched, watched, "not even timings are part of the record");
    assert_eq!((none.ticks, none.overruns), (0, 0));
    assert_eq!((times.ticks, times.overruns), (30, 21));
    assert!(times.max_us >= 2000.0 && times.p50_us >= 2000.0, "{times}");
}

#[test]
fn in_real_time_a_tick_in_time_is_as_in_simulated_time_but_for_its_timings() {
    let run = |pace| {
        let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.2)), skill("ascend", &fake(0.99, 0.9))]);
        let supervision = Supervision { clock, deadlines: Deadlines { act_s: 20.0, predict_s: 20.0 }, pace };
        it.runtime = it.runtime.supervised(supervision).unwrap();
        let tick = |_| {
            let decision = it.tick();
            (decision, it.runtime.joints.clone())
        };
        (0..40).map(tick).collect::<Vec<_>>()
    };
    for ((simulated, targets), (mut real, same)) in run(Pace::Simulated).into_iter().zip(run(Pace::Real)) {
        assert!(simulated.timings.is_none() && real.timings.take().is_some());
        assert_eq!((simulated, targets), (real, same));
    }
}
