//! ONNX files of predictors that answer the same for every field, as small as the signature allows.

use prost::Message;
use tract_onnx::pb::{
    AttributeProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, TensorProto, TensorShapeProto,
    TypeProto, ValueInfoProto, attribute_proto, tensor_shape_proto, type_proto,
};

/// `heightfield` f32 `[N, 1, 31, 11]` → `output` f32 `[N, 1]`, always `value`.
pub fn constant_model(output: &str, value: f32) -> Vec<u8> {
    constant_model_of_shape(output, value, [31, 11])
}

/// The same for a field of another shape.
pub fn constant_model_of_shape(output: &str, value: f32, [rows, columns]: [i64; 2]) -> Vec<u8> {
    let weights = vec![0.0; (rows * columns) as usize];
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
