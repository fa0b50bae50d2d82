//! The demo, with what is shipped: the robot climbs and descends 12 cm steps, stops before those of
//! 40 cm, and does the same again for the same seed.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

fn demo(out: &Path, arguments: &[&str]) -> Value {
    let plugins = vocaloco_tests::plugin_folder();
    let output = Command::new(plugins.join("vocaloco"))
        .args(["demo", "--json", "--out"])
        .arg(out)
        .args(arguments)
        .env("VOCALOCO_ROOT", vocaloco_tests::repository())
        .env("VOCALOCO_PLUGIN_PATH", plugins)
        .output()
        .expect("the demo starts");
    let narration = String::from_utf8_lossy(&output.stderr);
    // 1 is a finding: an outcome that is not the expected one.
    assert!(matches!(output.status.code(), Some(0 | 1)), "ended with {:?}:\n{narration}", output.status);
    serde_json::from_slice(&output.stdout).expect("one JSON object on stdout and nothing else")
}

fn course<'a>(summary: &'a Value, name: &str, size_m: f64) -> &'a Value {
    let courses = summary["courses"].as_array().expect("courses");
    courses
        .iter()
        .find(|c| c["name"] == name && (c["size_m"].as_f64().unwrap_or(0.0) - size_m).abs() < 1e-6)
        .unwrap_or_else(|| panic!("no course {name} of {size_m} m in {summary}"))
}

fn actives(course: &Value) -> Vec<&str> {
    course["switches"].as_array().expect("switches").iter().filter_map(|s| s["to"].as_str()).collect()
}

#[test]
fn twelve_centimetres_are_reached_and_forty_are_stopped_before() {
    let out = tempfile::tempdir().expect("a temporary folder");
    let summary = demo(out.path(), &["--seed", "1"]);
    for name in ["stairs_up", "stairs_down"] {
        let course = course(&summary, name, 0.12);
        assert_eq!(course["outcome"], "reached", "{course}");
        assert_eq!(course["as_expected"], true, "{course}");
        let cot = course["cot"].as_f64().expect("a cost of transport");
        assert!((0.05..3.0).contains(&cot), "{name}: CoT {cot}");
    }
    let high = course(&summary, "stairs_up", 0.4);
    assert_eq!(high["outcome"], "stopped", "{high}");
    assert_eq!(high["as_expected"], true, "stopped after contact or a fault: {high}");
    let skills = actives(high).into_iter().filter(|skill| *skill != "stand").count();
    let distance_m = high["distance_m"].as_f64().expect("a distance");
    assert!(skills > 0 && distance_m >= 0.3, "it never walked up to the step: {high}");

    // On the lowest steps that need them, the skills made for stairs carry the robot between walks.
    for (name, skill) in [("stairs_up", "ascend_network"), ("stairs_down", "descend_network")] {
        let switched = summary["courses"]
            .as_array()
            .expect("courses")
            .iter()
            .any(|course| course["name"] == name && actives(course).contains(&skill));
        assert!(switched, "{skill} was never active on {name}: {summary}");
    }
    for file in ["report.html", "config.json", "decisions-stairs_up-0.12.mcap"] {
        let length = std::fs::metadata(out.path().join(file)).map_or(0, |file| file.len());
        assert!(length > 500, "{file} holds {length} bytes");
    }
    let page = std::fs::metadata(out.path().join("report.html")).map_or(0, |file| file.len());
    assert!(page < 4_000_000, "the page holds {page} bytes");
}

#[test]
fn the_same_seed_drives_the_same_courses() {
    let folders = [tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder")];
    let [first, second] = folders.each_ref().map(|folder| demo(folder.path(), &["--seed", "3"]));
    assert_eq!(first["courses"], second["courses"]);
    let pages = folders.map(|folder| std::fs::read(folder.path().join("report.html")).expect("a page"));
    assert!(pages[0] == pages[1], "the pages differ");
}
