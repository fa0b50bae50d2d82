use serde_json::{Value, json};

use super::*;
use crate::runtime::fixture::{Loop, fake, robot, skill};

/// A sound line at `t_s`, over terrain that rises to the front and to the left.
fn line(t_s: f64) -> Value {
    let robot = robot();
    let by_joint = |value: &dyn Fn(usize) -> f64| {
        let entries = robot.description.joints.iter().enumerate();
        Value::Object(entries.map(|(index, joint)| (joint.name.to_string(), json!(value(index)))).collect())
    };
    let rows: Vec<Vec<f64>> = (0..31)
        .map(|i| (0..11).map(|j| 0.02 * f64::from(i) - 0.005 * f64::from(j) - 0.55).collect())
        .collect();
    json!({
        "t_s": t_s,
        "joint_position_rad": by_joint(&|index| robot.description.joints[index].stand_rad),
        "joint_velocity_rad_per_s": by_joint(&|index| 0.01 * index as f64),
        "base_linear_velocity_m_per_s": [0.1, 0.2, 0.3],
        "base_angular_velocity_rad_per_s": [0.4, 0.5, 0.6],
        "projected_gravity": [0.0, 0.0, -1.0],
        "foot_contact": {"LF_FOOT": true, "RF_FOOT": false, "LH_FOOT": true, "RH_FOOT": true},
        "elevation": {"t_s": t_s, "resolution_m": 0.1, "back_m": 1.0, "front_m": 2.0, "half_width_m": 0.5,
                      "height_m": rows},
        "command": {"velocity": [0.6, 0.0, 0.1]},
    })
}

/// Lines, errors, and whether a log gave up.
fn sums(served: &Served) -> (u64, u64, bool) {
    (served.lines, served.errors, served.unseen)
}

/// Answers to `lines`, the greeting left out, and what the session came to.
fn answers(lines: &[String]) -> (Vec<Value>, Served) {
    let mut runtime =
        Loop::new(vec![skill("walk", &fake(0.99, 0.2)), skill("ascend", &fake(0.5, 0.9))]).runtime;
    let greeting = Greeting::of(&runtime, "test", vec![]);
    let mut out = Vec::new();
    let text = lines.join("\n");
    let served =
        serve(&mut runtime, &greeting, text.as_bytes(), &mut out, |_| ControlFlow::Continue(())).unwrap();
    let mut values: Vec<Value> =
        String::from_utf8(out).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let greeting = values.remove(0);
    assert_eq!((greeting["robot"].as_str(), greeting["rate_hz"].as_f64()), (Some("anymal_d"), Some(50.0)));
    assert_eq!(greeting["skills"], json!(["walk", "ascend"]));
    assert_eq!(greeting["required"], json!(["foot_contact"]));
    assert_eq!(greeting["joints"][0], "LF_HAA");
    assert!(["tract", "onnxruntime"].contains(&greeting["backend"].as_str().unwrap()));
    (values, served)
}

/// The error that `spoil` provokes, as field, found, wanted; a sound line before and after it.
fn error(spoil: impl FnOnce(&mut Value)) -> (String, String, String) {
    let mut spoiled = line(0.04);
    spoil(&mut spoiled);
    raw_error(spoiled.to_string())
}

fn raw_error(spoiled: String) -> (String, String, String) {
    let (values, served) = answers(&[line(0.02).to_string(), spoiled, line(0.06).to_string()]);
    assert_eq!(sums(&served), (3, 1, false));
    assert!(values[0].get("error").is_none() && values[2].get("error").is_none(), "{values:?}");
    let error = &values[1]["error"];
    let stiffness = values[1]["joints"]["RH_KFE"]["stiffness_nm_per_rad"].as_f64().unwrap();
    assert!(stiffness as f32 >= robot().stand.stiffness_nm_per_rad, "the stand's joints");
    let text = |key: &str| error[key].as_str().unwrap().to_owned();
    (text("field"), text("found"), text("wanted"))
}

#[test]
fn a_line_in_gives_a_line_out_with_the_decision_and_every_joint() {
    let lines: Vec<_> = (1..=12).map(|tick| line(0.02 * f64::from(tick)).to_string()).collect();
    let (values, served) = answers(&lines);
    assert_eq!((values.len(), sums(&served)), (12, (12, 0, false)));
    assert_eq!((&values[8]["active"], &values[9]["active"]), (&json!("stand"), &json!("walk")));
    let last = &values[11];
    assert_eq!(last["t_s"], 0.24);
    assert_eq!(last["choice"], "walk");
    assert_eq!(last["skills"]["walk"]["viability"].as_f64().map(|v| v as f32), Some(0.99));
    assert_eq!(last["skills"]["ascend"]["viable"], false);
    assert_eq!(last["skills"]["ascend"]["reason"], "viability below 0.95");
    assert_eq!(last["reason"], "the only viable skill");
    assert_eq!(last["joints"].as_object().unwrap().len(), 12);
    assert_eq!(last["joints"]["LH_HFE"]["stiffness_nm_per_rad"], 77.0);
}

#[test]
fn joints_are_taken_by_name_whatever_their_order() {
    let robot = robot();
    let observation = parse(line(0.5).to_string().as_bytes(), &robot.description).unwrap();
    // serde_json sorts the names, so the text's order is not the robot's.
    for (index, joint) in robot.description.joints.iter().enumerate() {
        assert_eq!(
            observation.joint_velocity_rad_per_s[index],
            (0.01 * index as f64) as f32,
            "{}",
            joint.name
        );
    }
    assert_eq!(observation.foot_contact, Some(vec![true, false, true, true]));
    assert_eq!(observation.base_angular_velocity, [0.4, 0.5, 0.6]);
    let field = observation.elevation.unwrap().heightfield().unwrap();
    assert!((field.cells_m[30][0] - 0.05).abs() < 1e-6 && (field.cells_m[0][10] + 0.6).abs() < 1e-6);
}

#[test]
fn a_missing_joint_is_named() {
    let (field, found, _) = error(|line| {
        line["joint_position_rad"].as_object_mut().unwrap().remove("RH_HFE");
    });
    assert_eq!((field.as_str(), found.as_str()), ("joint_position_rad.RH_HFE", "nothing"));
}

#[test]
fn an_unknown_joint_or_field_is_named() {
    assert_eq!(error(|line| line["joint_torque_nm"] = json!({"LF_XYZ": 1.0})).0, "joint_torque_nm.LF_HAA");
    assert_eq!(error(|line| line["foot_contact"]["NOSE"] = json!(true)).0, "foot_contact.NOSE");
    assert_eq!(error(|line| line["speed"] = json!(1.0)).0, "speed");
    assert_eq!(error(|line| line["elevation"]["datum"] = json!(1.0)).0, "elevation.datum");
    assert_eq!(error(|line| line["command"]["gait"] = json!(1.0)).0, "command.gait");
}

#[test]
fn values_that_are_no_finite_numbers_are_named() {
    assert_eq!(error(|line| line["joint_velocity_rad_per_s"]["LF_KFE"] = json!("fast")).1, "\"fast\"");
    assert_eq!(error(|line| line["joint_velocity_rad_per_s"]["LF_KFE"] = json!(null)).1, "null");
    assert_eq!(error(|line| line["projected_gravity"][2] = json!(1e300)).0, "projected_gravity[2]");
    assert_eq!(error(|line| line["projected_gravity"] = json!([0, 0])).2, "an array of 3 numbers");
    assert_eq!(error(|line| line["foot_contact"]["LF_FOOT"] = json!(1)).2, "true or false");
    assert_eq!(error(|line| line["elevation"]["height_m"][3][2] = json!("x")).0, "elevation.height_m[3][2]");
    assert_eq!(error(|line| drop(line.as_object_mut().unwrap().remove("command"))).0, "command");
}

#[test]
fn values_of_another_unit_are_named() {
    let degrees = error(|line| line["joint_position_rad"]["LF_KFE"] = json!(-45.8));
    let fast = error(|line| line["joint_velocity_rad_per_s"]["LF_KFE"] = json!(-172.0));
    assert_eq!((fast.0.as_str(), fast.2.as_str()), ("joint_velocity_rad_per_s.LF_KFE", "-85 to 85 rad/s"));
    let [field, found, wanted] =
        ["joint_position_rad.LF_KFE", "-45.8", "-3.60 to 0.90 rad"].map(str::to_owned);
    assert_eq!(degrees, (field, found, wanted));
    let (field, found, wanted) = error(|line| line["projected_gravity"] = json!([0.0, 0.2, -9.8]));
    assert_eq!((field.as_str(), found.as_str()), ("projected_gravity", "length 9.802"));
    assert_eq!(wanted, "length 1: a direction without a unit");
    let (field, found, _) = error(|line| {
        line["base_in_odom"] = json!({"position_m": [0, 0, 0.5], "orientation_xyzw": [0, 0, 0, 0]});
    });
    assert_eq!((field.as_str(), found.as_str()), ("base_in_odom.orientation_xyzw", "length 0.000"));
}

#[test]
fn a_line_that_is_not_json_is_answered() {
    for text in ["", "{", "[1, 2]", "null", "{\"t_s\": NaN}", "{\"t_s\": 1e999}", "\u{0}"] {
        assert_eq!(raw_error(text.to_owned()).0, "line", "{text:?}");
    }
    let nested = "[".repeat(100_000);
    assert_eq!(raw_error(nested).0, "line");
}

#[test]
fn a_number_that_json_does_not_have_is_named() {
    for word in ["NaN", "Infinity", "-Infinity"] {
        let text = line(0.04).to_string().replacen("-0.55", word, 1);
        let (field, found, wanted) = raw_error(text);
        assert!(field == "line" && found.contains(word.trim_start_matches('-')), "{found}");
        assert_eq!(wanted, "one JSON object; an unknown height is null");
    }
}

#[test]
fn an_error_says_besides_what_every_line_says() {
    let mut spoiled = line(0.04);
    spoiled["projected_gravity"] = json!([0.0, 0.0, -9.81]);
    let (values, _) = answers(&[line(0.02).to_string(), spoiled.to_string()]);
    let told = |value: &Value| {
        ["t_s", "active", "choice", "stopped", "forced", "events"].map(|key| value[key].clone())
    };
    assert_eq!(
        told(&values[0]),
        [json!(0.02), json!("stand"), json!("walk"), json!(false), json!(null), json!([])]
    );
    let [t_s, active, choice, stopped, forced, events] = told(&values[1]);
    assert_eq!((t_s, active, choice), (json!(0.04), json!("stand"), json!("stop")));
    assert_eq!((stopped, forced), (json!(true), json!("observation")));
    assert!(events[0].as_str().unwrap().starts_with("projected_gravity: found length 9.810"), "{events}");
}

#[test]
fn lines_much_closer_or_farther_apart_than_ticks_are_remarked_on() {
    for (t_s, found) in [(0.041, "0.001"), (0.04, "0.000"), (10.04, "10.000")] {
        let lines = [line(0.02), line(0.04), line(t_s)].map(|line| line.to_string());
        let (values, served) = answers(&lines);
        assert_eq!((served.errors, &values[1]["events"]), (0, &json!([])));
        let wanted = format!("t_s: found {found} s after the last observation, wanted about 0.02 s");
        assert_eq!(values[2]["events"], json!([wanted]));
    }
}

#[test]
fn a_line_that_is_too_long_is_answered_without_keeping_it() {
    let (field, found, _) = raw_error(format!("{{\"x\": \"{}\"}}", "a".repeat(MAX_LINE_BYTES)));
    assert_eq!((field.as_str(), found.as_str()), ("line", "4194313 bytes"));
}

#[test]
fn time_running_backwards_is_answered_and_the_loop_goes_on_from_there() {
    let (field, found, wanted) = error(|line| line["t_s"] = json!(0.01));
    assert_eq!((field.as_str(), found.as_str(), wanted.as_str()), ("t_s", "0.01", "0.02 or later"));
}

#[test]
fn a_contact_that_a_plugin_needs_must_be_there() {
    let (field, found, _) = error(|line| line["foot_contact"] = json!(null));
    assert_eq!((field.as_str(), found.as_str()), ("foot_contact", "nothing"));
}

#[test]
fn terrain_of_the_wrong_size_stops_and_is_no_malformed_line() {
    let spoilers: [fn(&mut Value); 9] = [
        |line| {
            // Transposed: as many heights, in columns of another length.
            line["elevation"]["height_m"] = json!(vec![vec![-0.55; 31]; 11]);
        },
        |line| line["elevation"]["height_m"] = json!([vec![-0.55; 341]]),
        |line| line["elevation"]["height_m"] = json!(vec![vec![0.0; 11]; 31]),
        |line| line["elevation"]["height_m"] = json!(vec![vec![-55.0; 11]; 31]),
        |line| drop(line.as_object_mut().unwrap().remove("elevation")),
        |line| line["elevation"]["height_m"] = json!([]),
        |line| line["elevation"]["height_m"][4] = json!([0.0]),
        |line| line["elevation"]["front_m"] = json!(1e300),
        |line| line["elevation"]["t_s"] = json!(-3.0),
    ];
    for (index, spoil) in spoilers.into_iter().enumerate() {
        let mut spoiled = line(0.02);
        spoil(&mut spoiled);
        let (values, served) = answers(&[spoiled.to_string()]);
        assert_eq!(served.errors, 0, "spoiler {index}: {values:?}");
        assert_eq!((&values[0]["choice"], &values[0]["active"]), (&json!("stop"), &json!("stand")));
        assert!(values[0]["events"][0].as_str().unwrap().starts_with("elevation: "), "spoiler {index}");
    }
}

#[test]
fn null_heights_are_unknown() {
    let mut spoiled = line(0.02);
    for i in 0..31 {
        spoiled["elevation"]["height_m"][i] = json!(vec![Value::Null; 11]);
    }
    let (values, _) = answers(&[spoiled.to_string()]);
    assert_eq!(values[0]["events"][0], "heightfield: 341 of 341 cells unknown, at most 136 wanted");
}

#[test]
fn every_line_is_answered_though_the_log_fails_at_the_second() {
    let mut runtime = Loop::new(vec![skill("walk", &fake(0.99, 0.2))]).runtime;
    let greeting = Greeting::of(&runtime, "test", vec![]);
    let text: String = (1..=4).map(|tick| line(0.02 * f64::from(tick)).to_string() + "\n").collect();
    let (mut out, mut seen) = (Vec::new(), 0);
    let served = serve(&mut runtime, &greeting, text.as_bytes(), &mut out, |_| {
        seen += 1;
        if seen == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    assert_eq!(sums(&served.unwrap()), (4, 0, true));
    assert_eq!(String::from_utf8(out).unwrap().lines().count(), 1 + 4);
    assert_eq!(seen, 2, "not called again");
}

#[test]
fn an_empty_input_is_a_clean_stop() {
    let (values, served) = answers(&[]);
    assert_eq!((values.len(), sums(&served), served.unheard), (0, (0, 0, false), false));
}

/// Takes so many writes, then nobody reads.
struct HangsUp(usize);

impl std::io::Write for HangsUp {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let is_line = bytes.ends_with(b"\n");
        self.0 = self.0.checked_sub(usize::from(is_line)).ok_or(std::io::ErrorKind::BrokenPipe)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn when_nobody_reads_the_answers_any_more_the_session_ends_and_says_so() {
    let mut runtime = Loop::new(vec![skill("walk", &fake(0.99, 0.2))]).runtime;
    let greeting = Greeting::of(&runtime, "test", vec![]);
    let text: String = (1..=9).map(|tick| line(0.02 * f64::from(tick)).to_string() + "\n").collect();
    let mut seen = 0;
    let served = serve(&mut runtime, &greeting, text.as_bytes(), HangsUp(1 + 4), |_| {
        seen += 1;
        ControlFlow::Continue(())
    })
    .unwrap();
    assert_eq!((sums(&served), served.unheard), ((4, 0, false), true));
    assert_eq!(seen, 5, "what was decided is logged, heard or not");
}

#[test]
fn an_error_before_the_first_good_line_is_answered_with_the_stand_pose_itself() {
    // It was answered with a stand begun from nowhere: LF_HAA at -0.22 rad, the weight's torque added.
    let (values, served) = answers(&["nonsense".to_owned(), "{}".to_owned(), line(0.02).to_string()]);
    assert_eq!((served.errors, values.len()), (2, 3));
    for answer in &values[..2] {
        for joint in &robot().description.joints {
            let target = &answer["joints"][joint.name.as_str()];
            assert_eq!(target["position_rad"].as_f64().map(|it| it as f32), Some(joint.stand_rad as f32));
            assert_eq!(target["feed_forward_nm"], 0.0, "{}", joint.name);
        }
    }
    assert!(values[2].get("error").is_none());
}
