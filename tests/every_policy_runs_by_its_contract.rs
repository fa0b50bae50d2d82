//! A policy network runs through the plugin `onnx` as its manifest's contract says, and a contract that
//! fits neither robot nor network is refused in one line.

use std::sync::Arc;

use vocaloco_core::policy::PolicyNetwork;
use vocaloco_core::registry::{LoadedSkill, ModelPolicy, load_deployment, load_skill};
use vocaloco_core::robot::RobotModel;
use vocaloco_core::runtime::Runtime;
use vocaloco_plugin_api::contract::Contract;
use vocaloco_plugin_api::observation::Observer;
use vocaloco_plugin_api::{Command, JointTarget, RobotState, TerrainPatch};
use vocaloco_sim::evaluate::{Query, sample};
use vocaloco_sim::rollout::{Outcome, RolledSkill};
use vocaloco_sim::terrain::TerrainKind;
use vocaloco_sim::{identity, threads::with_threads};
use vocaloco_tests::{Fixture, PolicyModel, constant_model, repository};
use vocaloco_train::policy_learning::{
    config::Plan, learner::Learner, learner::Widths, policy_file, single_pass::Scratch,
};

const MANIFEST: &str = "manifests/skills/net.toml";
const MODEL: &str = "skills/net/policy.onnx";
/// Neither the robot's order nor its reverse.
const LEGS: [&str; 4] = ["RH", "LF", "LH", "RF"];
const OBSERVED: usize = 87;
const PATCH: TerrainPatch = TerrainPatch { back_m: 0.2, front_m: 0.4, half_width_m: 0.1, resolution_m: 0.1 };

const TEXT: &str = r#"schema = 1
name = "net"
summary = "A small network"
plugin = "onnx"

[models]
policy = "policy.onnx"
viability = "viability.onnx"
cot = "cot.onnx"

[selection]
viability_threshold = 0.9

[command]
kind = "velocity"
forward_m_per_s = [0.0, 0.7]

[contract]
joints = JOINTS
observation = [
  { term = "base_linear_velocity", scale = 2.0 },
  { term = "base_angular_velocity", scale = 0.25 },
  { term = "projected_gravity" },
  { term = "velocity_command", scale = [2.0, 2.0, 0.25] },
  { term = "joint_position" },
  { term = "joint_velocity", scale = 0.05, history = 2 },
  { term = "last_action" },
  { term = "foot_contact" },
  { term = "gait_phase", period_s = 0.5 },
  { term = "heights", scale = 5.0, patch = { back_m = 0.2, front_m = 0.4, half_width_m = 0.1, resolution_m = 0.1, offset_m = 0.5 } },
]
action = { kind = "joint_position", scale = 0.5, default_position_rad = DEFAULTS }
gains = { stiffness_nm_per_rad = 80.0, damping_nms_per_rad = 2.0 }
"#;

fn joints() -> Vec<String> {
    LEGS.iter().flat_map(|leg| ["KFE", "HAA", "HFE"].map(|joint| format!("{leg}_{joint}"))).collect()
}

/// The skill `net` with this network, its defaults the robot's stand.
fn fixture(model: &PolicyModel) -> Fixture {
    let fixture = Fixture::new();
    let defaults = joints().iter().fold(String::new(), |text, joint| {
        let size = match &joint[3..] {
            "HFE" => 0.4,
            "KFE" => -0.8,
            _ => 0.0,
        };
        let sign = if joint[1..].starts_with('H') { -1.0 } else { 1.0 };
        format!("{text}{joint} = {:?}, ", sign * size)
    });
    let defaults = format!("{{ {} }}", defaults.trim_end_matches(", "));
    let text = TEXT.replace("JOINTS", &format!("{:?}", joints())).replace("DEFAULTS", &defaults);
    fixture.write(MANIFEST, text.as_bytes());
    fixture.write(MODEL, &model.onnx());
    for (quantity, value) in [("viability", 0.97), ("cot", 0.3)] {
        fixture.write(&format!("skills/net/{quantity}.onnx"), &constant_model(quantity, value));
    }
    fixture.add_deployment("alone", &["net"]);
    fixture
}

fn model() -> PolicyModel {
    PolicyModel::arbitrary(&[OBSERVED, 32, 16, 12])
}

fn robot(fixture: &Fixture) -> Arc<RobotModel> {
    let folder = fixture.installation().robots_folder();
    Arc::new(RobotModel::load(&folder, "anymal_d").expect("the shipped robot"))
}

fn load(fixture: &Fixture, robot: &RobotModel) -> LoadedSkill {
    load_skill(&fixture.installation(), "net", &robot.description, ModelPolicy::Required)
        .unwrap_or_else(|refusal| panic!("{refusal}"))
}

/// Measurements of one tick, no two alike.
struct Measured {
    position_rad: Vec<f32>,
    velocity_rad_per_s: Vec<f32>,
    contact: [u8; 4],
    terrain_m: Vec<f32>,
    wave: f32,
}

impl Measured {
    fn at(tick: usize, robot: &RobotModel) -> Self {
        let wave = |phase: f64| libm::sin(0.3 * tick as f64 + phase) as f32;
        let stand = robot.stand_position_rad();
        let position = |(joint, stand): (usize, &f32)| stand + 0.1 * wave(joint as f64);
        Self {
            position_rad: stand.iter().enumerate().map(position).collect(),
            velocity_rad_per_s: (0..stand.len()).map(|joint| 2.0 * wave(0.5 * joint as f64)).collect(),
            contact: std::array::from_fn(|foot| u8::from((tick / 5 + foot).is_multiple_of(3))),
            terrain_m: (0..PATCH.rows() * PATCH.columns())
                .map(|point| 0.1 * wave(point as f64) - 0.5)
                .collect(),
            wave: wave(0.7),
        }
    }

    fn state(&self) -> RobotState<'_> {
        RobotState {
            time_s: 0.0,
            joint_position_rad: self.position_rad.as_slice().into(),
            joint_velocity_rad_per_s: self.velocity_rad_per_s.as_slice().into(),
            joint_torque_nm: [][..].into(),
            base_linear_velocity_m_per_s: [0.5, 0.1 * self.wave, 0.02],
            base_angular_velocity_rad_per_s: [0.1, 0.2 * self.wave, 0.3],
            projected_gravity: [0.03, 0.02 * self.wave, -0.99],
            foot_contact: self.contact.as_slice().into(),
            terrain_m: self.terrain_m.as_slice().into(),
        }
    }
}

const COMMAND: Command = Command::velocity(0.6, -0.05, 0.1);

/// The targets of `ticks` ticks after a reset.
fn targets(skill: &mut vocaloco_core::plugin::PluginInstance, robot: &RobotModel) -> Vec<Vec<JointTarget>> {
    skill.reset(&Measured::at(0, robot).state()).expect("a reset");
    let act = |tick| {
        let mut joints = vec![JointTarget::default(); robot.joint_count()];
        skill.act(&Measured::at(tick, robot).state(), &COMMAND, &mut joints).expect("targets");
        joints
    };
    (0..40).map(act).collect()
}

/// That the skill of `fixture` does what `forward` answers to observations by its contract.
fn acts_as(fixture: &Fixture, mut forward: impl FnMut(&[f32]) -> Vec<f32>) {
    let robot = robot(fixture);
    let skill = load(fixture, &robot);
    let contract: &Contract = skill.manifest.contract.as_ref().expect("a contract");
    let mut observer = Observer::new(contract, &robot.description).expect("an observer");
    let mut instance = skill.create(&robot.description).expect("an instance");
    assert_eq!(instance.needs().terrain.into_option(), Some(PATCH));
    assert!(instance.needs().foot_contacts && !instance.needs().joint_torques);

    let (mut last, mut observation) = (vec![0.0; 12], vec![0.0; OBSERVED]);
    for (tick, found) in targets(&mut instance, &robot).iter().enumerate() {
        let measured = Measured::at(tick, &robot);
        observer.write(&measured.state(), &COMMAND, &last, &mut observation).expect("an observation");
        last = forward(&observation);
        for (name, action) in joints().iter().zip(&last) {
            let place = robot.description.joints.iter().position(|joint| joint.name == *name);
            let target = found[place.expect("a joint of the robot")];
            let wanted = contract.action.default_position_rad[name] as f32 + 0.5 * action;
            assert!((target.position_rad - wanted).abs() < 1e-5, "tick {tick}, {name}: {target:?}, {wanted}");
            assert_eq!((target.stiffness_nm_per_rad, target.damping_nms_per_rad), (80.0, 2.0));
        }
    }
}

#[test]
fn the_plugin_acts_as_the_network_computes() {
    let model = model();
    acts_as(&fixture(&model), |observation| model.forward(observation));
}

#[test]
fn a_trained_policy_acts_through_the_plugin_as_in_training() {
    let mut plan = Plan::with_environment(1, ());
    plan.network.actor = vec![32, 16];
    let widths = Widths { observation: OBSERVED, privileged: 4, action: 12 };
    let mut learner = Learner::new(&plan, widths, 3);
    let rows: Vec<Vec<f32>> = (0..20)
        .map(|row| (0..OBSERVED).map(|at| libm::sinf((row * at) as f32) + 0.1 * at as f32).collect())
        .collect();
    learner.observation.add(rows.iter().map(Vec::as_slice));
    for (index, parameter) in learner.policy.iter_mut().enumerate() {
        *parameter += 0.05 * libm::sinf(index as f32);
    }

    let fixture = fixture(&model());
    let contract = load(&fixture, &robot(&fixture)).manifest.contract.expect("a contract");
    let metadata = policy_file::metadata(&contract, "net", 3).expect("metadata");
    fixture.write(MODEL, &policy_file::onnx(&learner, metadata));
    let (policy, mut scratch) = (learner.single_pass(), Scratch::default());
    acts_as(&fixture, |observation| policy.answer(observation, &mut scratch).to_vec());
}

#[test]
fn a_reset_forgets_the_last_action_the_history_and_the_phase() {
    let fixture = fixture(&model());
    let robot = robot(&fixture);
    let skill = load(&fixture, &robot);
    let mut one = skill.create(&robot.description).expect("an instance");
    let first = targets(&mut one, &robot);
    assert_ne!(first[0], first[25], "the same phase, another state: it does something");
    assert_eq!(first, targets(&mut one, &robot), "after a reset");
    let fresh = targets(&mut skill.create(&robot.description).expect("an instance"), &robot);
    assert_eq!(first, fresh, "in a fresh instance");
}

#[test]
fn a_rollout_starts_anywhere_in_the_cycle_and_names_the_network_by_hash() {
    let fixture = fixture(&model());
    let robot = robot(&fixture);
    let loaded = load(&fixture, &robot);
    let rolled = RolledSkill::from_loaded(&loaded, &robot).expect("a skill to roll out");
    let first = |phase| {
        let mut instance = rolled.instance(Some(phase), &robot).expect("an instance");
        targets(&mut instance, &robot).swap_remove(0)
    };
    assert_ne!(first(0.0), first(0.3));
    assert_eq!(first(0.3), first(0.3));
    let id = identity::skill(&rolled, None);
    assert_eq!(id.policy_sha256.as_deref(), loaded.policy.as_ref().map(PolicyNetwork::sha256));
    assert!(id.policy_sha256.is_some());
}

#[test]
fn a_network_that_says_nothing_stands_through_rollouts_and_the_runtime() {
    let mut still = model();
    let (weight, bias) = &mut still.layers[2];
    for row in weight {
        row.fill(0.0);
    }
    bias.fill(0.0);
    let fixture = fixture(&still);
    let robot = robot(&fixture);
    let rolled = RolledSkill::from_loaded(&load(&fixture, &robot), &robot).expect("a skill to roll out");
    let mut query = Query::new(TerrainKind::Flat, 0.0, 2, 1);
    query.rules.time_limit_s = 0.5;
    let samples = with_threads(2, || sample(&robot, &rolled, &query, &|| ())).expect("threads");
    for (index, sample) in samples.expect("samples").iter().enumerate() {
        assert_eq!(sample.rollout.outcome, Outcome::Timeout, "rollout {index}");
    }
    Runtime::new(load_deployment(&fixture.installation(), "alone").expect("sound")).expect("a runtime");
}

#[test]
fn the_documented_manifest_is_sound() {
    let page = std::fs::read_to_string(repository().join("docs/policies.md")).expect("the page");
    let block = page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next());
    let fixture = Fixture::new();
    fixture.write("manifests/skills/stroll.toml", block.expect("a manifest").as_bytes());
    fixture.write("skills/stroll/policy.onnx", &PolicyModel::arbitrary(&[235, 16, 12]).onnx());
    let robot = robot(&fixture);
    let loaded = load_skill(&fixture.installation(), "stroll", &robot.description, ModelPolicy::Optional);
    loaded.unwrap_or_else(|refusal| panic!("{refusal}"));
}

/// The one line with which the skill is refused.
fn refused(fixture: &Fixture, parts: &[&str]) {
    let robot = robot(fixture);
    let refusal = load_skill(&fixture.installation(), "net", &robot.description, ModelPolicy::Required);
    let line = refusal.expect_err("refused").to_string();
    assert!(!line.contains('\n') && line.len() < 600, "one readable line: {line}");
    for part in ["found ", "wanted "].iter().chain(parts) {
        assert!(line.contains(part), "{part:?} is not in: {line}");
    }
}

/// The same with `from` in the manifest replaced by `to`.
fn altered(from: &str, to: &str, parts: &[&str]) {
    let fixture = fixture(&model());
    fixture.alter(MANIFEST, from, to);
    refused(&fixture, parts);
}

#[test]
fn a_contract_that_the_robot_does_not_fit_is_refused_by_field() {
    altered("[\"RH_KFE\"", "[\"RH_KNEE\"", &[MANIFEST, "contract.joints[0]", "\"RH_KNEE\"", "LF_HAA"]);
    altered("RH_KFE = 0.8", "RH_KFE = -0.8", &[MANIFEST, "contract.action.default_position_rad.RH_KFE"]);
    altered("RH_HAA = ", "TAIL = ", &[MANIFEST, "contract.action.default_position_rad", "TAIL"]);
    altered("scale = 0.5", "scale = nan", &[MANIFEST, "contract.action.scale", "NaN"]);
    altered("[contract]", "[contract]\nrate_hz = 100", &[MANIFEST, "contract.rate_hz", "100", "50"]);
}

#[test]
fn a_contract_that_does_not_parse_is_refused_with_its_field() {
    altered("\"foot_contact\"", "\"feet\"", &[MANIFEST, "`feet`", "`foot_contact`"]);
    altered("scale = 0.5", "scale = \"half\"", &[MANIFEST, "half", "a number, or a table"]);
    altered(", period_s = 0.5", "", &[MANIFEST, "contract.observation[8].period_s", "nothing"]);
    altered("joints = [", "joint = [", &[MANIFEST, "contract.joint", "not known"]);
}

#[test]
fn a_contract_that_the_network_does_not_fit_is_refused_with_both_lengths() {
    altered(
        "  { term = \"foot_contact\" },\n",
        "",
        &[
            MANIFEST,
            "contract.observation",
            "83 values (base_linear_velocity 3",
            "87, the input of policy.onnx",
        ],
    );
    let wide = fixture(&PolicyModel::arbitrary(&[OBSERVED, 8, 13]));
    refused(&wide, &[MANIFEST, "contract.joints", "12 joints", "13, the output of policy.onnx"]);
}

#[test]
fn a_network_whose_exporter_says_otherwise_is_refused_with_both_values() {
    let mut model = model();
    model.metadata = vec![("joint_stiffness".into(), "40.0".into())];
    refused(&fixture(&model), &[MANIFEST, "contract.gains.stiffness_nm_per_rad", "found 80", "40.0"]);
    model.metadata = vec![("joint_names".into(), joints().join(","))];
    load(&fixture(&model), &robot(&fixture(&model)));
}

#[test]
fn a_policy_lacks_neither_its_contract_nor_its_network() {
    let fixture = fixture(&model());
    let text = std::fs::read_to_string(fixture.root().join(MANIFEST)).expect("the manifest");
    let (without, _) = text.split_once("[contract]").expect("a contract");
    fixture.write(MANIFEST, without.as_bytes());
    refused(&fixture, &[MANIFEST, "contract: found nothing"]);
    altered("policy = \"policy.onnx\"\n", "", &[MANIFEST, "models.policy: found nothing", "plugin onnx"]);
    altered("\"policy.onnx\"", "\"absent.onnx\"", &["skills/net/absent.onnx", "a readable file of at most"]);
    altered("[models]", "[models]\nparameters = \"a.toml\"", &[MANIFEST, "models.parameters", "a.toml"]);
}

#[test]
fn a_network_cut_short_is_refused() {
    let fixture = fixture(&model());
    let bytes = model().onnx();
    fixture.write(MODEL, &bytes[..bytes.len() / 2]);
    refused(&fixture, &[MODEL]);
}
