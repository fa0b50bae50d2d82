//! ONNX files for tests: predictors that answer the same for every field, and small policies.

use prost::Message;
use tract_onnx::pb::{
    AttributeProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, StringStringEntryProto,
    TensorProto, TensorShapeProto, TypeProto, ValueInfoProto, attribute_proto, tensor_shape_proto,
    type_proto,
};

/// `heightfield` f32 `[N, 1, 31, 11]` → `output` f32 `[N, 1]`, always `value`.
pub fn constant_model(output: &str, value: f32) -> Vec<u8> {
    constant_model_of_shape(output, value, [31, 11])
}

/// The same for a field of another shape.
pub fn constant_model_of_shape(output: &str, value: f32, shape: [i64; 2]) -> Vec<u8> {
    linear_model(output, 0.0, value, shape)
}

/// `value` on flat ground; anywhere else its finite weights come to no usable number.
pub fn overflowing_model(output: &str, value: f32) -> Vec<u8> {
    linear_model(output, f32::MAX, value, [31, 11])
}

/// `weight` times the sum of the cells, plus `value`.
fn linear_model(output: &str, weight: f32, value: f32, [rows, columns]: [i64; 2]) -> Vec<u8> {
    let weights = vec![weight; (rows * columns) as usize];
    let transposed = AttributeProto {
        name: "transB".into(),
        r#type: attribute_proto::AttributeType::Int as i32,
        i: 1,
        ..AttributeProto::default()
    };
    let node = |op: &str, input: &[&str], output: &str, attribute| NodeProto {
        op_type: op.into(),
        name: output.into(),
        input: input.iter().map(ToString::to_string).collect(),
        output: vec![output.into()],
        attribute,
        ..NodeProto::default()
    };
    ModelProto {
        ir_version: 8,
        opset_import: vec![OperatorSetIdProto { domain: String::new(), version: 17 }],
        graph: Some(GraphProto {
            name: "constant".into(),
            node: vec![
                node("Flatten", &["heightfield"], "flat", vec![]),
                node("Gemm", &["flat", "weights", "bias"], output, vec![transposed]),
            ],
            initializer: vec![
                tensor("weights", &[1, rows * columns], weights),
                tensor("bias", &[1], vec![value]),
            ],
            input: vec![described("heightfield", &[1, rows, columns])],
            output: vec![described(output, &[1])],
            ..GraphProto::default()
        }),
        ..ModelProto::default()
    }
    .encode_to_vec()
}

fn tensor(name: &str, dims: &[i64], float_data: Vec<f32>) -> TensorProto {
    TensorProto { name: name.into(), dims: dims.to_vec(), data_type: 1, float_data, ..TensorProto::default() }
}

/// A value of `[N, shape…]`.
fn described(name: &str, shape: &[i64]) -> ValueInfoProto {
    use tensor_shape_proto::dimension::Value;
    let dimension = |value| tensor_shape_proto::Dimension { value: Some(value), ..Default::default() };
    let dim = std::iter::once(dimension(Value::DimParam("N".into())))
        .chain(shape.iter().map(|size| dimension(Value::DimValue(*size))))
        .collect();
    let tensor = type_proto::Tensor { elem_type: 1, shape: Some(TensorShapeProto { dim }) };
    ValueInfoProto {
        name: name.into(),
        r#type: Some(TypeProto {
            value: Some(type_proto::Value::TensorType(tensor)),
            ..TypeProto::default()
        }),
        ..ValueInfoProto::default()
    }
}

/// A policy network that answers zeros, and anything else with no numbers: the weights of its first layer are the
/// largest there are, and finite.
///
/// # Panics
/// When the file is no model that begins with a layer.
pub fn overflowing_policy(onnx: &[u8]) -> Vec<u8> {
    let mut model = ModelProto::decode(onnx).expect("a model");
    let graph = model.graph.as_mut().expect("a graph");
    let layer = graph.node.iter().find(|node| node.op_type == "Gemm").expect("a layer");
    let weights = graph.initializer.iter_mut().find(|tensor| tensor.name == layer.input[1]);
    let weights = weights.expect("its weights");
    weights.float_data.iter_mut().for_each(|value| *value = f32::MAX.copysign(*value));
    for bytes in weights.raw_data.as_chunks_mut::<4>().0 {
        *bytes = f32::MAX.copysign(f32::from_le_bytes(*bytes)).to_le_bytes();
    }
    model.encode_to_vec()
}

/// A policy network of fully connected layers with ELU between them.
#[derive(Clone, Debug)]
pub struct PolicyModel {
    /// By layer: weight `[output][input]`, and bias.
    pub layers: Vec<(Vec<Vec<f32>>, Vec<f32>)>,
    /// What its exporter says of it.
    pub metadata: Vec<(String, String)>,
}

impl PolicyModel {
    /// Layers of these widths, the observation's first; small weights, no two alike.
    pub fn arbitrary(widths: &[usize]) -> Self {
        let mut state = 4321_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 8_388_608.0 - 1.0
        };
        let layer = |pair: &[usize]| {
            let scale = libm::sqrtf(1.0 / pair[0] as f32);
            let mut row = |length| (0..length).map(|_| scale * next()).collect::<Vec<_>>();
            ((0..pair[1]).map(|_| row(pair[0])).collect(), row(pair[1]))
        };
        Self { layers: widths.windows(2).map(layer).collect(), metadata: Vec::new() }
    }

    /// The actions, in plain loops and f64.
    pub fn forward(&self, observation: &[f32]) -> Vec<f32> {
        let mut x: Vec<f64> = observation.iter().map(|value| f64::from(*value)).collect();
        for (index, (weight, bias)) in self.layers.iter().enumerate() {
            let dot = |row: &Vec<f32>| row.iter().zip(&x).map(|(w, x)| f64::from(*w) * x).sum::<f64>();
            let sums = weight.iter().zip(bias).map(|(row, bias)| dot(row) + f64::from(*bias));
            let is_last = index + 1 == self.layers.len();
            x = sums.map(|sum| if is_last || sum > 0.0 { sum } else { libm::expm1(sum) }).collect();
        }
        x.iter().map(|value| *value as f32).collect()
    }

    /// The file: `obs` f32 `[N, n]` → `actions` f32 `[N, m]`.
    pub fn onnx(&self) -> Vec<u8> {
        let transposed = AttributeProto {
            name: "transB".into(),
            r#type: attribute_proto::AttributeType::Int as i32,
            i: 1,
            ..AttributeProto::default()
        };
        let (mut node, mut initializer) = (Vec::new(), Vec::new());
        let mut at = "obs".to_owned();
        for (index, (weight, bias)) in self.layers.iter().enumerate() {
            let is_last = index + 1 == self.layers.len();
            let names = [format!("w{index}"), format!("b{index}")];
            let dims = [weight.len() as i64, weight[0].len() as i64];
            initializer.push(tensor(&names[0], &dims, weight.concat()));
            initializer.push(tensor(&names[1], &dims[..1], bias.clone()));
            let [w, b] = names;
            let sum = if is_last { "actions".to_owned() } else { format!("sum{index}") };
            node.push(NodeProto {
                op_type: "Gemm".into(),
                input: vec![at.clone(), w, b],
                output: vec![sum.clone()],
                attribute: vec![transposed.clone()],
                ..NodeProto::default()
            });
            at.clone_from(&sum);
            if !is_last {
                at = format!("elu{index}");
                let (input, output) = (vec![sum], vec![at.clone()]);
                node.push(NodeProto { op_type: "Elu".into(), input, output, ..NodeProto::default() });
            }
        }
        let (inputs, outputs) = (self.layers[0].0[0].len(), self.layers[self.layers.len() - 1].1.len());
        let entry = |(key, value): &(String, String)| StringStringEntryProto {
            key: key.clone(),
            value: value.clone(),
        };
        ModelProto {
            ir_version: 8,
            opset_import: vec![OperatorSetIdProto { domain: String::new(), version: 17 }],
            graph: Some(GraphProto {
                name: "policy".into(),
                node,
                initializer,
                input: vec![described("obs", &[inputs as i64])],
                output: vec![described("actions", &[outputs as i64])],
                ..GraphProto::default()
            }),
            metadata_props: self.metadata.iter().map(entry).collect(),
            ..ModelProto::default()
        }
        .encode_to_vec()
    }
}
