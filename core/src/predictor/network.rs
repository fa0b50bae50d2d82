//! A predictor of the method's shape for tests: conv 1→4, conv 4→8, max-pool 2, conv 8→8, fully
//! connected 128, 128, 1, written as ONNX and, for parity, computed here in plain loops.

use prost::Message;
use tract_onnx::pb::{
    AttributeProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, TensorProto, TensorShapeProto,
    TypeProto, ValueInfoProto, tensor_shape_proto, type_proto,
};

use super::Quantity;
use crate::heightfield::{COLUMNS, Field, ROWS};

/// Weights by layer: `[out][in][3][3]` or `[out][in]`, row-major, and the bias.
pub(crate) struct Network {
    pub(crate) quantity: Quantity,
    pub(crate) layers: Vec<(Vec<i64>, Vec<f32>, Vec<f32>)>,
}

impl Network {
    /// Small weights from a fixed sequence, no two alike, so that a swapped axis cannot pass.
    pub(crate) fn arbitrary(quantity: Quantity) -> Self {
        let mut state = 12345_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 8_388_608.0 - 1.0
        };
        let shapes: [&[i64]; 6] =
            [&[4, 1, 3, 3], &[8, 4, 3, 3], &[8, 8, 3, 3], &[128, 600], &[128, 128], &[1, 128]];
        let layers = shapes.map(|shape| {
            let fan_in: i64 = shape[1..].iter().product();
            let scale = (6.0 / fan_in as f32).sqrt();
            let weights = (0..shape.iter().product()).map(|_| next() * scale).collect();
            (shape.to_vec(), weights, (0..shape[0]).map(|_| 0.1 * next()).collect())
        });
        Self { quantity, layers: layers.into() }
    }

    /// A network that answers `value` (before the sigmoid) whatever it sees.
    pub(crate) fn constant(quantity: Quantity, value: f32) -> Self {
        let mut network = Self::arbitrary(quantity);
        if let Some((_, weights, bias)) = network.layers.last_mut() {
            weights.fill(0.0);
            bias.fill(value);
        }
        network
    }

    /// The same computation in plain loops, f64.
    pub(crate) fn forward(&self, field: &Field) -> f32 {
        let mut x: Vec<f64> = field.as_slice().iter().map(|&h| f64::from(h)).collect();
        let mut size = [ROWS, COLUMNS];
        for (index, (shape, weights, bias)) in self.layers[..3].iter().enumerate() {
            x = conv(&x, size, shape, weights, bias);
            if index == 1 {
                x = max_pool(&x, &mut size);
            }
        }
        for (index, (shape, weights, bias)) in self.layers[3..].iter().enumerate() {
            x = (0..shape[0] as usize)
                .map(|out| {
                    let row = &weights[out * x.len()..][..x.len()];
                    let sum = row.iter().zip(&x).map(|(&w, x)| f64::from(w) * x).sum::<f64>();
                    let sum = sum + f64::from(bias[out]);
                    if index < 2 { sum.max(0.0) } else { sum }
                })
                .collect();
        }
        match self.quantity {
            Quantity::Viability => (1.0 / (1.0 + (-x[0]).exp())) as f32,
            Quantity::Cot => x[0] as f32,
        }
    }

    /// The model, ready to be spoiled by a test.
    pub(crate) fn model(&self) -> ModelProto {
        let mut graph = GraphProto { name: "predictor".into(), ..GraphProto::default() };
        let mut value = "heightfield".to_owned();
        let mut step =
            |graph: &mut GraphProto, op: &str, weights: &[String], attributes: Vec<AttributeProto>| {
                let output = format!("{}_{}", op.to_lowercase(), graph.node.len());
                let input = std::iter::once(std::mem::replace(&mut value, output.clone()));
                graph.node.push(NodeProto {
                    name: output.clone(),
                    op_type: op.into(),
                    input: input.chain(weights.iter().cloned()).collect(),
                    output: vec![output],
                    attribute: attributes,
                    ..NodeProto::default()
                });
            };
        for (index, (shape, weights, bias)) in self.layers.iter().enumerate() {
            let names = [format!("w{index}"), format!("b{index}")];
            graph.initializer.push(tensor(&names[0], shape, weights));
            graph.initializer.push(tensor(&names[1], &shape[..1], bias));
            if index < 3 {
                step(&mut graph, "Conv", &names, vec![ints("kernel_shape", &[3, 3]), ints("pads", &[1; 4])]);
            } else {
                step(&mut graph, "Gemm", &names, vec![int("transB", 1)]);
            }
            if index < 5 {
                step(&mut graph, "Relu", &[], vec![]);
            }
            if index == 1 {
                let attributes = vec![ints("kernel_shape", &[2, 2]), ints("strides", &[2, 2])];
                step(&mut graph, "MaxPool", &[], attributes);
            }
            if index == 2 {
                step(&mut graph, "Flatten", &[], vec![int("axis", 1)]);
            }
        }
        let last = if self.quantity == Quantity::Viability { "Sigmoid" } else { "Identity" };
        step(&mut graph, last, &[], vec![]);
        let name = self.quantity.output().to_owned();
        if let Some(node) = graph.node.last_mut() {
            node.output = vec![name.clone()];
        }
        graph.input.push(value_info("heightfield", &[1, 31, 11]));
        graph.output.push(value_info(&name, &[1]));
        ModelProto {
            ir_version: 8,
            opset_import: vec![OperatorSetIdProto { domain: String::new(), version: 17 }],
            graph: Some(graph),
            ..ModelProto::default()
        }
    }

    /// The file's bytes.
    pub(crate) fn onnx(&self) -> Vec<u8> {
        self.model().encode_to_vec()
    }
}

fn conv(x: &[f64], [rows, columns]: [usize; 2], shape: &[i64], weights: &[f32], bias: &[f32]) -> Vec<f64> {
    let inputs = shape[1] as usize;
    let at = |channel: usize, i: usize, j: usize| {
        // Rows and columns are counted from 1 so that the padding is 0 and the far edge.
        let inside = (1..=rows).contains(&i) && (1..=columns).contains(&j);
        if inside { x[(channel * rows + i - 1) * columns + j - 1] } else { 0.0 }
    };
    let mut out = Vec::new();
    for (o, &bias) in bias.iter().enumerate() {
        for i in 0..rows {
            for j in 0..columns {
                let mut sum = f64::from(bias);
                for c in 0..inputs {
                    for k in 0..9 {
                        let weight = f64::from(weights[(o * inputs + c) * 9 + k]);
                        sum += weight * at(c, i + k / 3, j + k % 3);
                    }
                }
                out.push(sum.max(0.0));
            }
        }
    }
    out
}

fn max_pool(x: &[f64], size: &mut [usize; 2]) -> Vec<f64> {
    let [rows, columns] = *size;
    let mut out = Vec::new();
    for channel in x.chunks(rows * columns) {
        for i in 0..rows / 2 {
            for j in 0..columns / 2 {
                let at = |di, dj| channel[(2 * i + di) * columns + 2 * j + dj];
                out.push(at(0, 0).max(at(0, 1)).max(at(1, 0)).max(at(1, 1)));
            }
        }
    }
    *size = [rows / 2, columns / 2];
    out
}

fn tensor(name: &str, dims: &[i64], values: &[f32]) -> TensorProto {
    TensorProto {
        name: name.into(),
        dims: dims.to_vec(),
        data_type: 1,
        raw_data: values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        ..TensorProto::default()
    }
}

pub(crate) fn int(name: &str, i: i64) -> AttributeProto {
    AttributeProto { name: name.into(), r#type: 2, i, ..AttributeProto::default() }
}

pub(crate) fn ints(name: &str, ints: &[i64]) -> AttributeProto {
    AttributeProto { name: name.into(), r#type: 7, ints: ints.to_vec(), ..AttributeProto::default() }
}

/// An f32 tensor with an open batch dimension before `dims`.
pub(crate) fn value_info(name: &str, dims: &[i64]) -> ValueInfoProto {
    use tensor_shape_proto::{Dimension, dimension::Value};
    let dim = |value| Dimension { value: Some(value), ..Dimension::default() };
    let mut shape = vec![dim(Value::DimParam("N".into()))];
    shape.extend(dims.iter().map(|&size| dim(Value::DimValue(size))));
    let tensor = type_proto::Tensor { elem_type: 1, shape: Some(TensorShapeProto { dim: shape }) };
    let kind = TypeProto { value: Some(type_proto::Value::TensorType(tensor)), ..TypeProto::default() };
    ValueInfoProto { name: name.into(), r#type: Some(kind), ..ValueInfoProto::default() }
}
