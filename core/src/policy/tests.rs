use prost::Message;
use tract_onnx::pb::{self, AttributeProto, GraphProto, ModelProto, NodeProto, StringStringEntryProto};
use vocaloco_plugin_api::contract::Contract;

use super::*;
use crate::predictor::network::{int, value_info};

/// A sequence of numbers from −1 to 1, no two alike.
struct Numbers(u32);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / 8_388_608.0 - 1.0
    }

    fn take(&mut self, count: usize, scale: f32) -> Vec<f32> {
        (0..count).map(|_| scale * self.next()).collect()
    }
}

/// An ONNX graph, built node by node along a line.
struct Graph {
    onnx: GraphProto,
    at: String,
    width: usize,
    numbers: Numbers,
}

impl Graph {
    fn new(inputs: usize) -> Self {
        let onnx = GraphProto {
            name: "policy".into(),
            input: vec![value_info("obs", &[inputs as i64])],
            ..GraphProto::default()
        };
        Self { onnx, at: "obs".into(), width: inputs, numbers: Numbers(7) }
    }

    fn constant(&mut self, dims: &[usize], values: Vec<f32>) -> String {
        let name = format!("c{}", self.onnx.initializer.len());
        self.onnx.initializer.push(pb::TensorProto {
            name: name.clone(),
            dims: dims.iter().map(|dim| *dim as i64).collect(),
            data_type: 1,
            float_data: values,
            ..Default::default()
        });
        name
    }

    fn node(mut self, op: &str, inputs: &[&str], attribute: Vec<AttributeProto>) -> Self {
        let output = format!("v{}", self.onnx.node.len());
        self.onnx.node.push(NodeProto {
            op_type: op.into(),
            input: inputs.iter().map(ToString::to_string).collect(),
            output: vec![output.clone()],
            attribute,
            ..NodeProto::default()
        });
        self.at = output;
        self
    }

    fn activation(self, op: &str) -> Self {
        let at = self.at.clone();
        self.node(op, &[&at], vec![])
    }

    /// An element-wise step with a constant of positive values.
    fn with(mut self, op: &str) -> Self {
        let width = self.width;
        let values = self.numbers.take(width, 0.4).iter().map(|value| 1.0 + value).collect();
        let (at, constant) = (self.at.clone(), self.constant(&[width], values));
        self.node(op, &[&at, &constant], vec![])
    }

    fn gemm(mut self, outputs: usize, transposed: bool) -> Self {
        let (at, width) = (self.at.clone(), self.width);
        let dims = if transposed { [outputs, width] } else { [width, outputs] };
        let scale = libm::sqrtf(3.0 / width as f32);
        let weights = self.numbers.take(outputs * width, scale);
        let bias = self.numbers.take(outputs, 0.1);
        let (weight, bias) = (self.constant(&dims, weights), self.constant(&[outputs], bias));
        self.width = outputs;
        self.node("Gemm", &[&at, &weight, &bias], vec![int("transB", i64::from(transposed))])
    }

    fn matmul_and_add(mut self, outputs: usize) -> Self {
        let (at, width) = (self.at.clone(), self.width);
        let weights = self.numbers.take(outputs * width, libm::sqrtf(3.0 / width as f32));
        let weight = self.constant(&[width, outputs], weights);
        self.width = outputs;
        self.node("MatMul", &[&at, &weight], vec![]).with("Add")
    }

    fn model(mut self) -> ModelProto {
        if let Some(node) = self.onnx.node.last_mut() {
            node.output = vec!["actions".into()];
        }
        self.onnx.output.push(value_info("actions", &[self.width as i64]));
        ModelProto {
            ir_version: 8,
            opset_import: vec![pb::OperatorSetIdProto { domain: String::new(), version: 17 }],
            graph: Some(self.onnx),
            ..ModelProto::default()
        }
    }

    fn bytes(self) -> Vec<u8> {
        self.model().encode_to_vec()
    }
}

/// What an exporter of the field writes: normaliser, three hidden layers with ELU, actions.
fn exported() -> Graph {
    let mut graph = Graph::new(237).with("Sub").with("Div");
    for outputs in [256, 128, 64] {
        graph = graph.gemm(outputs, true).activation("Elu");
    }
    graph.gemm(12, true)
}

fn network(bytes: &[u8]) -> PolicyNetwork {
    PolicyNetwork::from_bytes(bytes, "policy.onnx".as_ref()).unwrap()
}

fn answer(network: &PolicyNetwork, input: &[f32]) -> Vec<f32> {
    let mut output = vec![f32::NAN; network.output_len()];
    Handle::new(network).run_slices(input, &mut output).unwrap();
    output
}

fn refusal(bytes: &[u8]) -> Finding {
    PolicyNetwork::from_bytes(bytes, "policy.onnx".as_ref()).unwrap_err().0
}

#[test]
fn a_chain_answers_as_the_onnx_runtime_does() {
    let graphs = [
        exported(),
        Graph::new(5).gemm(17, false).activation("Tanh").matmul_and_add(3).activation("Sigmoid"),
        Graph::new(5).with("Mul").gemm(16, true).activation("Relu").activation("Identity").gemm(2, true),
        Graph::new(4).gemm(33, true).activation("LeakyRelu").activation("Flatten").gemm(4, false),
    ];
    for (index, graph) in graphs.into_iter().enumerate() {
        let bytes = graph.bytes();
        let network = network(&bytes);
        assert!(network.is_portable(), "graph {index} is a chain");
        let session = SharedSession::new(&guard::check_policy(&bytes).unwrap()).unwrap();
        let mut numbers = Numbers(99);
        for _ in 0..5 {
            let input = numbers.take(network.input_len(), 2.0);
            let mut wanted = vec![0.0; network.output_len()];
            session.run(&input, &mut wanted).unwrap();
            for (found, wanted) in answer(&network, &input).iter().zip(&wanted) {
                assert!((found - wanted).abs() < 1e-5, "graph {index}: {found}, wanted {wanted}");
            }
        }
    }
}

#[test]
fn a_chain_gives_the_same_bytes_on_every_machine() {
    let network = network(&exported().bytes());
    let output = answer(&network, &Numbers(5).take(237, 1.0));
    let bits: Vec<String> = output.iter().map(|value| format!("{:08x}", value.to_bits())).collect();
    assert_eq!(
        bits.join(" "),
        "befac228 3f73cfef 3f8d398a bd8bf12d bf0390b7 be3593f8 3eca2056 bfb7a217 bf2669ec befd0434 3f894ec5 bf36fe29"
    );
}

#[test]
fn what_is_no_chain_is_run_by_the_onnx_runtime() {
    let graph = Graph::new(4).gemm(4, true).activation("Tanh");
    let (first, last) = (graph.onnx.node[0].output[0].clone(), graph.at.clone());
    let bytes = graph.node("Add", &[&first, &last], vec![]).bytes();
    let network = network(&bytes);
    assert!(!network.is_portable());
    let output = answer(&network, &[0.1, -0.2, 0.3, 0.4]);
    assert!(output.iter().all(|value| value.is_finite()) && output[0] != output[1], "{output:?}");
}

#[test]
fn a_second_output_beside_the_actions_is_left_alone() {
    let mut model = exported().model();
    let graph = model.graph.as_mut().unwrap();
    let hidden = graph.node[3].output[0].clone();
    graph.output.insert(0, value_info(&hidden, &[256]));
    let with_second = network(&model.encode_to_vec());
    let input = Numbers(3).take(237, 1.0);
    assert!(with_second.is_portable() && with_second.output_len() == 12);
    assert_eq!(answer(&with_second, &input), answer(&network(&exported().bytes()), &input));
}

/// What the built-in runtime would end the process on: it is left out of what a runtime gets, or refused.
#[test]
fn what_a_runtime_stumbles_over_never_gets_there() {
    let other = |spoil: fn(&mut GraphProto)| {
        // No chain, so that the runtime computes it.
        let mut model = exported().activation("Softplus").model();
        let graph = model.graph.as_mut().unwrap();
        spoil(graph);
        PolicyNetwork::from_bytes(&model.encode_to_vec(), Path::new("policy.onnx"))
    };
    let sound = other(|_| {}).unwrap();
    let input = Numbers(3).take(237, 1.0);
    let deep: fn(&mut GraphProto) = |graph| {
        let mut inner = value_info("v8", &[12]);
        name_batch(&mut inner, &"(".repeat(2000));
        graph.value_info.push(inner);
        name_batch(&mut graph.input[0], &"-".repeat(2000));
    };
    let ghost: fn(&mut GraphProto) = |graph| graph.output.push(value_info("ghost", &[12]));
    for spoil in [deep, ghost] {
        assert_eq!(answer(&other(spoil).unwrap(), &input), answer(&sound, &input));
    }
    let error = other(|graph| {
        graph.input[0].name.push('\0');
        graph.node[0].input[0].push('\0');
    });
    let error = error.unwrap_err().to_string();
    assert!(error.contains("without control characters"), "{error}");
}

/// Names the first dimension of a value.
fn name_batch(value: &mut pb::ValueInfoProto, name: &str) {
    use pb::tensor_shape_proto::{Dimension, dimension::Value::DimParam};
    let Some(pb::type_proto::Value::TensorType(tensor)) =
        value.r#type.as_mut().and_then(|it| it.value.as_mut())
    else {
        return;
    };
    let batch = Dimension { value: Some(DimParam(name.to_owned())), ..Dimension::default() };
    tensor.shape.as_mut().unwrap().dim[0] = batch;
}

#[test]
fn handles_do_not_disturb_each_other() {
    let network = network(&exported().bytes());
    let (one, other) = (Numbers(1).take(237, 1.0), Numbers(2).take(237, 3.0));
    let alone = answer(&network, &one);
    let (mut first, mut second) = (Handle::new(&network), Handle::new(&network));
    let mut output = [vec![0.0; 12], vec![0.0; 12]];
    for _ in 0..3 {
        second.run_slices(&other, &mut output[1]).unwrap();
        first.run_slices(&one, &mut output[0]).unwrap();
        assert_eq!(output[0], alone);
    }
}

#[test]
fn a_policy_that_remembers_is_refused_in_these_words() {
    let mut model = exported().model();
    model.graph.as_mut().unwrap().input.push(value_info("h_in", &[256]));
    let finding = refusal(&model.encode_to_vec());
    assert_eq!((finding.field.as_str(), finding.found.as_str()), ("input", "2 (obs, h_in)"));
    assert!(finding.wanted.contains("remembers"), "{finding}");
    let finding = refusal(&exported().activation("LSTM").bytes());
    assert_eq!((finding.field.as_str(), finding.found.as_str()), ("node.op_type", "LSTM"));
}

#[test]
fn an_input_without_a_length_is_refused() {
    let mut model = exported().model();
    model.graph.as_mut().unwrap().input = vec![value_info("obs", &[])];
    assert_eq!(refusal(&model.encode_to_vec()).field, "input");
}

#[test]
fn a_file_cut_anywhere_is_refused_or_whole() {
    let bytes = Graph::new(5).gemm(4, true).bytes();
    for length in 0..bytes.len() {
        refusal(&bytes[..length]);
    }
}

#[test]
fn an_action_that_is_no_number_is_an_error() {
    let network = network(&Graph::new(2).gemm(2, true).bytes());
    let mut output = [0.0; 2];
    let error = Handle::new(&network).run_slices(&[f32::NAN, 0.0], &mut output).unwrap_err();
    assert!(error.message.contains("NaN"), "{error}");
    let error = Handle::new(&network).run_slices(&[0.0; 3], &mut output).unwrap_err();
    assert_eq!(error.message.as_str(), "policy input: found 3 values, wanted 2");
}

#[test]
fn an_answer_that_overflows_is_an_error_whatever_computes_it() {
    let times = |mut graph: Graph, factor: f32| {
        let (at, factor) = (graph.at.clone(), graph.constant(&[2], vec![factor; 2]));
        graph.node("Mul", &[&at, &factor], vec![])
    };
    let chain = || times(Graph::new(2), f32::MAX);
    // A value times itself leaves the line.
    let session = || Graph::new(2).node("Mul", &["obs", "obs"], vec![]);
    let graphs = [
        (chain(), true, "inf"),
        (times(chain(), 0.0), true, "NaN"),
        (session(), false, "inf"),
        (session().node("Mul", &["obs", "v0"], vec![]).node("Sub", &["v0", "v1"], vec![]), false, "NaN"),
    ];
    for (index, (graph, is_chain, found)) in graphs.into_iter().enumerate() {
        let network = network(&graph.bytes());
        assert_eq!(network.is_portable(), is_chain, "graph {index}");
        assert_eq!(answer(&network, &[1.0, 0.0])[1], 0.0, "graph {index} as long as nothing overflows");
        let error = Handle::new(&network).run_slices(&[1.0, 1e30], &mut [0.0; 2]).unwrap_err();
        let wanted = format!("policy output: found {found}, wanted finite actions");
        assert_eq!(error.message.as_str(), wanted, "graph {index}");
    }
}

const JOINTS: [&str; 12] = [
    "LF_HAA", "LF_HFE", "LF_KFE", "RF_HAA", "RF_HFE", "RF_KFE", "LH_HAA", "LH_HFE", "LH_KFE", "RH_HAA",
    "RH_HFE", "RH_KFE",
];

pub(super) fn contract() -> Contract {
    let defaults =
        JOINTS.map(|joint| format!("{joint} = {}", if joint.ends_with("KFE") { -0.8 } else { 0.1 }));
    let text = format!(
        "joints = {JOINTS:?}
         observation = [{{ term = \"base_angular_velocity\", scale = 0.25 }}, {{ term = \"joint_velocity\" }}]
         action = {{ kind = \"joint_position\", scale = 0.5, default_position_rad = {{ {} }} }}
         gains = {{ stiffness_nm_per_rad = 80, damping_nms_per_rad = 2.0 }}",
        defaults.join(", ")
    );
    toml::from_str(&text).unwrap()
}

/// The shipped robot, with room for the contract's defaults on every leg.
fn robot() -> RobotDescription {
    let mut robot = crate::runtime::fixture::robot().description.clone();
    for joint in &mut robot.joints {
        (joint.lower_rad, joint.upper_rad) = (-3.0, 3.0);
    }
    robot
}

/// Findings about `contract()` with a network of 15 values whose metadata holds this pair.
fn misfits(key: &str, value: &str) -> Vec<String> {
    let mut model = Graph::new(15).gemm(12, true).model();
    model.metadata_props = vec![StringStringEntryProto { key: key.into(), value: value.into() }];
    let network = network(&model.encode_to_vec());
    let findings = network.misfits("walk.toml".as_ref(), &contract(), &robot());
    findings.iter().map(ToString::to_string).collect()
}

#[test]
fn metadata_that_agrees_says_nothing() {
    assert_eq!(misfits("joint_names", &JOINTS.join(",")), Vec::<String>::new());
    assert_eq!(misfits("joint_stiffness", "80.0"), Vec::<String>::new());
    assert_eq!(misfits("joint_damping", &["2.0004"; 12].join(", ")), Vec::<String>::new());
    assert_eq!(misfits("observation_names", "base_ang_vel,joint_vel_rel"), Vec::<String>::new());
    assert_eq!(misfits("observation_names", "imu,joint_vel"), Vec::<String>::new());
}

#[test]
fn metadata_that_contradicts_is_refused_with_both_values() {
    let one = |key, value: &str| {
        let misfits = misfits(key, value);
        assert_eq!(misfits.len(), 1, "{misfits:?}");
        misfits[0].clone()
    };
    assert_eq!(
        one("joint_stiffness", &["80", "40"].repeat(6).join(",")),
        "walk.toml: contract.gains.stiffness_nm_per_rad.LF_HFE: found 80, wanted 40, joint_stiffness of policy.onnx"
    );
    assert_eq!(
        one("action_scale", "0.25"),
        "walk.toml: contract.action.scale.LF_HAA: found 0.5, wanted 0.25, action_scale of policy.onnx"
    );
    assert!(one("default_joint_pos", "nan").contains("wanted nan"));
    let mut swapped = JOINTS;
    swapped.swap(1, 4);
    assert!(one("joint_names", &swapped.join(",")).contains("contract.joints: found LF_HAA, LF_HFE"));
    assert_eq!(
        one("observation_names", "base_lin_vel,joint_vel"),
        "walk.toml: contract.observation[0].term: found base_angular_velocity, wanted base_lin_vel, \
         observation_names of policy.onnx"
    );
}

#[test]
fn a_contract_in_the_metadata_is_held_against_the_manifests_term_by_term() {
    let json = |spoil: fn(&mut Contract)| {
        let mut contract = contract();
        spoil(&mut contract);
        serde_json::to_string(&contract).unwrap()
    };
    assert_eq!(misfits("contract", &json(|it| it.initial_phase = 0.5)), Vec::<String>::new());
    assert_eq!(
        misfits("contract", &json(|it| it.observation[1].clip = Some(20.0))),
        ["walk.toml: contract.observation[1].clip: found null, wanted 20.0, contract of policy.onnx"]
    );
    assert_eq!(
        misfits("contract", &json(|it| it.rate_hz = 25.0)),
        ["walk.toml: contract.rate_hz: found 50.0, wanted 25.0, contract of policy.onnx"]
    );
    assert_eq!(misfits("contract", "no JSON").len(), 1);
}

#[test]
fn an_observation_or_action_of_another_length_is_refused_with_what_it_holds() {
    let network = network(&Graph::new(14).gemm(11, true).bytes());
    let findings = network.misfits("walk.toml".as_ref(), &contract(), &robot());
    assert_eq!(
        findings.iter().map(ToString::to_string).collect::<Vec<_>>(),
        [
            "walk.toml: contract.observation: found 15 values (base_angular_velocity 3, joint_velocity 12), \
             wanted 14, the input of policy.onnx",
            "walk.toml: contract.joints: found 12 joints, wanted 11, the output of policy.onnx",
        ]
    );
}
