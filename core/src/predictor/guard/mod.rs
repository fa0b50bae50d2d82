//! The door for model files: what is refused here no model runtime ever sees.
//!
//! A runtime may abort the process on a hostile file (a huge declared tensor does it in 209 bytes),
//! so the file is decoded as plain protobuf and everything that sizes memory or time is checked:
//! bytes, nodes, every tensor's declared shape against the bytes it carries, and the shape of every
//! value on the way from input to output. Only the operators of small feed-forward networks pass.

mod attributes;
mod plain;
mod policy;
mod shapes;
mod tensor;
mod wire;

use std::collections::BTreeMap;

use prost::Message;
use tract_onnx::pb::{self, type_proto, type_proto::Value};

pub(crate) use policy::{MAX_POLICY_BYTES, PolicyFile, check_policy};
pub(crate) use tensor::floats;

use super::Quantity;
use crate::heightfield::{COLUMNS, ROWS};
use crate::manifest::readable;

/// Largest file, bytes; the network of the method has 376 kB.
pub(crate) const MAX_BYTES: u64 = 2 << 20;
/// Largest number of nodes and of tensors.
const MAX_NODES: usize = 128;
/// Operator sets taken.
const OPSETS: std::ops::RangeInclusive<i64> = 9..=21;
/// `TensorProto.DataType.FLOAT`.
const FLOAT: i32 = 1;
/// Name of the input.
pub(super) const INPUT: &str = "heightfield";

/// Longest name of a hostile file that is told, characters: it may be a megabyte long.
const LONGEST_CHARS: usize = 80;

/// What is wrong with a model, without the file's name.
#[derive(Debug, PartialEq)]
pub(crate) struct Fault {
    pub(crate) field: String,
    pub(crate) found: String,
    pub(crate) wanted: String,
}

impl Fault {
    pub(crate) fn new(
        field: impl Into<String>,
        found: impl std::fmt::Display,
        wanted: impl std::fmt::Display,
    ) -> Self {
        let short = |text: String| readable(&text, LONGEST_CHARS);
        Self { field: short(field.into()), found: short(found.to_string()), wanted: wanted.to_string() }
    }
}

/// A predictor that passed.
#[derive(Debug)]
pub(super) struct PredictorFile {
    shell: pb::ModelProto,
    /// Its graph, tensors included.
    pub(super) graph: pb::GraphProto,
    /// What its exporter says of it.
    pub(super) metadata: BTreeMap<String, String>,
}

impl PredictorFile {
    /// What a runtime gets of it.
    pub(super) fn plain(&self, quantity: Quantity) -> Vec<u8> {
        plain::bytes(&self.shell, &self.graph, (INPUT, &[1, 1, ROWS, COLUMNS]), (quantity.output(), &[1, 1]))
    }
}

/// Checks that `bytes` are a predictor of `quantity`.
///
/// # Errors
/// The first thing that is not as it should be.
pub(super) fn check(bytes: &[u8], quantity: Quantity) -> Result<PredictorFile, Fault> {
    let (mut shell, graph) = decode(bytes, MAX_BYTES)?;
    signature("input", &graph.input, INPUT, &[1, 1, ROWS, COLUMNS])?;
    signature("output", &graph.output, quantity.output(), &[1, 1])?;
    let shapes = shapes::follow(&graph, INPUT, &[1, 1, ROWS, COLUMNS])?;
    match shapes.get(quantity.output()).map(Vec::as_slice) {
        Some([1, 1]) => Ok(PredictorFile { metadata: metadata(&mut shell)?, shell, graph }),
        found => {
            let found = format!("{}: computed as {found:?}", quantity.output());
            Err(Fault::new("output", found, "[1, 1] for one field"))
        }
    }
}

/// What a model's exporter says of it, by key.
fn metadata(shell: &mut pb::ModelProto) -> Result<BTreeMap<String, String>, Fault> {
    let mut metadata = BTreeMap::new();
    for entry in std::mem::take(&mut shell.metadata_props) {
        if metadata.contains_key(&entry.key) {
            return Err(Fault::new("metadata_props", format!("{} twice", entry.key), "every key once"));
        }
        metadata.insert(entry.key, entry.value);
    }
    Ok(metadata)
}

/// The model less its graph, and the graph, with what sizes them inside the bounds.
fn decode(bytes: &[u8], max_bytes: u64) -> Result<(pb::ModelProto, pb::GraphProto), Fault> {
    if bytes.len() as u64 > max_bytes {
        return Err(Fault::new("file", format!("{} bytes", bytes.len()), at_most(max_bytes, "bytes")));
    }
    wire::check(bytes)?;
    let mut model = pb::ModelProto::decode(bytes)
        .map_err(|error| Fault::new("file", error, "a whole ONNX model in protobuf"))?;
    opset(&model)?;
    if !model.functions.is_empty() || !model.training_info.is_empty() {
        return Err(Fault::new("model", "functions or training information", "a plain graph"));
    }
    let graph = model.graph.take().ok_or_else(|| Fault::new("graph", "nothing", "a graph"))?;
    counts(&graph)?;
    Ok((model, graph))
}

fn opset(model: &pb::ModelProto) -> Result<(), Fault> {
    let wanted = format!("one import of ai.onnx, version {} to {}", OPSETS.start(), OPSETS.end());
    let [set] = model.opset_import.as_slice() else {
        return Err(Fault::new("opset_import", format!("{} sets", model.opset_import.len()), wanted));
    };
    if !default_domain(&set.domain) || !OPSETS.contains(&set.version) {
        return Err(Fault::new("opset_import", format!("{:?} {}", set.domain, set.version), wanted));
    }
    Ok(())
}

fn default_domain(domain: &str) -> bool {
    domain.is_empty() || domain == "ai.onnx"
}

fn counts(graph: &pb::GraphProto) -> Result<(), Fault> {
    let most = at_most(MAX_NODES as u64, "");
    for (field, found) in [("graph.node", graph.node.len()), ("graph.initializer", graph.initializer.len())] {
        if found > MAX_NODES {
            return Err(Fault::new(field, found, most));
        }
    }
    if !graph.sparse_initializer.is_empty() {
        return Err(Fault::new("graph.sparse_initializer", graph.sparse_initializer.len(), "none"));
    }
    Ok(())
}

fn at_most(most: u64, unit: &str) -> String {
    format!("at most {most} {unit}").trim_end().to_owned()
}

/// One value of that name, f32, of that shape; the first dimension may be left open.
fn signature(field: &str, found: &[pb::ValueInfoProto], name: &str, shape: &[usize]) -> Result<(), Fault> {
    let wanted = || {
        let dims: Vec<_> = shape[1..].iter().map(usize::to_string).collect();
        format!("{name}: f32 [N,{}]", dims.join(","))
    };
    let [value] = found else {
        let names: Vec<_> = found.iter().take(4).map(|value| value.name.as_str()).collect();
        return Err(Fault::new(field, format!("{} ({})", found.len(), names.join(", ")), wanted()));
    };
    let Some(Value::TensorType(tensor)) = value.r#type.as_ref().and_then(|kind| kind.value.as_ref()) else {
        return Err(Fault::new(field, format!("{}: no tensor", value.name), wanted()));
    };
    let (fits, dims) = dimensions(tensor, shape);
    if value.name != name || tensor.elem_type != FLOAT || !fits {
        let kind =
            if tensor.elem_type == FLOAT { "f32".into() } else { format!("type {}", tensor.elem_type) };
        return Err(Fault::new(field, format!("{}: {kind} [{dims}]", value.name), wanted()));
    }
    Ok(())
}

fn dimensions(tensor: &type_proto::Tensor, shape: &[usize]) -> (bool, String) {
    use pb::tensor_shape_proto::dimension::Value::{DimParam, DimValue};
    let dims = tensor.shape.as_ref().map_or(&[][..], |shape| shape.dim.as_slice());
    let mut fits = dims.len() == shape.len();
    let mut words = Vec::new();
    for (index, dim) in dims.iter().take(8).enumerate() {
        let open = match &dim.value {
            Some(DimValue(size)) => {
                fits &= shape.get(index).is_some_and(|&wanted| i64::try_from(wanted) == Ok(*size));
                words.push(size.to_string());
                continue;
            }
            Some(DimParam(name)) => name.as_str(),
            None => "?",
        };
        fits &= index == 0;
        words.push(open.to_owned());
    }
    (fits, words.join(","))
}
