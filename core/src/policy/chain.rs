//! A network whose values lie on one line from observation to actions: layers, activations, and
//! element-wise steps such as a normaliser's.

use std::collections::BTreeMap;

use tract_onnx::pb;

use super::dense::Dense;
use crate::predictor::guard::{PolicyFile, floats};

/// The steps, in order. Deterministic: no fused operation, transcendental functions of `libm`.
#[derive(Debug)]
pub(super) struct Chain {
    steps: Vec<Step>,
    /// The longest value on the line.
    widest: usize,
}

#[derive(Debug)]
enum Step {
    Dense(Dense),
    /// x + b.
    Add(Vec<f32>),
    /// x · b.
    Multiply(Vec<f32>),
    /// x / b.
    Divide(Vec<f32>),
    Elu(f32),
    LeakyRelu(f32),
    Relu,
    Tanh,
    Sigmoid,
}

/// A constant of the graph.
struct Constant {
    dims: Vec<usize>,
    values: Vec<f32>,
}

impl Chain {
    /// The chain of a network that is one.
    pub(super) fn of(policy: &PolicyFile) -> Option<Self> {
        let mut reader = Reader {
            constants: BTreeMap::new(),
            at: policy.input.0.clone(),
            steps: Vec::new(),
            width: policy.input.1,
            widest: policy.input.1,
        };
        for initializer in &policy.graph.initializer {
            let dims = policy.shapes.get(&initializer.name)?;
            reader.constant(&initializer.name, dims, initializer);
        }
        for node in needed(&policy.graph, &policy.output.0) {
            reader.node(node, &policy.shapes)?;
        }
        (reader.at == policy.output.0).then_some(Self { steps: reader.steps, widest: reader.widest })
    }

    /// How much working memory a run needs.
    pub(super) fn memory_len(&self) -> usize {
        2 * self.widest
    }

    /// Runs the steps; the slices have the network's lengths.
    pub(super) fn run(&self, input: &[f32], memory: &mut [f32], output: &mut [f32]) {
        let (mut now, mut next) = memory.split_at_mut(self.widest);
        let mut width = input.len();
        now[..width].copy_from_slice(input);
        for step in &self.steps {
            if let Step::Dense(dense) = step {
                dense.run(&now[..width], &mut next[..dense.outputs()]);
                width = dense.outputs();
                std::mem::swap(&mut now, &mut next);
            } else {
                step.apply(&mut now[..width]);
            }
        }
        output.copy_from_slice(&now[..width]);
    }
}

impl Step {
    fn apply(&self, values: &mut [f32]) {
        let each = |values: &mut [f32], function: &dyn Fn(f32) -> f32| {
            for value in values {
                *value = function(*value);
            }
        };
        match self {
            Self::Dense(_) => {}
            Self::Add(other) => values.iter_mut().zip(other).for_each(|(value, other)| *value += other),
            Self::Multiply(other) => values.iter_mut().zip(other).for_each(|(value, other)| *value *= other),
            Self::Divide(other) => values.iter_mut().zip(other).for_each(|(value, other)| *value /= other),
            Self::Elu(alpha) => {
                each(values, &|x| if x > 0.0 { x } else { alpha * libm::expm1f(x) });
            }
            Self::LeakyRelu(slope) => each(values, &|x| if x >= 0.0 { x } else { slope * x }),
            // Not `max`, which would hide a NaN.
            Self::Relu => each(values, &|x| if x < 0.0 { 0.0 } else { x }),
            Self::Tanh => each(values, &libm::tanhf),
            Self::Sigmoid => each(values, &|x| 1.0 / (1.0 + libm::expf(-x))),
        }
    }
}

/// The nodes that `output` depends on, in the graph's order: a second output may hang off the line.
fn needed<'a>(graph: &'a pb::GraphProto, output: &str) -> Vec<&'a pb::NodeProto> {
    let mut wanted = vec![output.to_owned()];
    let mut nodes = Vec::new();
    for node in graph.node.iter().rev() {
        if node.output.iter().any(|output| wanted.contains(output)) {
            wanted.extend(node.input.iter().cloned());
            nodes.push(node);
        }
    }
    nodes.reverse();
    nodes
}

struct Reader {
    constants: BTreeMap<String, Constant>,
    /// The value that the line has come to, and its length.
    at: String,
    width: usize,
    widest: usize,
    steps: Vec<Step>,
}

impl Reader {
    fn constant(&mut self, name: &str, dims: &[usize], tensor: &pb::TensorProto) {
        if tensor.data_type == pb::tensor_proto::DataType::Float as i32 {
            self.constants.insert(name.to_owned(), Constant { dims: dims.to_vec(), values: floats(tensor) });
        }
    }

    /// The next step; none when the node leaves the line.
    fn node(&mut self, node: &pb::NodeProto, shapes: &BTreeMap<String, Vec<usize>>) -> Option<()> {
        let output = node.output.first()?;
        let real = |name: &str, default| {
            node.attribute.iter().find(|attribute| attribute.name == name).map_or(default, |it| it.f)
        };
        if node.op_type == "Constant" {
            let value = node.attribute.iter().find_map(|attribute| attribute.t.as_ref())?;
            self.constant(output, shapes.get(output)?, value);
            return Some(());
        }
        let from = |index: usize| node.input.get(index).map(String::as_str);
        let on_line = from(0) == Some(self.at.as_str());
        let step = match node.op_type.as_str() {
            "Identity" | "Flatten" | "Reshape" if on_line => None,
            "Relu" if on_line => Some(Step::Relu),
            "Tanh" if on_line => Some(Step::Tanh),
            "Sigmoid" if on_line => Some(Step::Sigmoid),
            "Elu" if on_line => Some(Step::Elu(real("alpha", 1.0))),
            "LeakyRelu" if on_line => Some(Step::LeakyRelu(real("alpha", 0.01))),
            "Gemm" if on_line => Some(self.gemm(node, real("alpha", 1.0), real("beta", 1.0))?),
            "MatMul" if on_line => {
                let weight = self.constants.get(from(1)?)?;
                let &[inputs, outputs] = weight.dims.as_slice() else { return None };
                let values = &weight.values;
                let weight = |output, input| values[input * outputs + output];
                Some(Step::Dense(Dense::new(inputs, &vec![0.0; outputs], weight)))
            }
            "Sub" if on_line => Some(Step::Add(self.row(from(1)?)?.iter().map(|value| -value).collect())),
            "Div" if on_line => Some(Step::Divide(self.row(from(1)?)?)),
            "Add" | "Mul" => {
                let other = if on_line { from(1)? } else { from(0)? };
                // x + x and the like leave the line.
                if !on_line && from(1) != Some(self.at.as_str()) {
                    return None;
                }
                let row = self.row(other)?;
                Some(if node.op_type == "Add" { Step::Add(row) } else { Step::Multiply(row) })
            }
            _ => return None,
        };
        let &[1, width] = shapes.get(output)?.as_slice() else { return None };
        self.steps.extend(step);
        self.at.clone_from(output);
        self.width = width;
        self.widest = self.widest.max(width);
        Some(())
    }

    fn gemm(&self, node: &pb::NodeProto, alpha: f32, beta: f32) -> Option<Step> {
        let transposed =
            node.attribute.iter().any(|attribute| attribute.name == "transB" && attribute.i == 1);
        let weight = self.constants.get(node.input.get(1)?)?;
        let &[rows, columns] = weight.dims.as_slice() else { return None };
        let (inputs, outputs) = if transposed { (columns, rows) } else { (rows, columns) };
        let bias = match node.input.get(2) {
            None => vec![0.0; outputs],
            Some(name) => {
                let bias = self.constants.get(name)?;
                spread(bias, outputs)?.iter().map(|value| beta * value).collect()
            }
        };
        let values = &weight.values;
        let at = |output: usize, input: usize| {
            alpha
                * if transposed { values[output * inputs + input] } else { values[input * outputs + output] }
        };
        Some(Step::Dense(Dense::new(inputs, &bias, at)))
    }

    /// A constant operand of an element-wise step, one value for each on the line.
    fn row(&self, name: &str) -> Option<Vec<f32>> {
        spread(self.constants.get(name)?, self.width)
    }
}

/// A constant as a row of `width` values; none when it has another shape.
fn spread(constant: &Constant, width: usize) -> Option<Vec<f32>> {
    match constant.values.as_slice() {
        [value] => Some(vec![*value; width]),
        values if values.len() == width && constant.dims.last() == Some(&width) => Some(values.to_vec()),
        _ => None,
    }
}
