//! Tensors that a model carries: the shape they declare must be the data they bring.

use std::collections::BTreeMap;

use tract_onnx::pb;

use super::{FLOAT, Fault, at_most};

/// Largest number of elements of any value.
pub(super) const MAX_ELEMENTS: usize = 1 << 20;
/// `TensorProto.DataType.INT64`.
const INT64: i32 = 7;
/// `TensorProto.DataLocation.EXTERNAL`.
const EXTERNAL: i32 = 1;

/// Shapes by name, and the values of the small integer tensors that reshape.
#[derive(Default)]
pub(super) struct Tensors {
    pub(super) shapes: BTreeMap<String, Vec<usize>>,
    pub(super) integers: BTreeMap<String, Vec<i64>>,
}

impl Tensors {
    /// Checks and keeps a tensor under `name`.
    pub(super) fn insert(&mut self, name: &str, tensor: &pb::TensorProto) -> Result<(), Fault> {
        let shape = check(name, tensor)?;
        if tensor.data_type == INT64 {
            self.integers.insert(name.to_owned(), integers(tensor));
        }
        self.define(name, shape)
    }

    /// Keeps the shape of a value.
    pub(super) fn define(&mut self, name: &str, shape: Vec<usize>) -> Result<(), Fault> {
        elements(name, shape.iter().copied())?;
        if name.is_empty() || self.shapes.insert(name.to_owned(), shape).is_some() {
            return Err(Fault::new(
                "graph",
                format!("value {name:?} without a name, or twice"),
                "each name once",
            ));
        }
        Ok(())
    }
}

/// The product of `dims`, refused above [`MAX_ELEMENTS`].
fn elements(name: &str, dims: impl Iterator<Item = usize>) -> Result<usize, Fault> {
    let mut count: usize = 1;
    for dim in dims {
        count = count.saturating_mul(dim);
    }
    if count == 0 || count > MAX_ELEMENTS {
        let found = format!("{name}: {count} elements");
        return Err(Fault::new("tensor", found, format!("1 to {MAX_ELEMENTS}")));
    }
    Ok(count)
}

fn check(name: &str, tensor: &pb::TensorProto) -> Result<Vec<usize>, Fault> {
    if tensor.data_location == Some(EXTERNAL) || !tensor.external_data.is_empty() {
        return Err(Fault::new(
            "tensor",
            format!("{name}: data in another file"),
            "data in the model itself",
        ));
    }
    if tensor.dims.len() > 8 {
        return Err(Fault::new(
            "tensor",
            format!("{name}: {} dimensions", tensor.dims.len()),
            at_most(8, ""),
        ));
    }
    let shape = tensor
        .dims
        .iter()
        .map(|&dim| usize::try_from(dim))
        .collect::<Result<Vec<_>, _>>()
        .map_err(|_| Fault::new("tensor", format!("{name}: {:?}", tensor.dims), "positive dimensions"))?;
    let count = elements(name, shape.iter().copied())?;
    let (carried, size) = match tensor.data_type {
        FLOAT => (tensor.float_data.len(), 4),
        INT64 => (tensor.int64_data.len(), 8),
        other => {
            return Err(Fault::new("tensor", format!("{name}: type {other}"), "f32 (1) or i64 (7)"));
        }
    };
    let fits = if tensor.raw_data.is_empty() {
        carried == count
    } else {
        carried == 0 && tensor.raw_data.len() == count * size
    };
    if !fits {
        let found = format!("{name}: {:?} with {} values, {} bytes", shape, carried, tensor.raw_data.len());
        return Err(Fault::new("tensor", found, format!("{count} values or {} bytes", count * size)));
    }
    let finite = tensor.data_type != FLOAT
        || tensor.float_data.iter().all(|value| value.is_finite())
            && tensor.raw_data.as_chunks().0.iter().all(|&raw| f32::from_le_bytes(raw).is_finite());
    if !finite {
        return Err(Fault::new("tensor", format!("{name}: a weight that is not a number"), "finite weights"));
    }
    Ok(shape)
}

/// The values of an f32 tensor that passed.
pub(crate) fn floats(tensor: &pb::TensorProto) -> Vec<f32> {
    if tensor.raw_data.is_empty() {
        return tensor.float_data.clone();
    }
    tensor.raw_data.as_chunks().0.iter().map(|&raw| f32::from_le_bytes(raw)).collect()
}

fn integers(tensor: &pb::TensorProto) -> Vec<i64> {
    if tensor.raw_data.is_empty() {
        return tensor.int64_data.clone();
    }
    tensor.raw_data.as_chunks().0.iter().map(|&raw| i64::from_le_bytes(raw)).collect()
}
