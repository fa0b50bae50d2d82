use super::super::evaluator::probe_cells;
use super::super::guard;
use super::super::network::{Network, int, ints};
use super::*;
use crate::heightfield::{CENTRE, Field};
use crate::predictor::Quantity;
use prost::Message;
use tract_onnx::pb::ModelProto;

fn fixed(network: &Network) -> FixedNetwork {
    of(&network.model(), network.quantity).unwrap()
}

fn of(model: &ModelProto, quantity: Quantity) -> Option<FixedNetwork> {
    let graph = guard::check(&model.encode_to_vec(), quantity).unwrap().graph;
    FixedNetwork::of(&graph, guard::INPUT, quantity.output())
}

fn field(cells: &[f32; CELLS]) -> Field {
    Field::from_slice(cells).unwrap()
}

fn graph(model: &mut ModelProto) -> &mut tract_onnx::pb::GraphProto {
    model.graph.as_mut().unwrap()
}
fn node<'a>(model: &'a mut ModelProto, op: &str) -> &'a mut tract_onnx::pb::NodeProto {
    graph(model).node.iter_mut().find(|node| node.op_type == op).unwrap()
}

#[test]
fn the_forward_is_the_method_s_network_on_every_probe() {
    for quantity in [Quantity::Viability, Quantity::Cot] {
        let network = Network::arbitrary(quantity);
        let fixed = fixed(&network);
        let mut answers = Vec::new();
        for probe in 0..8 {
            let cells = probe_cells(probe);
            let (found, wanted) = (fixed.run(&cells), network.forward(&field(&cells)));
            assert!((found - wanted).abs() < 1e-5, "{quantity:?}, probe {probe}: {found}, {wanted}");
            answers.push(found);
        }
        answers.sort_by(f32::total_cmp);
        assert!(answers.windows(2).all(|pair| pair[0] < pair[1]), "probes that look alike: {answers:?}");
    }
}

#[test]
fn wide_instructions_change_no_bit() {
    let fixed = fixed(&Network::arbitrary(Quantity::Cot));
    for probe in 0..8 {
        let cells = probe_cells(probe);
        assert_eq!(fixed.run(&cells).to_bits(), fixed.run_anywhere(&cells).to_bits(), "probe {probe}");
    }
}

#[test]
fn every_cell_counts() {
    let fixed = fixed(&Network::arbitrary(Quantity::Cot));
    let cells = probe_cells(5);
    let answer = fixed.run(&cells);
    // The pooling leaves out the last row and column, whose neighbours still see them.
    for cell in 0..CELLS {
        let mut changed = cells;
        changed[cell] += 2.0;
        assert!(fixed.run(&changed) != answer, "cell {cell}");
    }
}

#[test]
fn nan_in_any_cell_gives_nan() {
    for quantity in [Quantity::Viability, Quantity::Cot] {
        let fixed = fixed(&Network::arbitrary(quantity));
        for cell in 0..CELLS {
            let mut cells = probe_cells(3);
            cells[cell] = f32::NAN;
            assert!(fixed.run(&cells).is_nan(), "{quantity:?}, cell {cell}");
        }
    }
    assert_eq!(CENTRE, [15, 5]);
}

#[test]
fn a_network_of_another_shape_is_left_to_the_runtime() {
    let model = |spoil: fn(&mut ModelProto)| {
        let mut model = Network::arbitrary(Quantity::Viability).model();
        spoil(&mut model);
        of(&model, Quantity::Viability)
    };
    assert!(model(|_| ()).is_some());
    assert!(model(|model| node(model, "Relu").op_type = "Tanh".into()).is_none());
    assert!(model(|model| node(model, "Sigmoid").op_type = "Tanh".into()).is_none());
    assert!(model(|model| node(model, "MaxPool").op_type = "AveragePool".into()).is_none());
    // Shapes stay, weights and numbers change places.
    assert!(model(|model| node(model, "Conv").attribute[1] = ints("pads", &[2, 2, 0, 0])).is_none());
    assert!(
        model(|model| {
            let gemm = node(model, "Gemm");
            gemm.attribute.push(tract_onnx::pb::AttributeProto {
                name: "alpha".into(),
                r#type: 1,
                f: 0.5,
                ..Default::default()
            });
        })
        .is_none()
    );
    assert!(model(|model| node(model, "Conv").attribute.push(int("group", 1))).is_some());
}
