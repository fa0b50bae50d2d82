//! Skills that look cheapest and are broken, among sound ones: one hangs, one ends its process, the model of one is
//! of NaN, and that of another answers no number wherever the ground is not flat. The robot still reaches the end of its course with the skills that are left, and the log says what
//! became of the others.

use std::process::Command;

use serde_json::Value;
use vocaloco_tests::{Fixture, constant_model, overflowing_model, plugin_folder};

/// Those that are broken, what their plugin does and their predicted cost: each is tried before any sound one.
const BROKEN: [(&str, &str, f32); 4] = [
    ("hanging", "hang", 0.01),
    ("crashing", "segfault", 0.02),
    ("dreaming", "none", 0.03),
    ("overflowing", "none", 0.04),
];
/// The shipped deployment's skills.
const SOUND: [&str; 3] = ["walk", "ascend_network", "descend_network"];

/// The shipped deployment with the broken skills before it; those in `isolated` have a process of their own.
fn fixture(isolated: &[&str]) -> Fixture {
    let fixture = Fixture::new();
    fixture.add_shipped(&SOUND);
    for (name, fault, cot) in BROKEN {
        fixture.add_skill(name, fault, 0.99, cot);
    }
    fixture.write("skills/dreaming/viability.onnx", &constant_model("viability", f32::NAN));
    fixture.write("skills/overflowing/viability.onnx", &overflowing_model("viability", 0.99));
    for skill in isolated {
        let manifest = format!("manifests/skills/{skill}.toml");
        fixture.alter(&manifest, "plugin =", "isolation = \"process\"\nplugin =");
    }
    let names: Vec<&str> = BROKEN.iter().map(|(name, ..)| *name).chain(SOUND).collect();
    fixture.add_deployment("broken", &names);
    fixture
}

fn run(fixture: &Fixture, arguments: &[&str]) -> Value {
    let output = Command::new(plugin_folder().join("vocaloco"))
        .args(arguments)
        .env("VOCALOCO_ROOT", fixture.root())
        .env("VOCALOCO_PLUGIN_PATH", plugin_folder())
        .output()
        .expect("the program starts");
    let narration = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code().is_some_and(|code| code < 2), "{narration}");
    serde_json::from_slice(&output.stdout).expect("one JSON object on stdout and nothing else")
}

/// The report of the course of 12 cm, and all events of its log.
fn climb(fixture: &Fixture, more: &[&str]) -> (Value, String) {
    let log = fixture.root().join("decisions.mcap");
    let log = log.to_str().expect("UTF-8");
    let course =
        ["run", "--deployment", "broken", "--source", "sim", "--size-m", "0.12", "--log", log, "--json"];
    let report = run(fixture, &[&course[..], more].concat());
    let explained = run(fixture, &["explain", log, "--json"]);
    (report, explained["events"].to_string())
}

/// The model of NaN is refused at load, and nobody who is broken ever drives.
fn assert_broken_do_not_drive(report: &Value) {
    let refused: Vec<_> =
        report["refused"].as_array().expect("refusals").iter().map(Value::to_string).collect();
    let [nan] = refused.as_slice() else { panic!("one is refused at load: {refused:?}") };
    assert!(nan.contains("dreaming") && nan.contains("a weight that is not a number"), "{nan}");
    let drivers: Vec<&str> =
        report["switches"].as_array().expect("switches").iter().filter_map(|it| it["to"].as_str()).collect();
    for (name, ..) in BROKEN {
        assert!(!drivers.contains(&name), "{name} has driven: {drivers:?}");
    }
}

#[test]
fn with_broken_skills_before_them_the_shipped_ones_climb_twelve_centimetres() {
    let fixture = fixture(&["hanging", "crashing"]);
    let (report, events) = climb(&fixture, &[]);
    assert_eq!(report["outcome"], "reached", "{report:#}");
    let out = "is taken out of service: ";
    for wanted in [
        format!("skill hanging {out}act: found no answer for 2 s"),
        format!("skill crashing {out}act: found its process ended by signal 11"),
        "skills/overflowing/viability.onnx: viability: found ".to_owned(),
    ] {
        assert!(events.contains(&wanted), "{wanted:?} is not in {events}");
    }
    assert_broken_do_not_drive(&report);
    assert_positive_overruns(&report["timing"]);
}

/// The demonstration itself, all of its courses. That a skill failed on the way to the stop is a finding: exit code 1.
#[test]
fn with_broken_skills_before_them_the_demonstration_ends_as_it_should() {
    let fixture = fixture(&["hanging", "crashing"]);
    let out = fixture.root().join("demo");
    let out = out.to_str().expect("UTF-8");
    let report = run(&fixture, &["demo", "--deployment", "broken", "--out", out, "--json"]);
    let courses = report["courses"].as_array().expect("courses");
    // Up and down 12 cm, the lowest steps that walk does not take, and before 40 cm.
    assert!(courses.len() >= 3, "{report:#}");
    for course in courses {
        assert_eq!(course["outcome"], course["expected"], "{course:#}");
    }
    for timing in report["timing"].as_array().expect("of each course") {
        assert_positive_overruns(timing);
    }
    assert_eq!([&courses[0], &courses[1]].map(|course| &course["outcome"]), ["reached"; 2], "{report:#}");
    assert_eq!(courses.last().expect("a course")["outcome"], "stopped", "{report:#}");
}

/// A hang was waited for, and is counted.
fn assert_positive_overruns(timing: &Value) {
    assert!(timing["overruns"].as_u64().is_some_and(|count| count >= 1), "{timing:#}");
}

/// In real time the hanging skill is in the loop's own process, where nothing can end it. In every attempt it is late
/// and never drives, and half of the ticks are shorter than a period. That the course is reached takes a
/// machine that leaves the sound skills their time: where it is so busy that one of them is late, the robot stands, and
/// the course is driven again, three times at most. `chrt -f 5` before the test's program keeps other work from that.
#[test]
fn in_real_time_a_skill_that_hangs_in_the_loops_own_process_is_passed_over_too() {
    let fixture = fixture(&["crashing"]);
    // Of 18 ms: one call that hangs and seven predictions that do.
    let budgets = "\n[deadlines]\nact_s = 0.008\npredict_s = 0.0014\n";
    let deployment = "manifests/deployments/broken.toml";
    let text = std::fs::read_to_string(fixture.root().join(deployment)).expect("a deployment");
    fixture.write(deployment, format!("{text}{budgets}").as_bytes());
    for _ in 0..3 {
        let (report, events) = climb(&fixture, &["--real-time"]);
        eprintln!("{}: {}", report["outcome"], report["timing"]);
        assert_broken_do_not_drive(&report);
        // Its predictions may be late before it is ever asked to act.
        assert!(events.contains("skill hanging is late: "), "{events}");
        assert!(
            report["timing"]["p50_us"].as_f64().is_some_and(|us| us < 20_000.0),
            "{:#}",
            report["timing"]
        );
        if SOUND.iter().any(|name| events.contains(&format!("skill {name} is "))) {
            eprintln!("a sound skill was late: {events}");
            continue;
        }
        assert_eq!(report["outcome"], "reached", "{report:#}");
        for skill in ["hanging", "crashing"] {
            let out = format!("skill {skill} is taken out of service: ");
            assert!(events.contains(&out), "{skill}: {events}");
        }
        return;
    }
}
