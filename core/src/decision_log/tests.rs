use super::*;
use crate::replay::as_recorded;
use crate::runtime::fixture::{Loop, fake, skill};
use crate::runtime::{Place, Roster};
use crate::switch::Windows;

/// A loop that walks, ascends, falls, fails, stands and stops; every tick of it, and its runtime.
fn eventful() -> (Setup, Vec<Decision>) {
    let (walk, ascend) = (fake(0.99, 0.2), fake(0.93, 0.9));
    let mut it = Loop::new(vec![skill("walk", &walk), skill("ascend", &ascend)]);
    let setup = Setup::of(&it.runtime, "test");
    let mut decisions: Vec<_> = (0..20).map(|_| it.tick()).collect();
    walk.with(|script| script.prediction = Some((0.1, 0.2)));
    ascend.with(|script| script.prediction = Some((0.97, 0.9)));
    decisions.extend((0..20).map(|_| it.tick()));
    it.observation.joint_position_rad[3] = f32::NAN;
    decisions.push(it.tick());
    it.observation.joint_position_rad[3] = 0.0;
    decisions.extend((0..30).map(|_| it.tick()));
    it.observation.projected_gravity = [0.0, -1.0, 0.0];
    decisions.extend((0..3).map(|_| it.tick()));
    it.observation.projected_gravity = [0.0, 0.0, -1.0];
    decisions.extend((0..30).map(|_| it.tick()));
    ascend.with(|script| script.fails = true);
    decisions.extend((0..5).map(|_| it.tick()));
    walk.with(|script| script.prediction = Some((f32::NAN, 0.2)));
    decisions.extend((0..5).map(|_| it.tick()));
    (setup, decisions)
}

fn written(folder: &Path, setup: &Setup, decisions: &[Decision]) -> PathBuf {
    let file = folder.join("decisions.mcap");
    let mut log = LogWriter::create(&file, setup).unwrap();
    for decision in decisions {
        log.write(decision).unwrap();
    }
    log.finish().unwrap();
    file
}

#[test]
fn a_log_comes_back_as_it_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let (setup, decisions) = eventful();
    let log = DecisionLog::read(&written(folder.path(), &setup, &decisions)).unwrap();
    assert_eq!(log.setup, setup);
    assert_eq!(log.truncated, None);
    assert_eq!(log.decisions.len(), decisions.len());
    for (found, wanted) in log.decisions.iter().zip(&decisions) {
        assert!(found == wanted, "tick {}", wanted.tick);
    }
}

#[test]
fn a_log_decided_again_comes_to_the_same() {
    let (setup, decisions) = eventful();
    for skill in ["walk", "ascend", "stand"] {
        assert!(decisions.iter().any(|decision| decision.active == skill), "the fixture lacks {skill}");
    }
    for (again, decision) in as_recorded(&setup, &decisions).iter().zip(&decisions) {
        assert!(again.agrees_with(decision), "tick {}: {again:?}, {decision:?}", decision.tick);
    }
}

#[test]
fn a_log_of_skills_that_come_and_go_comes_back_and_one_that_hides_it_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.3))]);
    let setup = Setup::of(&it.runtime, "test");
    let mut decisions: Vec<_> = (0..20).map(|_| it.tick()).collect();
    for names in [&["trot", "walk"][..], &["walk"], &[]] {
        let place = |name: &&str| match *name {
            "trot" => Place::New(skill("trot", &fake(0.99, 0.2))),
            name => Place::Kept(name.to_owned()),
        };
        it.runtime.adopt(Roster {
            places: names.iter().map(place).collect(),
            events: Vec::new(),
            deadlines: None,
        });
        decisions.extend((0..20).map(|_| it.tick()));
    }
    let log = DecisionLog::read(&written(folder.path(), &setup, &decisions)).unwrap();
    assert!(log.decisions == decisions, "every tick comes back");
    decisions[40].roster = None;
    let error = DecisionLog::read(&written(folder.path(), &setup, &decisions)).unwrap_err().to_string();
    assert!(error.contains("found 1 skills at tick 40, wanted 2"), "{error}");
}

#[test]
fn a_log_of_a_skill_that_was_held_is_decided_again_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let walk = fake(0.99, 0.2);
    let mut held = skill("walk", &walk);
    held.rule.hold_threshold = 0.5;
    let mut it = Loop::new(vec![held]);
    let setup = Setup::of(&it.runtime, "test");
    let mut decisions: Vec<_> = (0..30).map(|_| it.tick()).collect();
    for viability in [0.6, 0.4, 0.6] {
        walk.with(|script| script.prediction = Some((viability, 0.2)));
        decisions.extend((0..30).map(|_| it.tick()));
    }
    let active = |tick: usize| decisions[tick].active.as_str();
    assert_eq!([active(29), active(59), active(89), active(119)], ["walk", "walk", "stand", "stand"]);
    let log = DecisionLog::read(&written(folder.path(), &setup, &decisions)).unwrap();
    assert_eq!(log.setup, setup);
    for (again, decision) in as_recorded(&log.setup, &log.decisions).iter().zip(&decisions) {
        assert!(again.agrees_with(decision), "tick {}: {again:?}, {decision:?}", decision.tick);
    }
}

#[test]
fn other_thresholds_and_windows_decide_otherwise() {
    let (setup, decisions) = eventful();
    let mut rules = setup.rules();
    rules[0].set_threshold(0.999);
    rules[1].set_threshold(0.9);
    let windows = Windows { switch: 3, ..setup.windows() };
    let again = crate::replay::replay(&rules, windows, &decisions, |decision, skill| {
        decision.skills[skill].prediction()
    });
    assert_eq!((again[1].active.as_str(), again[2].active.as_str()), ("stand", "ascend"));
}

#[test]
fn a_killed_writers_log_is_read_up_to_where_it_ends() {
    let folder = tempfile::tempdir().unwrap();
    let (setup, decisions) = eventful();
    let file = written(folder.path(), &setup, &decisions);
    let bytes = std::fs::read(&file).unwrap();
    for share in [0.6, 0.8, 0.95] {
        std::fs::write(&file, &bytes[..(bytes.len() as f64 * share) as usize]).unwrap();
        let log = DecisionLog::read(&file).unwrap();
        assert!(log.truncated.is_some(), "{share}");
        assert!(log.decisions[..] == decisions[..log.decisions.len()], "{share}");
    }
    let short = DecisionLog::read(&file).unwrap();
    assert!(short.decisions.len() >= 49, "whole seconds are kept: {}", short.decisions.len());
}

#[test]
fn a_file_that_is_no_log_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("notes.txt");
    assert!(matches!(DecisionLog::read(&file), Err(LogError::Io { .. })));
    for bytes in [&b""[..], b"hello", b"\x89MCAP0\r\n", &[0xff; 400]] {
        std::fs::write(&file, bytes).unwrap();
        let error = DecisionLog::read(&file).unwrap_err().to_string();
        assert!(error.contains("notes.txt: "), "{error}");
    }
}

/// A log of a run in which a skill was added could not be read: every tick was held to as many skills as the
/// setup has. The number follows the rosters now.
#[test]
fn a_log_in_which_a_skill_came_is_read_and_a_number_that_nobody_announced_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.3))]);
    let setup = Setup::of(&it.runtime, "test");
    let mut decisions: Vec<_> = (0..5).map(|_| it.tick()).collect();
    let places = vec![Place::Kept("walk".into()), Place::New(skill("trot", &fake(0.99, 0.2)))];
    drop(it.runtime.adopt(Roster { places, events: Vec::new(), deadlines: None }));
    decisions.extend((0..5).map(|_| it.tick()));
    let log = DecisionLog::read(&written(folder.path(), &setup, &decisions)).unwrap();
    assert!(log.decisions == decisions);
    decisions[7].skills.pop();
    let error = DecisionLog::read(&written(folder.path(), &setup, &decisions)).unwrap_err().to_string();
    assert!(error.contains("found 1 skills at tick 7, wanted 2"), "{error}");
}
