//! A decisions log in another language: Python's `mcap` gives every field back as it was written, and the
//! schemas beside the messages name each of them, so that Foxglove can plot them. A peer test.

use std::path::Path;
use std::process::Command;

use serde_json::Value;
use vocaloco_core::decision::{Decision, Forced, RosterSkill, SkillVerdict, Timings};
use vocaloco_core::decision_log::{LogWriter, SCHEMA, Setup, SetupSkill};
use vocaloco_core::heightfield::{CELLS, Field};
use vocaloco_core::selector::Reason;

fn skill(name: &str, viability_threshold: f32) -> SetupSkill {
    SetupSkill {
        name: name.to_owned(),
        viability_threshold,
        hold_threshold: None,
        cost_margin: 0.1,
        position_target: false,
        forward_m_per_s: [0.4, 0.7],
    }
}

fn setup() -> Setup {
    Setup {
        schema: SCHEMA,
        version: "1.2.3".to_owned(),
        deployment: "stairs".to_owned(),
        robot: "quadruped".to_owned(),
        backend: "tract 0.21".to_owned(),
        rate_hz: 50.0,
        switch_window: 10,
        stop_window: 8,
        resume_window: 25,
        skills: vec![skill("trot", 0.95), skill("climb", 0.925)],
    }
}

/// Two ticks that between them fill every field.
fn decisions() -> Vec<Decision> {
    let cells: Vec<f32> = (0..CELLS).map(|cell| cell as f32 * 0.003 - 0.5).collect();
    let verdict = |name: &str, viability, cot, viable, reason| SkillVerdict {
        name: name.to_owned(),
        viability,
        cot,
        strangeness: viability.map(|viability: f32| 1.5 - viability),
        viable,
        reason,
    };
    let whole = Decision {
        t_s: 0.3,
        tick: 15,
        command: [0.6, -0.1, 0.25],
        heightfield_hash: "00ff".to_owned(),
        field: Field::from_slice(&cells),
        skills: vec![
            verdict("trot", Some(0.5), Some(0.21), false, Reason::BelowThreshold { threshold: 0.95 }),
            verdict("climb", Some(0.99), Some(0.47), true, Reason::Viable { threshold: 0.925 }),
        ],
        choice: "climb".to_owned(),
        active: "trot".to_owned(),
        stopped: false,
        forced: None,
        committed: true,
        reason: "the only viable skill; 3 of 10 ticks in a row, trot goes on".to_owned(),
        events: vec!["a line with \"quotes\" and → arrows".to_owned()],
        timings: Some(Timings { predict_us: 61.5, act_us: 12.0, total_us: 80.25 }),
        roster: Some(vec![
            RosterSkill { is_new: false, setup: skill("trot", 0.95) },
            RosterSkill { is_new: true, setup: skill("climb", 0.925) },
        ]),
    };
    let blind = Decision {
        t_s: 0.32,
        tick: 16,
        field: None,
        heightfield_hash: String::new(),
        skills: vec![
            verdict("trot", None, None, false, Reason::NoTerrain),
            verdict("climb", None, None, false, Reason::PluginFailed),
        ],
        choice: "stop".to_owned(),
        active: "stand".to_owned(),
        stopped: true,
        forced: Some(Forced::Terrain),
        committed: false,
        timings: None,
        roster: None,
        ..whole.clone()
    };
    vec![whole, blind]
}

fn in_python(log: &Path) -> Vec<Value> {
    let script = vocaloco_tests::repository().join("tests/peers/decisions_in_mcap.py");
    let output = Command::new("python3").arg(script).arg(log).output().expect("python3 is installed");
    let narration = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "python3 with mcap: {narration}");
    serde_json::from_slice(&output.stdout).expect("a list of messages")
}

/// Every field of a message is in its schema, at every depth.
fn named(schema: &Value, message: &Value, at: &str) {
    match message {
        Value::Object(fields) => {
            for (name, value) in fields {
                // A reason's numbers differ from code to code.
                if at.ends_with(".reason") && name != "code" {
                    continue;
                }
                let property = &schema["properties"][name];
                assert!(property.is_object(), "{at}.{name} is not in the schema");
                named(property, value, &format!("{at}.{name}"));
            }
        }
        Value::Array(items) => items.iter().for_each(|item| named(&schema["items"], item, at)),
        _ => {}
    }
}

#[test]
fn python_gets_every_field_back_and_every_schema_names_them() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("decisions.mcap");
    let (setup, decisions) = (setup(), decisions());
    let mut log = LogWriter::create(&file, &setup).expect("the log is created");
    for decision in &decisions {
        log.write(decision).expect("a tick is written");
    }
    log.finish().expect("the log is closed");

    let messages = in_python(&file);
    assert_eq!(messages.len(), 1 + decisions.len());
    let written = std::iter::once(serde_json::to_string(&setup))
        .chain(decisions.iter().map(serde_json::to_string))
        .map(|text| text.expect("it serialises"));
    for (message, written) in messages.iter().zip(written) {
        let topic = message["topic"].as_str().expect("a topic");
        // Through text on both sides, so that f32 and f64 are compared as they are read.
        let again: Value = serde_json::from_str(&written).expect("JSON");
        assert_eq!(message["message"], again, "{topic}");
        assert_eq!(message["encoding"], "json", "{topic}");
        assert_eq!(message["schema_encoding"], "jsonschema", "{topic}");
        named(&message["schema"], &message["message"], topic);
    }
    assert_eq!(messages[0]["topic"], "/vocaloco/setup");
    assert_eq!(messages[1]["schema_name"], "vocaloco.Decision");
    assert_eq!(messages[1]["log_time"], 300_000_000_u64, "nanoseconds");
}
