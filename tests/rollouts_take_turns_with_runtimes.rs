//! A runtime that has driven a course drives the next one as a fresh one would: rollouts may take turns.

use std::sync::Arc;

use vocaloco_core::{registry::load_deployment, runtime::Runtime};
use vocaloco_sim::course::{CourseConfig, Runtimes, Selector, roll_out};
use vocaloco_sim::terrain::CourseKind;

#[test]
fn a_runtime_used_again_decides_as_a_fresh_one() {
    let installation = vocaloco_tests::shipped();
    let load = || load_deployment(&installation, "anymal_stairs").expect("the deployment loads");
    let robot = Arc::clone(&load().robot);
    let runtimes = || Runtimes::new("vocaloco", || Ok(Runtime::new(load())?.into()));
    let drive = |runtimes: &Runtimes<'_>, kind, size_m| {
        let config = CourseConfig { recorded: true, ..CourseConfig::demo(kind, size_m, 3) };
        roll_out(&robot, &config, &Selector::Runtime(runtimes)).expect("the course is driven")
    };
    let (used, fresh) = (runtimes(), runtimes());
    // It ends in the middle of something: down stairs, or stopped.
    drive(&used, CourseKind::StairsUp, 0.4);
    let [again, first] = [&used, &fresh].map(|runtimes| drive(runtimes, CourseKind::StairsDown, 0.12));
    assert_eq!(again.outcome, first.outcome);
    for (again, first) in again.ticks.iter().zip(&first.ticks) {
        let [again, first] = [again, first].map(|tick| tick.decision.as_ref().expect("a decision"));
        assert_eq!(again, first, "tick {}", first.tick);
    }
    assert_eq!(again.ticks.len(), first.ticks.len());
}
