//! Whatever is wrong with one skill of a deployment, it is refused with one line that names file,
//! field, what was found and what would be right, and the others are loaded.

use std::fs;

use vocaloco_core::plugin::library_file_name;
use vocaloco_core::registry::{LoadError, ModelPolicy, check_skill, load_deployment};
use vocaloco_core::robot::RobotModel;
use vocaloco_tests::{Fixture, constant_model, constant_model_of_shape, plugin_folder, repository};

const MANIFEST: &str = "manifests/skills/bad.toml";

/// Loads a deployment of `first`, `bad` and `last`, of which `spoil` spoils `bad`, and checks that
/// only that one is refused, with a line that holds all of `parts`.
fn refused(spoil: impl FnOnce(&mut Fixture), parts: &[&str]) {
    let mut fixture = Fixture::new();
    for skill in ["first", "bad", "last"] {
        fixture.add_skill(skill, "none", 0.97, 0.3);
    }
    fixture.add_deployment("three", &["first", "bad", "last"]);
    let sound = load_deployment(&fixture.installation(), "three").expect("sound");
    assert!(sound.refused.is_empty() && sound.skills.len() == 3, "sound before it is spoiled");

    spoil(&mut fixture);
    let loaded = load_deployment(&fixture.installation(), "three").expect("two skills are left");
    let names: Vec<&str> = loaded.skills.iter().map(|skill| skill.manifest.name.as_str()).collect();
    assert_eq!(names, ["first", "last"]);
    let [refusal] = loaded.refused.as_slice() else { panic!("one refusal, not {:?}", loaded.refused) };
    assert_eq!(refusal.skill, "bad");
    let line = refusal.to_string();
    eprintln!("{line}");
    assert!(!line.contains('\n') && line.len() < 500, "one readable line: {line}");
    for part in ["found ", "wanted "].iter().chain(parts) {
        assert!(line.contains(part), "{part:?} is not in: {line}");
    }
}

/// Writes a file of so many zeros, sparse: it takes no room.
fn write_zeros(fixture: &Fixture, path: &str, bytes: u64) {
    fixture.write(path, b"");
    let file = fs::File::options().write(true).open(fixture.root().join(path)).expect("a file");
    file.set_len(bytes).expect("a length");
}

#[test]
fn a_missing_manifest() {
    refused(|fixture| fs::remove_file(fixture.root().join(MANIFEST)).expect("removed"), &[MANIFEST]);
}

#[test]
fn an_unknown_field() {
    refused(
        |fixture| fixture.alter(MANIFEST, "viability_threshold", "threshold"),
        &[MANIFEST, "selection.threshold", "not known", "`viability_threshold`"],
    );
}

#[test]
fn another_schema() {
    refused(|fixture| fixture.alter(MANIFEST, "schema = 1", "schema = 7"), &[MANIFEST, "schema", "7", "1"]);
}

#[test]
fn a_nan_threshold() {
    refused(
        |fixture| fixture.alter(MANIFEST, "0.9", "nan"),
        &[MANIFEST, "selection.viability_threshold", "NaN", "0 to 1"],
    );
}

#[test]
fn a_missing_plugin() {
    refused(
        |fixture| fixture.alter(MANIFEST, "\"faulty\"", "\"absent\""),
        &[MANIFEST, "plugin", "\"absent\"", &library_file_name("absent"), &plugin_folder().to_string_lossy()],
    );
}

#[test]
fn a_truncated_plugin() {
    let file = library_file_name("cut");
    let spoil = |fixture: &mut Fixture| {
        let bytes = fs::read(plugin_folder().join(library_file_name("faulty"))).expect("a built plugin");
        fixture.write(&format!("plugins/{}", library_file_name("cut")), &bytes[..bytes.len() / 2]);
        fixture.search_first("plugins");
        fixture.alter(MANIFEST, "\"faulty\"", "\"cut\"");
    };
    refused(spoil, &[&file, "ELF", "the file is cut short"]);
}

#[test]
fn a_plugin_larger_than_any_is() {
    let file = library_file_name("large");
    let spoil = |fixture: &mut Fixture| {
        let path = format!("plugins/{}", library_file_name("large"));
        write_zeros(fixture, &path, (256 << 20) + 1);
        fixture.search_first("plugins");
        fixture.alter(MANIFEST, "\"faulty\"", "\"large\"");
    };
    refused(spoil, &[&file, "more than 268435456 bytes", "at most 268435456 bytes"]);
}

#[test]
fn a_file_that_is_no_library() {
    let file = library_file_name("text");
    let spoil = |fixture: &mut Fixture| {
        fixture.write(&format!("plugins/{}", library_file_name("text")), b"not a library");
        fixture.search_first("plugins");
        fixture.alter(MANIFEST, "\"faulty\"", "\"text\"");
    };
    refused(spoil, &[&file, "begins with \"not a \"", "a shared library"]);
}

#[test]
fn a_plugin_of_another_interface() {
    let layout = library_file_name("foreign_layout");
    refused(
        |fixture| fixture.alter(MANIFEST, "\"faulty\"", "\"foreign_layout\""),
        &[
            &layout,
            "interface",
            "vocaloco_skill 0.1.0 with types laid out otherwise",
            "vocaloco-plugin-api 0.1.0",
        ],
    );
    let version = library_file_name("foreign_version");
    refused(
        |fixture| fixture.alter(MANIFEST, "\"faulty\"", "\"foreign_version\""),
        &[&version, "interface", "skill interface 3", "skill interface 2"],
    );
}

#[test]
fn parameters_that_the_plugin_refuses() {
    refused(
        |fixture| fixture.write("skills/bad/fault.txt", b"explode 3"),
        &["skills/bad/fault.txt", "parameters", "\"explode\"", "faulty"],
    );
}

#[test]
fn a_plugin_that_panics_when_created() {
    refused(
        |fixture| fixture.write("skills/bad/fault.txt", b"panic_in_create"),
        &["skills/bad/fault.txt", "create panicked"],
    );
}

#[test]
fn missing_parameters() {
    refused(
        |fixture| fs::remove_file(fixture.root().join("skills/bad/fault.txt")).expect("removed"),
        &[MANIFEST, "models.parameters", "fault.txt", "a readable text file"],
    );
}

#[test]
fn a_missing_model() {
    refused(
        |fixture| fs::remove_file(fixture.root().join("skills/bad/viability.onnx")).expect("removed"),
        &[MANIFEST, "models.viability", "skills/bad/viability.onnx", "a trained predictor"],
    );
}

#[test]
fn a_truncated_model() {
    let spoil = |fixture: &mut Fixture| {
        let model = constant_model("cot", 0.3);
        fixture.write("skills/bad/cot.onnx", &model[..model.len() / 2]);
    };
    refused(spoil, &["skills/bad/cot.onnx"]);
}

#[test]
fn a_model_larger_than_any_is() {
    for quantity in ["viability", "cot"] {
        let path = format!("skills/bad/{quantity}.onnx");
        let spoil = |fixture: &mut Fixture| write_zeros(fixture, &path, (2 << 20) + 1);
        refused(spoil, &[&path, "more than 2097152 bytes", "at most 2097152 bytes"]);
    }
}

#[test]
fn a_policy_larger_than_any_is() {
    let spoil = |fixture: &mut Fixture| {
        // Sound but for its network.
        let shipped = fs::read_to_string(repository().join("manifests/skills/ascend_network.toml"));
        let manifest = shipped.expect("a shipped manifest").replacen("ascend_network", "bad", 1);
        fixture.write(MANIFEST, manifest.as_bytes());
        write_zeros(fixture, "skills/bad/policy.onnx", (8 << 20) + 1);
    };
    refused(spoil, &["skills/bad/policy.onnx", "more than 8388608 bytes", "at most 8388608 bytes"]);
}

#[test]
fn a_model_of_another_shape() {
    refused(
        |fixture| {
            fixture.write("skills/bad/viability.onnx", &constant_model_of_shape("viability", 0.9, [31, 13]));
        },
        &["skills/bad/viability.onnx", "heightfield", "13", "11"],
    );
}

#[test]
fn a_model_in_the_others_place() {
    refused(
        |fixture| fixture.write("skills/bad/viability.onnx", &constant_model("cot", 0.3)),
        &["skills/bad/viability.onnx", "cot", "viability"],
    );
}

#[test]
fn a_joint_that_the_robot_lacks() {
    refused(
        |fixture| {
            fixture.alter(
                MANIFEST,
                "[selection]",
                "[contract]
                joints = [\"LF_HAA\", \"LF_HIP\"]
                observation = [{ term = \"joint_position\" }]
                action = { kind = \"joint_position\", scale = 0.5, default_position_rad = { LF_HAA = 0.0 } }
                gains = { stiffness_nm_per_rad = 80.0, damping_nms_per_rad = 2.0 }

                [selection]",
            );
        },
        &[MANIFEST, "contract.joints[1]", "\"LF_HIP\"", "joints of anymal_d", "RH_KFE"],
    );
}

#[test]
fn a_command_beyond_the_plugins_range() {
    refused(
        |fixture| fixture.alter(MANIFEST, "[0.0, 0.7]", "[0.0, 1.5]"),
        &[MANIFEST, "command.forward_m_per_s", "1.5", "inside [-1, 1]"],
    );
}

#[test]
fn a_policy_that_no_plugin_would_be_handed() {
    refused(
        |fixture| fixture.alter(MANIFEST, "[models]", "[models]\npolicy = \"policy.onnx\""),
        &[MANIFEST, "models.policy", "policy.onnx"],
    );
}

#[test]
fn a_position_target_that_its_plugin_does_not_follow() {
    refused(
        |fixture| fixture.alter(MANIFEST, "\"velocity\"", "\"position_target\"\ntarget_distance_m = 1.0"),
        &[MANIFEST, "command.kind", "position_target", "velocity, the command of plugin faulty"],
    );
}

#[test]
fn a_commitment_that_nothing_would_end() {
    refused(
        |fixture| fixture.alter(MANIFEST, "[selection]", "[selection]\ncommitted = true"),
        &[MANIFEST, "selection.committed", "true", "position_target"],
    );
}

#[test]
fn no_skill_left_is_an_error_that_names_them_all() {
    let fixture = Fixture::new();
    fixture.add_skill("bad", "none", 0.97, 0.3);
    fixture.alter(MANIFEST, "schema = 1", "schema = 7");
    fixture.add_deployment("two", &["bad", "absent"]);
    let error = load_deployment(&fixture.installation(), "two").expect_err("an error");
    assert!(matches!(&error, LoadError::NoSkillLeft { refused, .. } if refused.len() == 2), "{error}");
    let line = error.to_string();
    assert!(line.contains("bad") && line.contains("absent") && !line.contains('\n'), "{line}");
}

#[test]
fn a_rate_that_the_plugin_does_not_run_at() {
    let fixture = Fixture::new();
    fixture.add_skill("bad", "none", 0.97, 0.3);
    fixture.add_deployment("slow", &["bad"]);
    fixture.alter("manifests/deployments/slow.toml", "schema = 1", "schema = 1\nrate_hz = 20");
    let line = load_deployment(&fixture.installation(), "slow").expect_err("an error").to_string();
    assert!(line.contains("slow.toml: rate_hz: found 20, wanted 50"), "{line}");
}

#[test]
fn an_isolation_that_is_not_known() {
    refused(
        |fixture| fixture.alter(MANIFEST, "plugin =", "isolation = \"virtual_machine\"\nplugin ="),
        &[MANIFEST, "isolation", "virtual_machine", "`none` or `process`"],
    );
}

#[test]
#[cfg(target_os = "linux")]
fn an_isolated_plugin_that_ends_its_process_when_created() {
    refused(
        |fixture| {
            fixture.alter(MANIFEST, "plugin =", "isolation = \"process\"\nplugin =");
            fixture.write("skills/bad/fault.txt", b"abort_in_create");
        },
        &["isolation", "ended by signal 6", "makes an instance"],
    );
}

#[test]
#[cfg(target_os = "linux")]
fn parameters_that_an_isolated_plugin_refuses() {
    refused(
        |fixture| {
            fixture.alter(MANIFEST, "plugin =", "isolation = \"process\"\nplugin =");
            fixture.write("skills/bad/fault.txt", b"levitate");
        },
        &["skills/bad/fault.txt", "parameters", "levitate"],
    );
}

#[test]
fn a_plugin_that_answers_the_same_inputs_otherwise_is_found_by_a_check() {
    let fixture = Fixture::new();
    fixture.add_skill("sound", "none", 0.97, 0.3);
    fixture.add_skill("drifting", "drift 4", 0.97, 0.3);
    let installation = fixture.installation();
    let robot = RobotModel::load(&installation.robots_folder(), "anymal_d").expect("the robot");
    let check = |name| check_skill(&installation, name, &robot.description, ModelPolicy::Required);
    assert_eq!(check("sound"), []);
    let findings = check("drifting");
    let [finding] = findings.as_slice() else { panic!("one finding, not {findings:?}") };
    assert_eq!(finding.field, "act", "{finding}");
    assert!(finding.found.contains("LH_HFE in tick 4"), "{finding}");
}
