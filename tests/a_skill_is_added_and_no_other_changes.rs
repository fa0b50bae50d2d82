//! Adding a skill is new files and one line in a deployment: no file of another skill changes, and while it is
//! not viable every decision is, bit for bit, what it was without it.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use vocaloco_core::decision_log::DecisionLog;
use vocaloco_core::lock::sha256_hex;
use vocaloco_tests::{Fixture, constant_model, plugin_folder, repository, snapshot};

const DEPLOYMENT: &str = "manifests/deployments/anymal_stairs.toml";
const OLD: [&str; 3] = ["walk", "ascend_network", "descend_network"];
/// Courses with their steps, m: each of the old skills drives on one of them.
const COURSES: [[&str; 2]; 2] = [["stairs_up", "0.18"], ["stairs_down", "0.22"]];

/// The shipped deployment in an installation of its own.
fn installation() -> Fixture {
    let fixture = Fixture::new();
    fixture.add_shipped(&OLD);
    fixture.write(DEPLOYMENT, &fs::read(repository().join(DEPLOYMENT)).expect("the shipped deployment"));
    fixture
}

/// Hashes of the plugins' libraries and of the program.
fn binaries() -> BTreeMap<PathBuf, String> {
    let names = ["gait", "onnx"].map(vocaloco_core::plugin::library_file_name);
    let program = format!("vocaloco{}", std::env::consts::EXE_SUFFIX);
    let paths = names.iter().map(PathBuf::from).chain([PathBuf::from(program)]);
    paths
        .map(|path| (path.clone(), sha256_hex(&fs::read(plugin_folder().join(path)).expect("built"))))
        .collect()
}

/// One drive over a course: its report, but for times and the command, and the log's file.
fn drive(fixture: &Fixture, [course, size_m]: [&str; 2]) -> (Value, PathBuf) {
    let log = fixture.root().join(format!("out/{course}.mcap"));
    fs::create_dir_all(fixture.root().join("out")).expect("a folder");
    let words =
        ["run", "--source", "sim", "--course", course, "--size-m", size_m, "--steps", "2", "--json", "--log"];
    let output = fixture.vocaloco(&words).arg(&log).output().expect("vocaloco runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut report: Value = serde_json::from_slice(&output.stdout).expect("JSON alone on stdout");
    for of_the_moment in ["timing", "command"] {
        report.as_object_mut().expect("an object").remove(of_the_moment);
    }
    (report, log)
}

/// Every decision of a log as it is written, without what it says of the skills `added`.
fn decisions(log: &Path, added: &[&str]) -> Vec<String> {
    let log = DecisionLog::read(log).expect("a log");
    assert!(log.truncated.is_none());
    let told = |mut decision: vocaloco_core::decision::Decision| {
        decision.skills.retain(|skill| !added.contains(&skill.name.as_str()));
        // Numbers are written so that other bits are another text.
        serde_json::to_string(&decision).expect("a decision")
    };
    log.decisions.into_iter().map(told).collect()
}

/// Adds skills to an installation that drives, and holds it to what it was before.
fn nothing_else_changes(added: &[&str], add: impl FnOnce(&Fixture)) {
    let fixture = installation();
    let before: Vec<_> = COURSES
        .iter()
        .map(|course| {
            let (report, log) = drive(&fixture, *course);
            (report, decisions(&log, added))
        })
        .collect();
    fs::remove_dir_all(fixture.root().join("out")).expect("removed");
    let files = snapshot(fixture.root());
    let built = binaries();

    // The whole addition. Their predictors say that they are never viable, and for nothing.
    add(&fixture);
    for name in added {
        fixture.write(&format!("skills/{name}/viability.onnx"), &constant_model("viability", 0.0));
        fixture.write(&format!("skills/{name}/cot.onnx"), &constant_model("cot", 0.01));
    }
    let names = added.join("\", \"");
    fixture.alter(DEPLOYMENT, "skills = [", &format!("skills = [\"{names}\", "));

    let after = snapshot(fixture.root());
    let changed: Vec<_> = files.iter().filter(|(path, bytes)| after.get(*path) != Some(*bytes)).collect();
    assert_eq!(changed.len(), 1, "the deployment alone: {changed:?}");
    assert!(changed[0].0.ends_with(DEPLOYMENT), "{changed:?}");
    let text = |files: &BTreeMap<PathBuf, Option<Vec<u8>>>| {
        let bytes = files[&fixture.root().join(DEPLOYMENT)].clone().expect("a file");
        String::from_utf8(bytes).expect("text")
    };
    let (old, new) = (text(&files), text(&after));
    assert_eq!(old.lines().count(), new.lines().count());
    assert_eq!(old.lines().zip(new.lines()).filter(|(old, new)| old != new).count(), 1, "one line: {new}");
    let of_them = |path: &Path| {
        let mut parts = path.iter().map(|part| part.to_string_lossy());
        parts.any(|part| added.iter().any(|name| part.split('.').next() == Some(*name)))
    };
    let strange: Vec<_> = after.keys().filter(|path| !files.contains_key(*path) && !of_them(path)).collect();
    assert!(strange.is_empty(), "new files of the skills alone: {strange:?}");
    assert_eq!(built, binaries(), "no plugin and no program is another one");

    for (course, (report, decided)) in COURSES.iter().zip(&before) {
        let (now, log) = drive(&fixture, *course);
        let [course, _] = course;
        let setup = DecisionLog::read(&log).expect("a log").setup;
        for name in added {
            assert!(setup.skills.iter().any(|skill| skill.name == *name), "{name} took part");
        }
        assert_eq!(now, *report, "{course}: outcome, time, distance, cost and switches");
        let again = decisions(&log, added);
        for (tick, (again, then)) in again.iter().zip(decided).enumerate() {
            assert!(again == then, "{course}, tick {tick}:\n{then}\n{again}");
        }
        assert_eq!(again.len(), decided.len(), "{course}");
        let drivers = decided.iter().filter_map(|text| serde_json::from_str::<Value>(text).ok());
        let drivers: std::collections::BTreeSet<String> =
            drivers.map(|it| it["active"].to_string()).collect();
        assert!(drivers.len() > 2, "{course}: skills changed while it drove: {drivers:?}");
    }

    // The comparison can fail: viable and cheapest, the first drives.
    fixture.write(&format!("skills/{}/viability.onnx", added[0]), &constant_model("viability", 1.0));
    let (_, log) = drive(&fixture, COURSES[0]);
    assert_ne!(decisions(&log, added), before[0].1);
}

#[test]
fn no_file_of_another_skill_changes_and_no_decision_does_until_it_is_viable() {
    nothing_else_changes(&["stroll"], |fixture| {
        let policy = repository().join("skills/walk_network/policy.onnx");
        let output =
            fixture.vocaloco(&["skills", "new", "stroll", "--from"]).arg(policy).output().expect("it runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    });
}

/// Skills that go to targets and commit themselves, as they are shipped.
#[test]
fn climb_and_gap_are_added_to_what_they_never_touch() {
    nothing_else_changes(&["climb", "gap"], |fixture| fixture.add_shipped(&["climb", "gap"]));
}
