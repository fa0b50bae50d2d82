//! Pieces of an ONNX file: IR version 8, opset 17, the same bytes for the same pieces.

use prost::Message;
use tract_onnx::pb;

/// What a file is made of, besides its version.
pub struct Graph {
    /// Name of the graph.
    pub name: &'static str,
    /// Operators, in the order of computation.
    pub nodes: Vec<pb::NodeProto>,
    /// Weights and biases.
    pub initializers: Vec<pb::TensorProto>,
    /// What it takes.
    pub input: pb::ValueInfoProto,
    /// What it answers.
    pub output: pb::ValueInfoProto,
    /// `metadata_props`, in this order.
    pub metadata: Vec<(String, String)>,
}

impl Graph {
    /// The file's bytes.
    pub fn encode(self) -> Vec<u8> {
        let metadata = self.metadata.into_iter();
        let model = pb::ModelProto {
            ir_version: 8,
            opset_import: vec![pb::OperatorSetIdProto { domain: String::new(), version: 17 }],
            producer_name: "vocaloco-train".to_owned(),
            producer_version: env!("CARGO_PKG_VERSION").to_owned(),
            graph: Some(pb::GraphProto {
                name: self.name.to_owned(),
                node: self.nodes,
                initializer: self.initializers,
                input: vec![self.input],
                output: vec![self.output],
                ..Default::default()
            }),
            metadata_props: metadata.map(|(key, value)| pb::StringStringEntryProto { key, value }).collect(),
            ..Default::default()
        };
        model.encode_to_vec()
    }
}

/// An operator with one output.
pub fn node(op: &str, input: &[&str], output: &str, attribute: Vec<pb::AttributeProto>) -> pb::NodeProto {
    pb::NodeProto {
        name: format!("node.{output}"),
        op_type: op.to_owned(),
        input: input.iter().map(|name| (*name).to_owned()).collect(),
        output: vec![output.to_owned()],
        attribute,
        ..Default::default()
    }
}

/// `output = input · weightᵀ + bias`, with the initialisers `LAYER.weight` `[out][in]` and `LAYER.bias`.
pub fn fully_connected(layer: &str, input: &str, output: &str) -> pb::NodeProto {
    let (weight, bias) = (format!("{layer}.weight"), format!("{layer}.bias"));
    node("Gemm", &[input, &weight, &bias], output, vec![integer("transB", 1)])
}

/// An attribute that is one integer.
pub fn integer(name: &str, value: i64) -> pb::AttributeProto {
    pb::AttributeProto {
        name: name.to_owned(),
        r#type: pb::attribute_proto::AttributeType::Int.into(),
        i: value,
        ..Default::default()
    }
}

/// An attribute that is a list of integers.
pub fn integers(name: &str, values: &[i64]) -> pb::AttributeProto {
    pb::AttributeProto {
        name: name.to_owned(),
        r#type: pb::attribute_proto::AttributeType::Ints.into(),
        ints: values.to_vec(),
        ..Default::default()
    }
}

/// A float tensor with its values, row-major.
pub fn initializer(name: &str, shape: &[usize], values: &[f32]) -> pb::TensorProto {
    pb::TensorProto {
        name: name.to_owned(),
        dims: shape.iter().map(|n| *n as i64).collect(),
        data_type: pb::tensor_proto::DataType::Float.into(),
        raw_data: values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        ..Default::default()
    }
}

/// The first axis of an input or output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rows {
    /// Any number of rows, the axis `N`.
    Any,
    /// One row.
    One,
}

/// A float tensor with an axis of rows in front of `shape`.
pub fn value(name: &str, rows: Rows, shape: &[i64]) -> pb::ValueInfoProto {
    use pb::tensor_shape_proto::{Dimension, dimension::Value};
    let rows = match rows {
        Rows::Any => Value::DimParam("N".to_owned()),
        Rows::One => Value::DimValue(1),
    };
    let axes = std::iter::once(rows).chain(shape.iter().map(|n| Value::DimValue(*n)));
    let dim = axes.map(|axis| Dimension { value: Some(axis), ..Default::default() }).collect();
    pb::ValueInfoProto {
        name: name.to_owned(),
        r#type: Some(pb::TypeProto {
            value: Some(pb::type_proto::Value::TensorType(pb::type_proto::Tensor {
                elem_type: pb::tensor_proto::DataType::Float.into(),
                shape: Some(pb::TensorShapeProto { dim }),
            })),
            ..Default::default()
        }),
        ..Default::default()
    }
}
