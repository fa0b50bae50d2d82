//! The kernel's mathematics: its outputs and every tensor's gradient against the plain f64 network.

#![expect(clippy::float_cmp, reason = "the same bits, or values that are exact")]
#![expect(clippy::large_stack_arrays, reason = "a few tiles of fields")]

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::network::{TENSORS, start_values};
use super::super::sgd::{Example, Head, Sgd};
use super::{
    Backward, FieldCells, Forward, HIDDEN, LANES, Lanes, Layer, LinearGradient, Plane, Rows, Workspace, pool,
    reference,
};
use vocaloco_core::simd::{Job, Simd, on_each, on_widest};

/// Fields with structure in both axes, so that a mirrored or shifted one cannot pass.
fn fields(seed: u64) -> [FieldCells; LANES] {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    std::array::from_fn(|_| {
        let slope = rng.random_range(-0.5_f32..0.5);
        std::array::from_fn(|at| {
            let (i, j) = (at / 11, at % 11);
            slope * (i as f32 - 15.0) / 10.0 + 0.05 * j as f32 + rng.random_range(-0.3_f32..0.3)
        })
    })
}

fn network(seed: u64) -> Vec<f32> {
    start_values(&mut ChaCha8Rng::seed_from_u64(seed))
}

fn loaded(fields: &[FieldCells; LANES]) -> Workspace {
    let mut workspace = Workspace::default();
    for (lane, field) in fields.iter().enumerate() {
        workspace.load(lane, field, false);
    }
    workspace
}

fn forward(workspace: &mut Workspace, parameters: &[f32]) -> [f32; LANES] {
    on_widest(Forward { workspace, parameters })
}

/// Fields with labels that no fresh network answers.
fn batch(fields: &[FieldCells]) -> Vec<Example<'_>> {
    let labels = [0.7, -1.3, 0.4, 0.1, 2.1, -0.2, 1.1, 0.9, -0.6];
    let example = |(field, label)| Example { field, label, mirrored: false };
    fields.iter().zip(labels.into_iter().cycle()).map(example).collect()
}

#[test]
fn every_output_equals_the_plain_network() {
    let (fields, parameters) = (fields(1), network(2));
    let found = forward(&mut loaded(&fields), &parameters);
    let parameters: Vec<f64> = parameters.iter().map(|p| f64::from(*p)).collect();
    for (lane, field) in fields.iter().enumerate() {
        let wanted = reference::forward(&parameters, field);
        assert!(
            (f64::from(found[lane]) - wanted).abs() < 1e-6,
            "lane {lane}: {} against {wanted}",
            found[lane]
        );
    }
}

#[test]
fn every_tensor_s_gradient_equals_the_finite_difference() {
    // More than a tile, and neither tiles nor groups come out even.
    let (fields, parameters) = ([fields(3), fields(13)].concat(), network(4));
    let batch = &batch(&fields)[..29];
    // The output weights of a fresh network are small; larger ones make every gradient matter.
    let parameters: Vec<f32> = parameters.iter().map(|p| 1.7 * p).collect();
    let gradient = Sgd::default().gradient(&parameters, Head::Linear, batch);

    let mut plain: Vec<f64> = parameters.iter().map(|p| f64::from(*p)).collect();
    let loss = |plain: &[f64]| -> f64 {
        let error =
            |example: &Example<'_>| reference::forward(plain, example.field) - f64::from(example.label);
        batch.iter().map(|example| error(example).powi(2)).sum::<f64>() / batch.len() as f64
    };
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for tensor in TENSORS {
        let scale = tensor.of(&gradient).iter().fold(0.0_f32, |high, g| high.max(g.abs()));
        assert!(scale > 1e-3, "{} has a gradient to compare", tensor.name);
        for _ in 0..tensor.len().min(16) {
            let at = tensor.start + rng.random_range(0..tensor.len());
            let (value, step) = (plain[at], 1e-6);
            plain[at] = value + step;
            let above = loss(&plain);
            plain[at] = value - step;
            let below = loss(&plain);
            plain[at] = value;
            let (wanted, found) = ((above - below) / (2.0 * step), f64::from(gradient[at]));
            assert!(
                (found - wanted).abs() < 1e-4 * f64::from(scale),
                "{}[{}]: {found} against {wanted}",
                tensor.name,
                at - tensor.start
            );
        }
    }
}

#[test]
fn an_unused_lane_leaves_no_trace_in_the_gradient() {
    let (fields, parameters) = (fields(6), network(7));
    let few = &batch(&fields)[..3];
    let mut used = Sgd::default();
    used.gradient(&parameters, Head::Linear, &batch(&[fields, fields].concat()));
    let fresh = Sgd::default().gradient(&parameters, Head::Linear, few);
    assert_eq!(used.gradient(&parameters, Head::Linear, few), fresh);
}

#[test]
fn a_mirrored_sample_is_the_mirrored_field() {
    let (fields, parameters) = (fields(8), network(9));
    let mirrored = fields.map(|field| std::array::from_fn(|at| field[at / 11 * 11 + 10 - at % 11]));
    let mut workspace = Workspace::default();
    for (lane, field) in fields.iter().enumerate() {
        workspace.load(lane, field, true);
    }
    assert_eq!(forward(&mut workspace, &parameters), forward(&mut loaded(&mirrored), &parameters));
}

/// A forward and a backward pass of one tile, and the sums behind it.
struct Whole<'a> {
    fields: &'a [FieldCells; LANES],
    parameters: &'a [f32],
}

impl Job for Whole<'_> {
    type Answer = Vec<f32>;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Vec<f32> {
        let (mut workspace, parameters) = (loaded(self.fields), self.parameters);
        let mut answer = Forward { workspace: &mut workspace, parameters }.run(simd).to_vec();
        let mut rows = Rows::default();
        let tile = rows.tiles(1).remove(0);
        Backward { workspace: &mut workspace, parameters, d_output: [1.0; LANES], rows: tile }.run(simd);
        answer.extend(workspace.gradients().iter().flatten());
        for layer in Layer::ALL {
            let outputs = if layer == Layer::Output { 1 } else { HIDDEN };
            let mut weights = vec![0.0; outputs * layer.inputs()];
            let parts = [0..8, 8..16, 16..16, 16..16];
            LinearGradient { rows: &rows, parts: &parts, layer, first: 0, weights: &mut weights }.run(simd);
            answer.extend(weights);
        }
        answer
    }
}

#[test]
fn wide_instructions_change_no_bit() {
    let (fields, parameters) = (fields(10), network(11));
    let whole = || Whole { fields: &fields, parameters: &parameters };
    let wanted = on_widest(whole());
    assert!(wanted.iter().any(|value| *value != 0.0));
    for (name, found) in on_each(whole) {
        assert_eq!(found, wanted, "{name}");
    }
}

#[test]
fn max_pooling_routes_the_gradient_to_the_first_maximum_only() {
    let mut x: Vec<Plane<7, 7>> = vec![[[Lanes::ZERO; 7]; 7]; 1];
    let mut y: Vec<Plane<4, 4>> = vec![[[Lanes::ZERO; 4]; 4]; 1];
    // Window (0,0): lane 0 has its maximum at the lower left, lane 1 twice in the upper row.
    x[0][2][1].0[0] = 3.0;
    x[0][1][1].0[1] = 2.0;
    x[0][1][2].0[1] = 2.0;
    // The fifth row and column belong to no window.
    x[0][5][5].0[0] = 9.0;
    pool::forward(&x, &mut y);
    assert_eq!((y[0][1][1].0[0], y[0][1][1].0[1], y[0][2][2].0[0]), (3.0, 2.0, 0.0));
    let mut dy = y.clone();
    dy[0][1][1] = Lanes::splat(1.0);
    let mut dx: Vec<Plane<7, 7>> = vec![[[Lanes::ZERO; 7]; 7]; 1];
    pool::input_gradient(&x, &y, &dy, &mut dx);
    let window = |lane: usize| [(1, 1), (1, 2), (2, 1), (2, 2)].map(|(u, v)| dx[0][u][v].0[lane]);
    assert_eq!(window(0), [0.0, 0.0, 1.0, 0.0]);
    assert_eq!(window(1), [1.0, 0.0, 0.0, 0.0]);
    assert_eq!(dx[0][5][5].0[0], 0.0);
}
