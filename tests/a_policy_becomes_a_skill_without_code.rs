//! `vocaloco skills new --from policy.onnx`: a network as it was exported becomes a skill that lacks nothing but
//! its predictors; what does not fit is refused with both sides, and leaves nothing behind.

use std::fs;
use std::path::PathBuf;
use std::process::Output;

use serde_json::Value;
use vocaloco_core::manifest::SkillManifest;
use vocaloco_plugin_api::CommandKind;
use vocaloco_tests::{Fixture, PolicyModel, repository, snapshot};

/// The policy's order, which is not the robot's.
const JOINTS: &str = "LF_HAA,LH_HAA,RF_HAA,RH_HAA,LF_HFE,LH_HFE,RF_HFE,RH_HFE,LF_KFE,LH_KFE,RF_KFE,RH_KFE";
const DEFAULTS: &str = "0.0,0.0,0.0,0.0,0.4,-0.4,0.4,-0.4,-0.8,0.8,-0.8,0.8";

/// A network of 48 values whose file says what Isaac Lab writes.
fn exported() -> PolicyModel {
    let mut model = PolicyModel::arbitrary(&[48, 16, 12]);
    let names = "base_lin_vel,base_ang_vel,projected_gravity,velocity_commands,joint_pos,joint_vel,actions";
    let entries = [
        ("joint_names", JOINTS),
        ("default_joint_pos", DEFAULTS),
        ("action_scale", "0.5"),
        ("joint_stiffness", "80.0"),
        ("joint_damping", "2.0"),
        ("observation_names", names),
    ];
    model.metadata = entries.iter().map(|(key, value)| ((*key).into(), (*value).into())).collect();
    model
}

/// The same contract by hand, for a file that says nothing.
fn by_hand() -> String {
    let joints: Vec<&str> = JOINTS.split(',').collect();
    let defaults: Vec<_> =
        joints.iter().zip(DEFAULTS.split(',')).map(|(joint, value)| format!("{joint} = {value}")).collect();
    format!(
        "[contract]\njoints = {joints:?}\nobservation = [{{ term = \"base_linear_velocity\" }}, \
         {{ term = \"base_angular_velocity\" }}, {{ term = \"projected_gravity\" }}, {{ term = \"velocity_command\" }}, \
         {{ term = \"joint_position\" }}, {{ term = \"joint_velocity\" }}, {{ term = \"last_action\" }}]\n\
         gains = {{ stiffness_nm_per_rad = 80.0, damping_nms_per_rad = 2.0 }}\n\
         action = {{ kind = \"joint_position\", scale = 0.5, default_position_rad = {{ {} }} }}\n",
        defaults.join(", ")
    )
}

fn new(fixture: &Fixture, more: &[&str]) -> Output {
    let words = ["skills", "new", "stroll", "--from", "exported/policy.onnx"];
    fixture.vocaloco(&[&words, more].concat()).output().expect("vocaloco runs")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The skill that was made of `model`.
fn made(fixture: &Fixture, model: &PolicyModel, more: &[&str]) -> (SkillManifest, Value) {
    fixture.write("exported/policy.onnx", &model.onnx());
    let output = new(fixture, &[more, &["--json"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report: Value = serde_json::from_slice(&output.stdout).expect("JSON alone on stdout");
    let manifest = SkillManifest::read(&fixture.root().join("manifests/skills/stroll.toml"));
    (manifest.unwrap_or_else(|finding| panic!("{finding}")), report)
}

/// The refusal of what lies at `exported/policy.onnx`; the installation stays as it was.
fn refused(fixture: &Fixture, more: &[&str], parts: &[&str]) -> String {
    let before = snapshot(fixture.root());
    let output = new(fixture, more);
    let narration = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{narration}");
    assert!(output.stdout.is_empty(), "results alone on stdout");
    for part in ["not made: ", "found "].iter().chain(parts) {
        assert!(narration.contains(part), "{part:?} is not in: {narration}");
    }
    assert!(!narration.contains(".staging"), "no path that is gone: {narration}");
    assert!(before == snapshot(fixture.root()), "nothing is left behind");
    narration
}

#[test]
fn a_file_that_says_what_it_was_trained_with_needs_nothing_more() {
    let fixture = Fixture::new();
    let (manifest, report) = made(&fixture, &exported(), &["--summary", "Strolls"]);
    assert_eq!((manifest.plugin.as_str(), manifest.summary.as_str()), ("onnx", "Strolls"));
    assert_eq!(manifest.command.forward_m_per_s, [0.0, 0.7]);
    let contract = manifest.contract.expect("a contract");
    assert_eq!(contract.joints.join(","), JOINTS);
    assert_eq!(contract.action.default_position_rad["LH_HFE"], -0.4);
    assert_eq!((&report["inputs"], &report["outputs"]), (&48.into(), &12.into()), "{report:#}");
    let observed = report["contract_from"]["observation"].as_str().expect("its origin");
    assert!(observed.contains("observation_names") && observed.contains("assumed"), "{observed}");

    let copied = fs::read(fixture.root().join("skills/stroll/policy.onnx")).expect("the network");
    assert_eq!(copied, exported().onnx());
    let card = fs::read_to_string(fixture.root().join("skills/stroll/CARD.md")).expect("a card");
    assert!(card.contains(report["policy_sha256"].as_str().expect("a hash")), "{card}");

    let output = fixture.vocaloco(&["skills", "check", "--json"]).output().expect("vocaloco runs");
    let check: Value = serde_json::from_slice(&output.stdout).expect("JSON alone on stdout");
    let findings: Vec<&str> = check["skills"][0]["findings"]
        .as_array()
        .expect("findings")
        .iter()
        .filter_map(Value::as_str)
        .collect();
    assert_eq!(findings.len(), 2, "{findings:?}");
    assert!(findings[0].contains("models.viability") && findings[1].contains("models.cot"), "{findings:?}");
}

#[test]
fn a_network_of_this_projects_trainer_gets_the_contract_that_it_was_trained_with() {
    let fixture = Fixture::new();
    let shipped = repository().join("skills/ascend_network/policy.onnx");
    fixture.write("exported/policy.onnx", &fs::read(shipped).expect("a shipped network"));
    let output = new(&fixture, &[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains("vocaloco collect --skill stroll"), "what comes next: {text}");
    let read = |path: PathBuf| SkillManifest::read(&path).expect("a manifest").contract;
    let made = read(fixture.root().join("manifests/skills/stroll.toml"));
    assert_eq!(made, read(repository().join("manifests/skills/ascend_network.toml")));
}

#[test]
fn a_file_that_says_nothing_takes_its_contract_from_another_file() {
    let fixture = Fixture::new();
    fixture.write("contract.toml", by_hand().as_bytes());
    let silent = PolicyModel { metadata: Vec::new(), ..exported() };
    let more = ["--contract", "contract.toml", "--forward-m-per-s", "-0.2,0.5"];
    let (by_hand, _) = made(&fixture, &silent, &more);
    assert_eq!(by_hand.command.forward_m_per_s, [-0.2, 0.5]);
    let other = Fixture::new();
    let (said, _) = made(&other, &exported(), &[]);
    assert_eq!(by_hand.contract, said.contract);
}

#[test]
fn a_network_that_observes_a_target_becomes_a_skill_that_goes_to_targets() {
    let fixture = Fixture::new();
    fixture.write("contract.toml", by_hand().replace("velocity_command", "position_target").as_bytes());
    let model = PolicyModel::arbitrary(&[49, 16, 12]);
    let (manifest, _) =
        made(&fixture, &model, &["--contract", "contract.toml", "--target-distance-m", "1.2"]);
    assert_eq!(manifest.command.kind, CommandKind::PositionTarget);
    assert_eq!(manifest.command.target_distance_m, Some(1.2));
}

#[test]
fn without_a_contract_the_missing_fields_and_a_whole_example_are_shown() {
    let fixture = Fixture::new();
    fixture.write("exported/policy.onnx", &PolicyModel::arbitrary(&[48, 16, 12]).onnx());
    let narration = refused(
        &fixture,
        &[],
        &[
            "joints, observation, action.scale",
            "takes 48 values and gives 12",
            "[contract]",
            "235 values in (base_",
        ],
    );
    // What it shows can be taken: for a network of that many values it is a contract.
    let (_, example) = narration.split_once("# 235 values").expect("an example");
    fixture.write("contract.toml", format!("# 235 values{example}").as_bytes());
    let wide = PolicyModel::arbitrary(&[235, 16, 12]);
    made(&fixture, &wide, &["--contract", "contract.toml"]);
}

#[test]
fn half_of_what_is_missing_is_named_alone() {
    let fixture = Fixture::new();
    let mut model = exported();
    model.metadata.retain(|(key, _)| key != "joint_damping");
    fixture.write("exported/policy.onnx", &model.onnx());
    let narration = refused(&fixture, &[], &["found nothing for gains.damping_nms_per_rad\n"]);
    assert!(!narration.contains("gains.stiffness_nm_per_rad,"), "{narration}");
    fixture.write("rest.toml", b"[contract.gains]\ndamping_nms_per_rad = 3.0\n");
    let (manifest, _) = made(&fixture, &model, &["--contract", "rest.toml"]);
    let joints = manifest.contract.as_ref().map(|contract| contract.joints.clone()).expect("joints");
    let damping = manifest.contract.expect("a contract").gains.damping_nms_per_rad;
    assert_eq!(damping.in_order("", &joints).expect("a number"), [3.0; 12]);
}

#[test]
fn terms_that_do_not_add_up_are_refused_with_each_of_them_and_both_sums() {
    let fixture = Fixture::new();
    fixture.write("exported/policy.onnx", &PolicyModel { metadata: Vec::new(), ..exported() }.onnx());
    fixture.write("contract.toml", by_hand().replace("{ term = \"joint_velocity\" }, ", "").as_bytes());
    let sums = [
        "contract.toml: contract.observation: found 36 values (base_linear_velocity 3",
        "wanted 48, the input",
    ];
    refused(&fixture, &["--contract", "contract.toml"], &sums);
    fixture.write("exported/policy.onnx", &PolicyModel::arbitrary(&[48, 16, 11]).onnx());
    fixture.write("contract.toml", by_hand().as_bytes());
    refused(
        &fixture,
        &["--contract", "contract.toml"],
        &["found 12 joints", "wanted 11, the output of policy.onnx"],
    );
}

#[test]
fn a_contract_that_contradicts_the_file_or_the_robot_is_refused_with_both_values() {
    let fixture = Fixture::new();
    fixture.write("exported/policy.onnx", &exported().onnx());
    for (from, to, parts) in [
        (
            "stiffness_nm_per_rad = 80.0",
            "stiffness_nm_per_rad = 40.0",
            ["found 40", "80.0, joint_stiffness of policy.onnx"],
        ),
        ("\"LF_HAA\"", "\"LF_HIP\"", ["contract.joints[0]", "\"LF_HIP\""]),
        ("scale = 0.5", "scale = nan", ["contract.action.scale", "NaN"]),
        ("projected_gravity", "gravity", ["`gravity`", "`projected_gravity`"]),
    ] {
        fixture.write("contract.toml", by_hand().replace(from, to).as_bytes());
        refused(&fixture, &["--contract", "contract.toml"], &parts);
    }
    refused(
        &fixture,
        &["--forward-m-per-s", "0,9"],
        &["--forward-m-per-s", "command.forward_m_per_s: found 9"],
    );
}

#[test]
fn what_is_no_policy_is_refused() {
    let fixture = Fixture::new();
    let whole = exported().onnx();
    for bytes in [&b""[..], b"not onnx", &whole[..whole.len() / 2]] {
        fixture.write("exported/policy.onnx", bytes);
        refused(&fixture, &[], &["exported/policy.onnx"]);
    }
    fs::remove_file(fixture.root().join("exported/policy.onnx")).expect("removed");
    refused(&fixture, &[], &["exported/policy.onnx", "a readable model file"]);
}

#[test]
fn a_refusal_is_json_too() {
    let fixture = Fixture::new();
    fixture.write("exported/policy.onnx", &PolicyModel::arbitrary(&[48, 16, 12]).onnx());
    let output = new(&fixture, &["--json"]);
    assert_eq!(output.status.code(), Some(1));
    let report: Value = serde_json::from_slice(&output.stdout).expect("JSON alone on stdout");
    assert_eq!((&report["inputs"], &report["outputs"]), (&48.into(), &12.into()), "{report:#}");
    assert_eq!(report["missing"].as_array().map(Vec::len), Some(6), "{report:#}");
    assert_eq!(report["written"], serde_json::json!([]), "{report:#}");
    assert!(!stderr(&output).contains("[contract]"), "the example is for people");
}

#[test]
fn a_name_that_is_taken_and_arguments_of_the_other_way_are_refused() {
    let fixture = Fixture::new();
    fixture.write("exported/policy.onnx", &exported().onnx());
    for taken in ["manifests/skills/stroll.toml", "skills/stroll/notes.txt"] {
        fixture.write(taken, b"mine");
        let before = snapshot(fixture.root());
        let output = new(&fixture, &[]);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains("taken by "), "{}", stderr(&output));
        assert!(before == snapshot(fixture.root()));
        fs::remove_file(fixture.root().join(taken)).expect("removed");
    }
    for more in [
        &["--dir", "plugins"][..],
        &["--contract", "absent.toml"],
        &["--robot", "absent"],
        &["--forward-m-per-s", "1"],
    ] {
        assert_eq!(new(&fixture, more).status.code(), Some(2), "{more:?}");
    }
    let alone =
        fixture.vocaloco(&["skills", "new", "stroll", "--contract", "x.toml"]).output().expect("it runs");
    assert_eq!(alone.status.code(), Some(2), "a contract needs a network");
}
