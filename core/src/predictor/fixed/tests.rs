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
            assert!((found - wanted).abs() < 2e-5, "{quantity:?}, probe {probe}: {found}, {wanted}");
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
        let wanted = Forward(&fixed, &cells).run(simd::Anywhere).to_bits();
        assert_eq!(fixed.run(&cells).to_bits(), wanted, "probe {probe}");
        for (name, found) in simd::on_each(|| Forward(&fixed, &cells)) {
            assert_eq!(found.to_bits(), wanted, "probe {probe}, {name}");
        }
    }
}

/// What the forward made of eight fields when this was written: another order of summation, or another
/// rounding of the weights, is another program.
#[test]
fn the_bits_of_an_answer_stay_what_they_are() {
    let fixed = fixed(&Network::arbitrary(Quantity::Cot));
    let found: [u32; 8] = std::array::from_fn(|probe| fixed.run(&probe_cells(probe)).to_bits());
    let wanted = [
        0x3e89_81a8,
        0x3e8b_9fda,
        0x3eba_cd19,
        0x3f1a_912f,
        0x3f6f_c50a,
        0x3f9e_edc7,
        0x4025_4bbe,
        0x4043_66d2,
    ];
    assert_eq!(found, wanted);
}

#[test]
fn a_weight_in_two_bytes_is_off_by_half_a_step_at_most() {
    struct Layer<'a>(&'a Dense<1>, &'a conv::Plane);
    impl Job for Layer<'_> {
        type Answer = conv::Plane;
        #[inline(always)]
        fn run<S: Simd>(self, simd: S) -> conv::Plane {
            self.0.run(simd, [self.1])
        }
    }
    // Inputs of very different weight, two without any, and every third value zero.
    let weight = |output: usize, input: usize| {
        let scale = if input % 50 == 7 { 0.0 } else { 10.0_f32.powi(input as i32 % 5 - 2) };
        scale * (((output * 37 + input * 101) % 211) as f32 / 100.0 - 1.0)
    };
    let bias = std::array::from_fn(|output| 2000.0 + output as f32);
    let lanes: Vec<usize> = (0..HIDDEN).collect();
    let layer = Dense::<1>::new(&lanes, weight, &bias);
    let x = conv::Plane(std::array::from_fn(|input| if input % 3 == 0 { 0.0 } else { 0.01 * input as f32 }));
    let y = simd::on_widest(Layer(&layer, &x));
    for (output, &found) in y.0.iter().enumerate() {
        let (mut wanted, mut bound) = (f64::from(bias[output]), 2e-3);
        for (input, &x) in x.0.iter().enumerate() {
            wanted += f64::from(weight(output, input) * x);
            let largest = (0..HIDDEN).map(|output| weight(output, input).abs()).fold(0.0, f32::max);
            bound += f64::from(largest * x / 65534.0);
        }
        let off = (f64::from(found) - wanted).abs();
        assert!(off <= bound, "output {output}: {found}, wanted {wanted} within {bound}");
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
