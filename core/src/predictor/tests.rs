use std::path::Path;

use prost::Message;
use tract_onnx::pb::{
    FunctionProto, GraphProto, ModelProto, NodeProto, SparseTensorProto, TensorProto, TrainingInfoProto,
};

use super::guard::{self, Fault};
use super::network::{Network, int, ints, value_info};
use super::*;
use crate::heightfield::{COLUMNS, Heightfield, ROWS};

/// Steps up ahead, more to the left: no axis can be mirrored or swapped unnoticed.
fn stairs() -> Field {
    let mut raw = Heightfield { cells_m: [[0.0; COLUMNS]; ROWS] };
    for (i, row) in raw.cells_m.iter_mut().enumerate() {
        for (j, height) in row.iter_mut().enumerate() {
            *height = 0.12 * (i / 4) as f32 + 0.013 * (10 - j) as f32;
        }
    }
    raw.prepare(None).unwrap()
}

fn load(bytes: &[u8], quantity: Quantity) -> Result<Predictor, ModelError> {
    Predictor::from_bytes(bytes, Path::new("skills/walk/viability.onnx"), quantity)
}

/// The fault after `spoil` has had its way with a sound viability model.
fn fault(spoil: impl FnOnce(&mut ModelProto)) -> Fault {
    let mut model = Network::arbitrary(Quantity::Viability).model();
    spoil(&mut model);
    guard::check(&model.encode_to_vec(), Quantity::Viability).unwrap_err()
}

fn graph(model: &mut ModelProto) -> &mut GraphProto {
    model.graph.as_mut().unwrap()
}

fn node<'a>(model: &'a mut ModelProto, op: &str) -> &'a mut NodeProto {
    graph(model).node.iter_mut().find(|node| node.op_type == op).unwrap()
}

#[test]
fn the_backend_computes_the_network_of_the_method_within_1e_5() {
    for quantity in [Quantity::Viability, Quantity::Cot] {
        let network = Network::arbitrary(quantity);
        let mut predictor = load(&network.onnx(), quantity).unwrap();
        let field = stairs();
        let (found, wanted) = (predictor.predict(&field).unwrap(), network.forward(&field));
        assert!((found - wanted).abs() < 1e-5, "{quantity:?} by {}: {found}, {wanted}", backend().name);
        let flat = Heightfield { cells_m: [[0.0; COLUMNS]; ROWS] }.prepare(None).unwrap();
        assert!((found - network.forward(&flat)).abs() > 1e-3, "the fixture must see the stairs");
        assert!((predictor.predict(&flat).unwrap() - network.forward(&flat)).abs() < 1e-5);
    }
}

#[test]
fn the_backend_is_named_with_its_version() {
    let backend = backend();
    assert!(["onnxruntime", "tract"].contains(&backend.name));
    assert!(backend.version.starts_with(|c: char| c.is_ascii_digit()), "{}", backend.version);
}

#[test]
fn a_hostile_file_of_a_few_hundred_bytes_is_refused_before_any_backend() {
    let huge = TensorProto {
        name: "w".into(),
        dims: vec![1 << 40, 1 << 20],
        data_type: 1,
        raw_data: vec![0; 4],
        ..TensorProto::default()
    };
    let add = NodeProto {
        op_type: "Add".into(),
        input: vec!["heightfield".into(), "w".into()],
        output: vec!["viability".into()],
        ..NodeProto::default()
    };
    let mut model = Network::arbitrary(Quantity::Viability).model();
    graph(&mut model).initializer = vec![huge];
    graph(&mut model).node = vec![add];
    let bytes = model.encode_to_vec();
    assert!(bytes.len() < 300, "{} bytes", bytes.len());
    let error = load(&bytes, Quantity::Viability).unwrap_err();
    assert_eq!(error.0.field, "tensor");
    assert!(error.to_string().starts_with("skills/walk/viability.onnx: tensor: found w:"), "{error}");
}

#[test]
fn an_overflowing_or_negative_shape_is_refused() {
    for dims in [vec![i64::MAX, i64::MAX], vec![-1, 9], vec![0, 9], vec![1; 9]] {
        let fault = fault(|model| graph(model).initializer[0].dims = dims.clone());
        assert_eq!(fault.field, "tensor", "{dims:?}: {fault:?}");
    }
}

#[test]
fn a_tensor_that_brings_other_data_than_it_declares_is_refused() {
    let spoilers: [fn(&mut TensorProto); 4] = [
        |tensor| tensor.raw_data.truncate(12),
        |tensor| tensor.float_data = vec![0.0],
        |tensor| tensor.data_location = Some(1),
        |tensor| tensor.data_type = 11,
    ];
    for (index, spoil) in spoilers.into_iter().enumerate() {
        let fault = fault(|model| spoil(&mut graph(model).initializer[2]));
        assert_eq!(fault.field, "tensor", "spoiler {index}");
    }
}

#[test]
fn a_weight_that_is_not_a_number_is_refused() {
    let fault = fault(|model| {
        graph(model).initializer[1].raw_data[..4].copy_from_slice(&f32::NAN.to_le_bytes());
    });
    assert_eq!(fault.wanted, "finite weights");
}

#[test]
fn a_truncated_model_is_refused_at_every_length() {
    let bytes = Network::arbitrary(Quantity::Cot).onnx();
    for length in (0..400).chain((400..bytes.len()).step_by(4999)) {
        let found = guard::check(&bytes[..length], Quantity::Cot);
        assert!(found.is_err(), "the first {length} of {} bytes", bytes.len());
    }
}

#[test]
fn flipped_bytes_never_bring_the_process_down() {
    let bytes = Network::arbitrary(Quantity::Viability).onnx();
    let structure: Vec<usize> = (0..900).chain(bytes.len() - 1500..bytes.len()).collect();
    let mut taken = 0;
    for &at in &structure {
        let mut spoiled = bytes.clone();
        spoiled[at] ^= 0x15;
        taken += usize::from(guard::check(&spoiled, Quantity::Viability).is_ok());
    }
    assert!(taken < structure.len(), "some of them must be refused");
}

#[test]
fn an_oversized_file_is_refused_without_reading_it_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("viability.onnx");
    std::fs::File::create(&path).unwrap().set_len(1 << 40).unwrap();
    let error = Predictor::load(&path, Quantity::Viability).unwrap_err();
    assert_eq!(error.0.wanted, "at most 2097152 bytes");
}

#[test]
fn a_missing_model_is_named() {
    let error = Predictor::load(Path::new("nowhere/cot.onnx"), Quantity::Cot).unwrap_err();
    assert!(error.to_string().starts_with("nowhere/cot.onnx: file: found "), "{error}");
}

#[test]
fn a_wrong_signature_is_refused_by_name() {
    let input = |value| fault(|model| graph(model).input = vec![value]);
    for value in [
        value_info("heightfield", &[1, 11, 31]),
        value_info("heightfield", &[31, 11]),
        value_info("heightfield", &[1, 31, 12]),
        value_info("height", &[1, 31, 11]),
    ] {
        let fault = input(value);
        assert_eq!((fault.field.as_str(), fault.wanted.as_str()), ("input", "heightfield: f32 [N,1,31,11]"));
    }
    let fault = fault(|model| graph(model).output[0].name = "cot".into());
    assert_eq!((fault.field.as_str(), fault.found.as_str()), ("output", "cot: f32 [N,1]"));
    let swapped = load(&Network::arbitrary(Quantity::Cot).onnx(), Quantity::Viability).unwrap_err();
    assert_eq!(swapped.0.field, "output");
}

#[test]
fn layers_that_do_not_fit_each_other_are_refused() {
    let fault_of = |spoil: fn(&mut ModelProto)| fault(spoil).field;
    assert_eq!(fault_of(|model| graph(model).initializer[6].dims = vec![600, 128]), "Gemm.B");
    assert_eq!(fault_of(|model| graph(model).initializer[2].dims = vec![8, 2, 6, 3]), "Conv.W");
    assert_eq!(fault_of(|model| graph(model).node.swap(3, 4)), "MaxPool.input");
    assert_eq!(
        fault_of(|model| node(model, "MaxPool").attribute[1] = ints("strides", &[0, 0])),
        "MaxPool.strides"
    );
    assert_eq!(fault_of(|model| node(model, "Conv").attribute.push(int("group", 0))), "Conv.group");
    assert_eq!(
        fault_of(|model| node(model, "Conv").attribute[1] = ints("pads", &[i64::MAX; 4])),
        "Conv.pads"
    );
    assert_eq!(fault_of(|model| node(model, "Flatten").attribute[0].i = 0), "Flatten.axis");
}

#[test]
fn an_attribute_given_twice_is_refused() {
    // The guard reads the first one, a model runtime perhaps the last.
    let fault = fault(|model| node(model, "MaxPool").attribute.push(ints("strides", &[1, 1])));
    assert_eq!((fault.field.as_str(), fault.wanted.as_str()), ("MaxPool.strides", "one"));
}

#[test]
fn a_scalar_in_any_place_is_refused_without_a_panic() {
    // A scalar is a sound bias of the fully connected layers.
    for index in [0, 1, 2, 3, 4, 5, 6, 8, 10] {
        let fault = fault(|model| {
            let tensor = &mut graph(model).initializer[index];
            tensor.dims.clear();
            tensor.raw_data = vec![0; 4];
        });
        assert!(["Conv", "Conv.W", "Gemm.B"].contains(&fault.field.as_str()), "{index}: {fault:?}");
    }
}

#[test]
fn operators_that_can_ask_for_any_memory_are_refused() {
    for op in ["ConstantOfShape", "Expand", "Tile", "Loop", "Resize", ""] {
        let fault = fault(|model| node(model, "Relu").op_type = op.into());
        assert_eq!(fault.field, "node.op_type", "{op}");
    }
    let domain = fault(|model| node(model, "Relu").domain = "com.microsoft".into());
    assert_eq!(domain.field, "node.domain");
}

#[test]
fn an_unknown_operator_set_is_refused() {
    assert_eq!(fault(|model| model.opset_import[0].version = 99).field, "opset_import");
    assert_eq!(fault(|model| model.opset_import.clear()).field, "opset_import");
}

/// Each is sound but for one thing, which no later check would refuse.
#[test]
fn whatever_is_no_small_plain_graph_of_one_operator_set_is_refused() {
    type Spoil = fn(&mut ModelProto);
    let more_nodes: Spoil = |model| {
        let nodes = &mut graph(model).node;
        let spare = |at: usize| NodeProto {
            op_type: "Relu".into(),
            input: vec!["heightfield".into()],
            output: vec![format!("spare{at}")],
            ..NodeProto::default()
        };
        nodes.extend((nodes.len()..129).map(spare));
    };
    let more_tensors: Spoil = |model| {
        let tensors = &mut graph(model).initializer;
        let spare = |at: usize| TensorProto {
            name: format!("spare{at}"),
            dims: vec![1],
            data_type: 1,
            float_data: vec![0.5],
            ..TensorProto::default()
        };
        tensors.extend((tensors.len()..129).map(spare));
    };
    let old: Spoil = |model| model.opset_import[0].version = 8;
    let twice: Spoil = |model| model.opset_import.push(model.opset_import[0].clone());
    let foreign: Spoil = |model| model.opset_import[0].domain = "com.microsoft".into();
    let sparse: Spoil = |model| graph(model).sparse_initializer.push(SparseTensorProto::default());
    let function: Spoil = |model| model.functions.push(FunctionProto::default());
    let training: Spoil = |model| model.training_info.push(TrainingInfoProto::default());
    let spoilers = [
        ("graph.node", "129", more_nodes),
        ("graph.initializer", "129", more_tensors),
        ("graph.sparse_initializer", "1", sparse),
        ("model", "functions or training information", function),
        ("model", "functions or training information", training),
        ("opset_import", "\"\" 8", old),
        ("opset_import", "2 sets", twice),
        ("opset_import", "\"com.microsoft\" 17", foreign),
    ];
    for (index, (field, found, spoil)) in spoilers.into_iter().enumerate() {
        let mut model = Network::arbitrary(Quantity::Viability).model();
        spoil(&mut model);
        let fault = guard::check(&model.encode_to_vec(), Quantity::Viability).err();
        let fault = fault.as_ref().map(|fault| (fault.field.as_str(), fault.found.as_str()));
        assert_eq!(fault, Some((field, found)), "spoiler {index}");
    }
}

#[test]
fn the_guard_takes_a_reshape_and_a_matrix_product_as_other_exporters_write_them() {
    let mut model = Network::arbitrary(Quantity::Cot).model();
    let shape = TensorProto {
        name: "shape".into(),
        dims: vec![2],
        data_type: 7,
        int64_data: vec![-1, 600],
        ..TensorProto::default()
    };
    graph(&mut model).initializer.push(shape);
    let flatten = node(&mut model, "Flatten");
    flatten.op_type = "Reshape".into();
    flatten.input.push("shape".into());
    flatten.attribute.clear();
    assert!(guard::check(&model.encode_to_vec(), Quantity::Cot).is_ok());
    let mut predictor = load(&model.encode_to_vec(), Quantity::Cot).unwrap();
    let wanted = Network::arbitrary(Quantity::Cot).forward(&stairs());
    assert!((predictor.predict(&stairs()).unwrap() - wanted).abs() < 1e-5);
}

#[test]
fn integers_are_for_shapes_alone() {
    for op in ["Div", "Add", "Identity"] {
        let fault = fault(|model| {
            let integer = |name: &str, value| TensorProto {
                name: name.into(),
                dims: vec![1],
                data_type: 7,
                int64_data: vec![value],
                ..TensorProto::default()
            };
            graph(model).initializer.extend([integer("one", 1), integer("zero", 0)]);
            let input = if op == "Identity" { vec!["one".into()] } else { vec!["one".into(), "zero".into()] };
            let output = vec!["unused".into()];
            let node = NodeProto { op_type: op.into(), input, output, ..NodeProto::default() };
            graph(model).node.insert(0, node);
        });
        assert_eq!((fault.field, fault.found), (format!("{op}.input"), "\"one\": integers".to_owned()));
    }
}

#[test]
fn pooling_counts_as_work() {
    let fault = fault(|model| {
        let graph = graph(model);
        let named = |op: &str, inputs: &[&str], output: &str| NodeProto {
            op_type: op.into(),
            input: inputs.iter().map(|&input| input.into()).collect(),
            output: vec![output.into()],
            ..NodeProto::default()
        };
        let weights = TensorProto {
            name: "wide".into(),
            dims: vec![1000, 1, 1, 1],
            data_type: 1,
            raw_data: vec![0; 4000],
            ..TensorProto::default()
        };
        let mut pool = named("MaxPool", &["spread"], "pooled");
        pool.attribute = vec![ints("kernel_shape", &[31, 11]), ints("pads", &[15, 5, 15, 5])];
        graph.initializer.push(weights);
        graph.node.splice(0..0, [named("Conv", &["heightfield", "wide"], "spread"), pool]);
    });
    assert_eq!(
        (fault.field.as_str(), fault.wanted.as_str()),
        ("graph", "at most 50000000"),
        "{}",
        fault.found
    );
}

#[test]
fn a_prediction_that_overflows_is_an_error_and_not_a_number_that_gets_out() {
    let network = Network::constant(Quantity::Cot, f32::MAX);
    let mut model = network.model();
    let last = graph(&mut model).node.last_mut().unwrap();
    last.op_type = "Add".into();
    last.input.push("b5".into());
    let error =
        load(&model.encode_to_vec(), Quantity::Cot).and_then(|mut p| p.predict(&stairs())).unwrap_err();
    assert_eq!((error.0.field.as_str(), error.0.found.as_str()), ("cot", "inf"));
}

#[test]
fn a_network_of_the_method_is_computed_here_and_any_other_by_the_runtime() {
    let network = Network::arbitrary(Quantity::Viability);
    let predictor = load(&network.onnx(), Quantity::Viability).unwrap();
    assert_eq!((predictor.runs_on(), predictor.note()), ("own forward", None));
    let mut model = network.model();
    node(&mut model, "Relu").op_type = "Tanh".into();
    let mut other = load(&model.encode_to_vec(), Quantity::Viability).unwrap();
    assert_eq!((other.runs_on(), other.note()), (backend().name, None));
    assert!((0.0..=1.0).contains(&other.predict(&stairs()).unwrap()));
}
