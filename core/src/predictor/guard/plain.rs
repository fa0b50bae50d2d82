//! A checked model as a runtime gets it: what was looked at, and nothing else.
//!
//! Whatever a file says besides is left out: names of dimensions and types of inner values, which a runtime's own
//! parsers read, further outputs, words of the exporter. tract ends the process on some of it, where a guard could
//! only guess at what else it may stumble over.

use prost::Message;
use tract_onnx::pb::tensor_shape_proto::{Dimension, dimension::Value::DimValue};
use tract_onnx::pb::{GraphProto, ModelProto, TensorShapeProto, TypeProto, ValueInfoProto, type_proto};

use super::FLOAT;

/// A value of a graph: its name and shape, for a batch of one.
pub(super) type Value<'a> = (&'a str, &'a [usize]);

/// The model of `graph` from `input` to `output`; `shell` says by which operators.
pub(super) fn bytes(shell: &ModelProto, graph: &GraphProto, input: Value<'_>, output: Value<'_>) -> Vec<u8> {
    let graph = GraphProto {
        name: "network".to_owned(),
        node: graph.node.clone(),
        initializer: graph.initializer.clone(),
        input: vec![info(input)],
        output: vec![info(output)],
        ..GraphProto::default()
    };
    let model = ModelProto {
        ir_version: shell.ir_version,
        opset_import: shell.opset_import.clone(),
        graph: Some(graph),
        ..ModelProto::default()
    };
    model.encode_to_vec()
}

fn info((name, shape): Value<'_>) -> ValueInfoProto {
    let dimension = |&size: &usize| Dimension { value: Some(DimValue(size as i64)), ..Dimension::default() };
    let shape = TensorShapeProto { dim: shape.iter().map(dimension).collect() };
    let tensor = type_proto::Tensor { elem_type: FLOAT, shape: Some(shape) };
    let kind = TypeProto { value: Some(type_proto::Value::TensorType(tensor)), ..TypeProto::default() };
    ValueInfoProto { name: name.to_owned(), r#type: Some(kind), ..ValueInfoProto::default() }
}
