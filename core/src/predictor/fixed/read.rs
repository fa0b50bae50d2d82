//! Which guarded graphs are the network of the method, and their weights.

use std::collections::BTreeMap;

use tract_onnx::pb;

use super::conv::Convolution;
use super::conv::{MARGIN, STRIDE};
use super::dense::Dense;
use super::{FLAT, FixedNetwork, HIDDEN, POOLED_COLUMNS, POOLED_ROWS};
use crate::predictor::guard::floats;

/// Operators in order; the sigmoid, or an identity in its place, may follow.
const LINE: [&str; 13] = [
    "Conv", "Relu", "Conv", "Relu", "MaxPool", "Conv", "Relu", "Flatten", "Gemm", "Relu", "Gemm", "Relu",
    "Gemm",
];

impl FixedNetwork {
    /// The network of a graph that the guard has passed; none when it is any other.
    pub(in crate::predictor) fn of(graph: &pb::GraphProto, input: &str, output: &str) -> Option<Self> {
        let tensors: BTreeMap<&str, &pb::TensorProto> =
            graph.initializer.iter().map(|tensor| (tensor.name.as_str(), tensor)).collect();
        let (line, rest) = graph.node.split_at_checked(LINE.len())?;
        let has_sigmoid = match rest {
            [] => false,
            [last] if last.op_type == "Sigmoid" => true,
            [last] if last.op_type == "Identity" => false,
            _ => return None,
        };
        let mut at = input;
        for (index, node) in graph.node.iter().enumerate() {
            let wanted = LINE.get(index).copied();
            // A reshape that the guard has passed can only flatten here: its output is what fc1 takes.
            let is_wanted =
                wanted.is_none_or(|op| node.op_type == op || (op == "Flatten" && node.op_type == "Reshape"));
            if !is_wanted || node.input.first().map(String::as_str) != Some(at) {
                return None;
            }
            at = node.output.first()?;
        }
        if at != output {
            return None;
        }
        let [conv1, _, conv2, _, pool, conv3, _, _, fc1, _, fc2, _, out] = line else { return None };
        if !is_pool(pool) {
            return None;
        }
        let layer = |node: &pb::NodeProto, shape: &[i64]| layer(&tensors, node, shape);
        let gemm = |node: &pb::NodeProto, outputs: usize, inputs: usize| {
            fully_connected(&tensors, node, outputs, inputs)
        };
        let [one, two, three] = [(conv1, 4, 1), (conv2, 8, 4), (conv3, 8, 8)]
            .map(|(node, outputs, inputs)| is_conv(node).then(|| layer(node, &[outputs, inputs, 3, 3]))?);
        let ((w1, b1), (w2, b2), (w3, b3)) = (one?, two?, three?);
        let (out_weight, out_bias) = gemm(out, 1, HIDDEN)?;
        Some(Self {
            conv1: Convolution::new(&w1, &b1)?,
            conv2: Convolution::new(&w2, &b2)?,
            conv3: Convolution::new(&w3, &b3)?,
            fc1: dense(&lanes_of_a_plane(), gemm(fc1, HIDDEN, FLAT)?)?,
            fc2: dense(&std::array::from_fn::<_, HIDDEN, _>(|lane| lane), gemm(fc2, HIDDEN, HIDDEN)?)?,
            out_weight: out_weight.try_into().ok()?,
            out_bias: *out_bias.first()?,
            has_sigmoid,
        })
    }
}

/// Where the cells of a pooled plane lie, in the order in which they are flattened.
fn lanes_of_a_plane() -> [usize; POOLED_ROWS * POOLED_COLUMNS] {
    std::array::from_fn(|cell| MARGIN + cell / POOLED_COLUMNS * STRIDE + cell % POOLED_COLUMNS)
}

fn dense<const PLANES: usize>(
    lanes: &[usize],
    (weight, bias): (Vec<f32>, Vec<f32>),
) -> Option<Dense<PLANES>> {
    let bias: [f32; HIDDEN] = bias.try_into().ok()?;
    let inputs = PLANES * lanes.len();
    Some(Dense::new(lanes, |output, input| weight[output * inputs + input], &bias))
}

/// Weight of `shape`, and bias, of a layer.
fn layer(
    tensors: &BTreeMap<&str, &pb::TensorProto>,
    node: &pb::NodeProto,
    shape: &[i64],
) -> Option<(Vec<f32>, Vec<f32>)> {
    let [_, weight, bias] = node.input.as_slice() else { return None };
    let (weight, bias) = (tensors.get(weight.as_str())?, tensors.get(bias.as_str())?);
    let fits = weight.dims == shape && bias.dims == shape[..1];
    fits.then(|| (floats(weight), floats(bias)))
}

/// Weight `[outputs][inputs]` and bias of a layer, however the file turns them.
fn fully_connected(
    tensors: &BTreeMap<&str, &pb::TensorProto>,
    node: &pb::NodeProto,
    outputs: usize,
    inputs: usize,
) -> Option<(Vec<f32>, Vec<f32>)> {
    let plain = node.attribute.iter().all(|attribute| match attribute.name.as_str() {
        "alpha" | "beta" => attribute.f == 1.0,
        "transA" => attribute.i == 0,
        "transB" => attribute.i == 1,
        _ => false,
    });
    let is_turned = node.attribute.iter().any(|attribute| attribute.name == "transB");
    (plain && is_turned).then(|| layer(tensors, node, &[outputs as i64, inputs as i64]))?
}

/// 3×3, stride 1, padding 1.
fn is_conv(node: &pb::NodeProto) -> bool {
    node.attribute.iter().any(|attribute| attribute.name == "pads")
        && node.attribute.iter().all(|attribute| match attribute.name.as_str() {
            "kernel_shape" => attribute.ints == [3, 3],
            "pads" => attribute.ints == [1; 4],
            "strides" | "dilations" => attribute.ints == [1, 1],
            "group" => attribute.i == 1,
            "auto_pad" => attribute.s == b"NOTSET",
            _ => false,
        })
}

/// 2×2, stride 2, an odd rest left out.
fn is_pool(node: &pb::NodeProto) -> bool {
    let has = |name: &str| node.attribute.iter().any(|attribute| attribute.name == name);
    has("kernel_shape")
        && has("strides")
        && node.attribute.iter().all(|attribute| match attribute.name.as_str() {
            "kernel_shape" | "strides" => attribute.ints == [2, 2],
            "pads" => attribute.ints == [0; 4],
            "dilations" => attribute.ints == [1, 1],
            "ceil_mode" | "storage_order" => attribute.i == 0,
            "auto_pad" => attribute.s == b"NOTSET",
            _ => false,
        })
}
