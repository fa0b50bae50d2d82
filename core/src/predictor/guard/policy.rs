//! The same door for policy networks: one input of one row, the actions, nothing carried over.

use std::collections::BTreeMap;

use tract_onnx::pb::{self, tensor_shape_proto::dimension::Value::DimValue, type_proto::Value};

use super::{FLOAT, Fault, decode, metadata, plain, shapes};

/// Largest file, bytes; 235 values through 512-256-128 neurons take 1.2 MB.
pub(crate) const MAX_POLICY_BYTES: u64 = 8 << 20;
/// Longest observation and most actions.
const MAX_VALUES: i64 = 4096;
/// The output of a model that has several.
const ACTIONS: &str = "actions";
/// Operators that remember.
const RECURRENT: [&str; 5] = ["LSTM", "GRU", "RNN", "Scan", "Loop"];

/// A policy network that passed.
#[derive(Debug)]
pub(crate) struct PolicyFile {
    shell: pb::ModelProto,
    /// Its graph, tensors included.
    pub(crate) graph: pb::GraphProto,
    /// What its exporter says of it.
    pub(crate) metadata: BTreeMap<String, String>,
    /// Name and number of values of its input.
    pub(crate) input: (String, usize),
    /// Name and number of values of its output.
    pub(crate) output: (String, usize),
    /// The shape of every value.
    pub(crate) shapes: BTreeMap<String, Vec<usize>>,
}

impl PolicyFile {
    /// What a runtime gets of it.
    pub(crate) fn plain(&self) -> Vec<u8> {
        let ((input, values), (output, actions)) = (&self.input, &self.output);
        plain::bytes(&self.shell, &self.graph, (input, &[1, *values]), (output, &[1, *actions]))
    }
}

/// Checks that `bytes` are a feed-forward policy.
///
/// # Errors
/// The first thing that is not as it should be.
pub(crate) fn check_policy(bytes: &[u8]) -> Result<PolicyFile, Fault> {
    let (mut shell, graph) = decode(bytes, MAX_POLICY_BYTES)?;
    if let Some(node) = graph.node.iter().find(|node| RECURRENT.contains(&node.op_type.as_str())) {
        let wanted = "a feed-forward network: a policy that remembers is not run";
        return Err(Fault::new("node.op_type", &node.op_type, wanted));
    }
    let [input] = graph.input.as_slice() else {
        let names: Vec<_> = graph.input.iter().take(4).map(|value| value.name.as_str()).collect();
        let found = format!("{} ({})", graph.input.len(), names.join(", "));
        return Err(Fault::new("input", found, "the observation alone: a policy that remembers is not run"));
    };
    let input = (input.name.clone(), row(input)?);
    let output = match graph.output.as_slice() {
        [output] => output,
        several => several.iter().find(|output| output.name == ACTIONS).ok_or_else(|| {
            let names: Vec<_> = several.iter().take(4).map(|value| value.name.as_str()).collect();
            Fault::new("output", format!("{} ({})", several.len(), names.join(", ")), "one, or `actions`")
        })?,
    };
    let shapes = shapes::follow(&graph, &input.0, &[1, input.1])?;
    let output = match shapes.get(&output.name).map(Vec::as_slice) {
        Some(&[1, length]) => (output.name.clone(), length),
        found => {
            let found = format!("{}: computed as {found:?}", output.name);
            return Err(Fault::new("output", found, "[1, actions]"));
        }
    };
    for name in [&input.0, &output.0] {
        if name.is_empty() || name.contains(char::is_control) {
            return Err(Fault::new(
                "graph",
                format!("{name:?}"),
                "names of input and output without control characters",
            ));
        }
    }
    Ok(PolicyFile { metadata: metadata(&mut shell)?, shell, graph, input, output, shapes })
}

/// The number of values of an f32 input of shape `[1, n]` or `[N, n]`.
fn row(input: &pb::ValueInfoProto) -> Result<usize, Fault> {
    let wanted = || format!("f32 [1, n] with n from 1 to {MAX_VALUES}");
    let fault = |found: &str| Fault::new("input", format!("{}: {found}", input.name), wanted());
    let Some(Value::TensorType(tensor)) = input.r#type.as_ref().and_then(|kind| kind.value.as_ref()) else {
        return Err(fault("no tensor"));
    };
    if tensor.elem_type != FLOAT {
        return Err(fault(&format!("type {}", tensor.elem_type)));
    }
    let dims = tensor.shape.as_ref().map_or(&[][..], |shape| shape.dim.as_slice());
    let [batch, values] = dims else {
        return Err(fault(&format!("{} dimensions", dims.len())));
    };
    match (&batch.value, &values.value) {
        (Some(DimValue(batch)), _) if *batch != 1 => Err(fault(&format!("a batch of {batch}"))),
        (_, Some(DimValue(values @ 1..=MAX_VALUES))) => Ok(*values as usize),
        (_, found) => Err(fault(&format!("{found:?} values"))),
    }
}
