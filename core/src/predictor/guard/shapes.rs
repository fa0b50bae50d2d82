//! The shape of every value, for a batch of one.

use std::collections::BTreeMap;

use tract_onnx::pb;

use super::attributes::Attributes;
use super::tensor::Tensors;
use super::{Fault, default_domain};

/// Most multiply-adds for one prediction; the network of the method has 247 thousand.
const MAX_WORK: usize = 50_000_000;

/// Checks every tensor, follows the shapes through the graph from `input`, and gives each value's.
///
/// # Errors
/// A tensor, operator, attribute or shape that does not fit, or too much work.
pub(super) fn follow(
    graph: &pb::GraphProto,
    input: &str,
    shape: &[usize],
) -> Result<BTreeMap<String, Vec<usize>>, Fault> {
    let mut tensors = Tensors::default();
    for initializer in &graph.initializer {
        tensors.insert(&initializer.name, initializer)?;
    }
    tensors.define(input, shape.to_vec())?;
    let mut graph_shapes = Shapes { tensors, work: 0 };
    for node in &graph.node {
        graph_shapes.node(node)?;
    }
    Ok(graph_shapes.tensors.shapes)
}

struct Shapes {
    tensors: Tensors,
    work: usize,
}

impl Shapes {
    fn node(&mut self, node: &pb::NodeProto) -> Result<(), Fault> {
        let [output] = node.output.as_slice() else {
            return Err(Fault::new(&node.op_type, format!("{} outputs", node.output.len()), "one"));
        };
        if !default_domain(&node.domain) {
            return Err(Fault::new("node.domain", &node.domain, "ai.onnx"));
        }
        let mut attributes = Attributes::of(node);
        if node.op_type == "Constant" {
            let value = attributes.get("value").and_then(|attribute| attribute.t.as_ref());
            let tensor = value.ok_or_else(|| attributes.fault("value", "nothing", "a tensor"))?;
            attributes.finish()?;
            return self.tensors.insert(output, tensor);
        }
        let inputs = self.inputs(node)?;
        let shape = match (node.op_type.as_str(), inputs.as_slice()) {
            ("Relu" | "Sigmoid" | "Tanh" | "Softplus" | "Identity", [x]) => x.clone(),
            ("LeakyRelu" | "Elu", [x]) => {
                attributes.get("alpha");
                x.clone()
            }
            ("Conv", [x, weight]) => self.conv(&mut attributes, x, weight)?,
            ("Conv", [x, weight, bias]) if weight.first().is_some_and(|&out| *bias == [out]) => {
                self.conv(&mut attributes, x, weight)?
            }
            ("MaxPool" | "AveragePool", [x]) => {
                let (shape, kernel) = pool(&mut attributes, x)?;
                self.add_work(&shape, kernel);
                shape
            }
            ("Flatten", [x]) if x.len() > 1 => {
                attributes.only("axis", 1, 1)?;
                vec![x[0], x[1..].iter().product()]
            }
            ("Reshape", [x, _]) => {
                attributes.only("allowzero", 0, 0)?;
                self.reshape(x, &node.input[1])?
            }
            ("Gemm", [a, b]) => self.gemm(&mut attributes, a, b)?,
            ("Gemm", [a, b, c]) => {
                let shape = self.gemm(&mut attributes, a, b)?;
                same(node, &shape, broadcast(&shape, c))?
            }
            ("MatMul", [a, b]) => self.product(node, a, b)?,
            ("Add" | "Sub" | "Mul" | "Div", [a, b]) => {
                broadcast(a, b).ok_or_else(|| misfit(node, &inputs))?
            }
            (
                "Relu" | "Sigmoid" | "Tanh" | "Softplus" | "Identity" | "LeakyRelu" | "Elu" | "Conv"
                | "MaxPool" | "AveragePool" | "Flatten" | "Reshape" | "Gemm" | "MatMul" | "Add" | "Sub"
                | "Mul" | "Div",
                _,
            ) => return Err(misfit(node, &inputs)),
            _ => {
                let wanted = "Conv, MaxPool, AveragePool, Flatten, Reshape, Gemm, MatMul, Relu, LeakyRelu, Elu, Tanh, \
                              Sigmoid, Softplus, Identity, Add, Sub, Mul, Div or Constant";
                return Err(Fault::new("node.op_type", &node.op_type, wanted));
            }
        };
        attributes.finish()?;
        self.add_work(&shape, 1);
        if self.work > MAX_WORK {
            return Err(Fault::new(
                "graph",
                format!("{} multiply-adds", self.work),
                format!("at most {MAX_WORK}"),
            ));
        }
        self.tensors.define(output, shape)
    }

    fn inputs(&self, node: &pb::NodeProto) -> Result<Vec<Vec<usize>>, Fault> {
        let known = |name: &String| {
            self.tensors.shapes.get(name).cloned().ok_or_else(|| {
                Fault::new(format!("{}.input", node.op_type), format!("{name:?}"), "a value computed before")
            })
        };
        for (index, name) in node.input.iter().enumerate() {
            // Runtimes fold integers while they load, and end the process when one is divided by zero.
            if self.tensors.integers.contains_key(name) && (node.op_type.as_str(), index) != ("Reshape", 1) {
                let field = format!("{}.input", node.op_type);
                return Err(Fault::new(
                    field,
                    format!("{name:?}: integers"),
                    "f32; integers only shape a Reshape",
                ));
            }
        }
        if node.input.len() > 3 {
            return Err(Fault::new(&node.op_type, format!("{} inputs", node.input.len()), "at most 3"));
        }
        node.input.iter().map(known).collect()
    }

    fn conv(
        &mut self,
        attributes: &mut Attributes<'_>,
        x: &[usize],
        weight: &[usize],
    ) -> Result<Vec<usize>, Fault> {
        attributes.only("group", 1, 1)?;
        let fits = matches!((x, weight), ([1, channels, _, _], [_, taken, _, _]) if channels == taken);
        if !fits {
            let found = format!("{x:?} by {weight:?}");
            return Err(attributes.fault("W", found, "[1, C, rows, columns] by [M, C, rows, columns]"));
        }
        let kernel = [weight[2], weight[3]];
        let declared = attributes.list::<2>("kernel_shape", Some(0), 1..=31)?;
        if declared != [0, 0] && declared != kernel {
            return Err(attributes.fault(
                "kernel_shape",
                declared,
                &format!("{kernel:?}, as the weights have it"),
            ));
        }
        let [rows, columns] = window(attributes, [x[2], x[3]], kernel)?;
        let shape = vec![1, weight[0], rows, columns];
        let per_point = weight[1].saturating_mul(kernel[0]).saturating_mul(kernel[1]);
        self.add_work(&shape, per_point);
        Ok(shape)
    }

    fn gemm(
        &mut self,
        attributes: &mut Attributes<'_>,
        a: &[usize],
        b: &[usize],
    ) -> Result<Vec<usize>, Fault> {
        attributes.get("alpha");
        attributes.get("beta");
        attributes.only("transA", 0, 0)?;
        let transposed = attributes.flag("transB")?;
        match (a, b, transposed) {
            ([1, inner], [taken, out], false) | ([1, inner], [out, taken], true) if inner == taken => {
                self.add_work(&[1, *out], *inner);
                Ok(vec![1, *out])
            }
            _ => Err(attributes.fault("B", format!("{a:?} by {b:?}"), "[1, K] by [K, M]")),
        }
    }

    fn product(&mut self, node: &pb::NodeProto, a: &[usize], b: &[usize]) -> Result<Vec<usize>, Fault> {
        match (a, b) {
            ([1, inner], [taken, out]) if inner == taken => {
                self.add_work(&[1, *out], *inner);
                Ok(vec![1, *out])
            }
            _ => Err(misfit(node, &[a.to_vec(), b.to_vec()])),
        }
    }

    fn reshape(&self, x: &[usize], target: &str) -> Result<Vec<usize>, Fault> {
        let fault = |found: &dyn std::fmt::Debug| {
            Fault::new("Reshape.shape", format!("{found:?}"), format!("a constant that fits {x:?}"))
        };
        let target = self.tensors.integers.get(target).ok_or_else(|| fault(&target))?;
        let count: usize = x.iter().product();
        let mut shape = Vec::new();
        let mut open = None;
        for (index, &dim) in target.iter().take(8).enumerate() {
            shape.push(match dim {
                -1 if open.is_none() => {
                    open = Some(index);
                    1
                }
                0 => *x.get(index).ok_or_else(|| fault(target))?,
                dim => usize::try_from(dim).map_err(|_| fault(target))?,
            });
        }
        let known = shape.iter().fold(1_usize, |product, &dim| product.saturating_mul(dim));
        if let Some(index) = open {
            shape[index] = count / known;
        }
        let fits = target.len() <= 8 && shape.iter().fold(1_usize, |p, &dim| p.saturating_mul(dim)) == count;
        if fits { Ok(shape) } else { Err(fault(target)) }
    }

    fn add_work(&mut self, shape: &[usize], per_element: usize) {
        let elements = shape.iter().fold(1_usize, |product, &dim| product.saturating_mul(dim));
        self.work = self.work.saturating_add(elements.saturating_mul(per_element));
    }
}

/// Shape, and points of the window.
fn pool(attributes: &mut Attributes<'_>, x: &[usize]) -> Result<(Vec<usize>, usize), Fault> {
    for name in ["ceil_mode", "storage_order", "count_include_pad"] {
        attributes.only(name, 0, 0)?;
    }
    let kernel = attributes.list::<2>("kernel_shape", None, 1..=31)?;
    let [1, channels, rows, columns] = *x else {
        return Err(attributes.fault("X", x, "[1, C, rows, columns]"));
    };
    let [rows, columns] = window(attributes, [rows, columns], kernel)?;
    Ok((vec![1, channels, rows, columns], kernel[0].saturating_mul(kernel[1])))
}

/// Size after a sliding window with stride, padding and dilation.
fn window(
    attributes: &mut Attributes<'_>,
    size: [usize; 2],
    kernel: [usize; 2],
) -> Result<[usize; 2], Fault> {
    attributes.no_auto_pad()?;
    let strides = attributes.list::<2>("strides", Some(1), 1..=16)?;
    let dilations = attributes.list::<2>("dilations", Some(1), 1..=16)?;
    let pads = attributes.list::<4>("pads", Some(0), 0..=16)?;
    let mut out = [0; 2];
    for axis in 0..2 {
        let padded = size[axis] + pads[axis] + pads[axis + 2];
        let reach = dilations[axis].saturating_mul(kernel[axis].saturating_sub(1)).saturating_add(1);
        if kernel[axis] == 0 || reach > padded || pads[axis] >= reach || pads[axis + 2] >= reach {
            let found = format!("{kernel:?} with pads {pads:?} on {size:?}");
            return Err(attributes.fault("kernel", found, "a window that fits, padded by less than itself"));
        }
        out[axis] = (padded - reach) / strides[axis] + 1;
    }
    Ok(out)
}

/// The shape of an element-wise operation, as in numpy.
fn broadcast(a: &[usize], b: &[usize]) -> Option<Vec<usize>> {
    let rank = a.len().max(b.len());
    let dim = |shape: &[usize], index: usize| {
        (index + shape.len()).checked_sub(rank).map_or(1, |index| shape[index])
    };
    (0..rank)
        .map(|index| match (dim(a, index), dim(b, index)) {
            (x, y) if x == y || y == 1 => Some(x),
            (1, y) => Some(y),
            _ => None,
        })
        .collect()
}

fn same(node: &pb::NodeProto, shape: &[usize], found: Option<Vec<usize>>) -> Result<Vec<usize>, Fault> {
    match found {
        Some(found) if found == shape => Ok(found),
        _ => Err(misfit(node, &[shape.to_vec()])),
    }
}

fn misfit(node: &pb::NodeProto, inputs: &[Vec<usize>]) -> Fault {
    Fault::new(&node.op_type, format!("inputs {inputs:?}"), "inputs whose shapes fit the operator")
}
