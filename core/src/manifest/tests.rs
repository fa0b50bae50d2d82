use std::fs;
use std::path::Path;

use super::*;

const SKILL: &str = include_str!("../../../manifests/skills/ascend.toml");
const DEPLOYMENT: &str = include_str!("../../../manifests/deployments/anymal_stairs.toml");

fn written<T>(name: &str, text: &str, read: impl Fn(&Path) -> Result<T, Finding>) -> Result<T, Finding> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join(name);
    fs::write(&path, text).expect("a written file");
    read(&path)
}

/// The refusal of the shipped `ascend.toml` with `from` replaced by `to`: line, field, found, wanted.
fn refusal(from: &str, to: &str) -> (Option<usize>, String, String, String) {
    assert!(SKILL.contains(from), "{from} is in the shipped manifest");
    let finding = written("ascend.toml", &SKILL.replacen(from, to, 1), SkillManifest::read).expect_err(to);
    assert!(!finding.to_string().contains('\n'), "{finding}");
    (finding.line, finding.field, finding.found, finding.wanted)
}

#[test]
fn the_shipped_manifests_are_read_as_written() {
    let skill = written("ascend.toml", SKILL, SkillManifest::read).expect("sound");
    assert_eq!((skill.name.as_str(), skill.plugin.as_str()), ("ascend", "gait"));
    assert_eq!(skill.selection, Selection { viability_threshold: 0.925, cost_margin: 0.1, committed: false });
    assert_eq!(
        skill.rollout,
        Rollout { horizon_m: 1.5, time_limit_s: 4.0, own_starts_share: 0.0, in_stride_share: 0.0 }
    );
    let deployment = written("anymal_stairs.toml", DEPLOYMENT, Deployment::read).expect("sound");
    assert_eq!(deployment.skills, ["walk", "ascend_network", "descend_network"]);
    assert_eq!((deployment.switch_window, deployment.stop_window, deployment.resume_window), (10, 10, 25));
}

#[test]
fn an_unknown_field_is_named_with_its_table_and_the_known_ones() {
    let (line, field, found, wanted) = refusal("viability_threshold = 0.925", "viability_treshold = 0.925");
    assert_eq!((line, field.as_str()), (Some(12), "selection.viability_treshold"));
    assert_eq!(found, "a field that is not known here");
    assert!(wanted.contains("`viability_threshold`"), "{wanted}");
    let (_, field, ..) = refusal("plugin =", "colour = \"red\"\nplugin =");
    assert_eq!(field, "colour");
}

#[test]
fn a_missing_field_is_named_with_its_table() {
    let (_, field, found, _) = refusal("viability_threshold = 0.925\n", "");
    assert_eq!((field.as_str(), found.as_str()), ("selection.viability_threshold", "nothing"));
    let (_, field, ..) = refusal("summary = \"Climbs stairs\"\n", "");
    assert_eq!(field, "summary");
}

#[test]
fn a_value_of_the_wrong_type_is_named() {
    let (line, field, found, wanted) = refusal("0.925", "\"high\"");
    assert_eq!((line, field.as_str()), (Some(12), "selection.viability_threshold"));
    assert!(found.contains("high") && !wanted.is_empty(), "{found}, {wanted}");
}

#[test]
fn a_nan_threshold_is_refused() {
    let (line, field, found, wanted) = refusal("0.925", "nan");
    assert_eq!((line, field.as_str()), (Some(12), "selection.viability_threshold"));
    assert_eq!((found.as_str(), wanted.as_str()), ("NaN", "0 to 1"));
}

#[test]
fn shares_of_rows_make_up_all_of_them_at_most() {
    let with = |own: f64, stride: f64| {
        format!("{SKILL}\n[rollout]\nown_starts_share = {own}\nin_stride_share = {stride}\n")
    };
    for (own, stride) in [(0.9, 0.1), (0.7, 0.3), (0.0, 1.0)] {
        let skill = written("ascend.toml", &with(own, stride), SkillManifest::read).expect("all of them");
        assert_eq!(skill.rollout.in_stride_share, stride);
    }
    let finding = written("ascend.toml", &with(0.7, 0.4), SkillManifest::read).expect_err("more than all");
    assert_eq!((finding.field.as_str(), finding.found.as_str()), ("rollout.in_stride_share", "0.4"));
    assert!(finding.wanted.contains("own_starts_share = 0.7"), "{finding}");
}

#[test]
fn another_schema_is_refused_before_its_unknown_fields() {
    let (line, field, found, wanted) = refusal("schema = 1", "schema = 2\nfuture = true");
    assert_eq!((line, field.as_str(), found.as_str(), wanted.as_str()), (Some(1), "schema", "2", "1"));
}

#[test]
fn a_name_unlike_the_file_is_refused() {
    let (_, field, found, wanted) = refusal("\"ascend\"", "\"climb\"");
    assert_eq!((field.as_str(), found.as_str()), ("name", "\"climb\""));
    assert!(wanted.contains("\"ascend\""), "{wanted}");
}

#[test]
fn a_path_out_of_the_skill_folder_is_refused() {
    for path in ["../walk/cot.onnx", "/etc/passwd", "a/../../b", ""] {
        let (_, field, found, _) = refusal("\"cot.onnx\"", &format!("{path:?}"));
        assert_eq!((field.as_str(), found), ("models.cot", format!("{path:?}")));
    }
}

#[test]
fn a_command_range_upside_down_is_refused() {
    let (_, field, ..) = refusal("[0.0, 0.7]", "[0.7, 0.4]");
    assert_eq!(field, "command.forward_m_per_s");
    let (_, field, ..) = refusal("[0.0, 0.7]", "[nan, 0.7]");
    assert_eq!(field, "command.forward_m_per_s");
}

#[test]
fn broken_toml_is_refused_with_its_line() {
    let (line, ..) = refusal("[selection]", "[selection");
    assert_eq!(line, Some(11));
}

#[test]
fn an_oversized_manifest_is_refused_unread() {
    let text = format!("{SKILL}# {}", "x".repeat(1 << 20));
    let finding = written("ascend.toml", &text, SkillManifest::read).expect_err("refused");
    assert!(finding.found.contains("more than 1048576 bytes"), "{finding}");
}

#[test]
fn a_deployment_of_more_skills_than_any_robot_has_is_refused_at_once() {
    let names: Vec<String> = (0..100_000).map(|skill| format!("\"s{skill}\"")).collect();
    let text = format!("schema = 1\nrobot = \"anymal_d\"\nskills = [{}]\n", names.join(","));
    let finding = Deployment::parse(Path::new("many.toml"), text).expect_err("refused");
    assert_eq!((finding.field.as_str(), finding.found.as_str()), ("skills", "100000 skills"));
}

#[cfg(unix)]
#[test]
fn a_pipe_in_place_of_a_file_is_not_waited_for() {
    let folder = tempfile::tempdir().expect("a folder");
    let pipe = folder.path().join("stairs.toml");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo runs");
    assert!(made.success());
    let finding = Deployment::read(&pipe).expect_err("refused");
    assert!(finding.found.ends_with("no file"), "{finding}");
}

#[test]
fn a_deployment_out_of_range_is_refused_by_field() {
    for (from, to, field) in [
        ("switch_window = 10", "switch_window = 0", "switch_window"),
        ("max_age_s = 0.2", "max_age_s = nan", "heightfield.max_age_s"),
        ("max_age_s = 0.2", "frozen_s = 0.0", "heightfield.frozen_s"),
        ("[heightfield]", "[measurement]\nfrozen_s = -1.0\n[heightfield]", "measurement.frozen_s"),
        ("[heightfield]", "[measurement]\nmax_tilt_rad = 70\n[heightfield]", "measurement.max_tilt_rad"),
        ("rate_hz = 50", "rate_hz = inf", "rate_hz"),
        ("rate_hz = 50", "switching.ramp_s = nan", "switching.ramp_s"),
        ("rate_hz = 50", "trusted_keys = [\"ab\"]", "trusted_keys[0]"),
        ("\"descend_network\"]", "\"walk\"]", "skills[2]"),
        ("[\"walk\", \"ascend_network\", \"descend_network\"]", "[]", "skills"),
        ("[heightfield]", "[viability_thresholds]\nwalk = 1.01\n[heightfield]", "viability_thresholds.walk"),
        ("[heightfield]", "[viability_thresholds]\ntrot = 0.9\n[heightfield]", "viability_thresholds.trot"),
        ("[hold_thresholds]", "[hold_thresholds]\nwalk = -0.1", "hold_thresholds.walk"),
        ("[hold_thresholds]", "[hold_thresholds]\ntrot = 0.9", "hold_thresholds.trot"),
        ("[heightfield]", "[deadlines]\nact_s = nan\n[heightfield]", "deadlines.act_s"),
        ("[heightfield]", "[deadlines]\npredict_s = 0.0041\n[heightfield]", "deadlines.predict_s"),
    ] {
        assert!(DEPLOYMENT.contains(from), "{from}");
        let finding = written("d.toml", &DEPLOYMENT.replacen(from, to, 1), Deployment::read).expect_err(to);
        assert_eq!(finding.field, field, "{finding}");
    }
}

#[test]
fn deadlines_fit_into_a_tick_unless_set_and_then_too() {
    let default = written("d.toml", DEPLOYMENT, Deployment::read).expect("sound").deadlines;
    assert!((default.act_s - 0.008).abs() < 1e-9 && (3.0 * default.predict_s - 0.01).abs() < 1e-9);
    let text = DEPLOYMENT.replacen("[heightfield]", "[deadlines]\nact_s = 0.008\n[heightfield]", 1);
    assert!(
        (written("d.toml", &text, Deployment::read).expect("sound").deadlines.act_s - 0.008).abs() < 1e-12
    );
    let text = text.replacen("act_s = 0.008", "act_s = 0.009", 1);
    let finding = written("d.toml", &text, Deployment::read).expect_err("a tick has more to do");
    assert_eq!(finding.field, "deadlines.act_s", "{finding}");
    assert!(finding.found.contains("0.019") && finding.wanted.contains("0.018"), "{finding}");
}

#[test]
fn the_stop_window_is_as_long_as_the_switch_window_unless_set() {
    let deployment =
        written("d.toml", &DEPLOYMENT.replacen("= 10", "= 7", 1), Deployment::read).expect("sound");
    assert_eq!(deployment.stop_window, 7);
    let text = DEPLOYMENT.replacen("switch_window = 10", "switch_window = 7\nstop_window = 1", 1);
    assert_eq!(written("d.toml", &text, Deployment::read).expect("sound").stop_window, 1);
}
