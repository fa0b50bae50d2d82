//! The kernel's mathematics: its outputs and every tensor's gradient against the plain f64 network.

#![expect(clippy::float_cmp, reason = "the same bits, or values that are exact")]

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::network::{PARAMETERS, TENSORS, start_values};
use super::{FieldCells, LANES, Lanes, Plane, Workspace, backward, forward, pool, reference};

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

#[test]
fn every_output_equals_the_plain_network() {
    let (fields, parameters) = (fields(1), network(2));
    let found = loaded(&fields).forward(&parameters);
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
    let (fields, parameters) = (fields(3), network(4));
    // The output weights of a fresh network are small; larger ones make every gradient matter.
    let parameters: Vec<f32> = parameters.iter().map(|p| 1.7 * p).collect();
    let d_output: [f32; LANES] = [0.7, -1.3, 0.4, 0.0, 2.1, -0.2, 1.1, 0.9];
    let mut workspace = loaded(&fields);
    workspace.forward(&parameters);
    let mut gradient = vec![0.0; PARAMETERS];
    workspace.backward(&parameters, d_output, &mut gradient);

    let mut plain: Vec<f64> = parameters.iter().map(|p| f64::from(*p)).collect();
    let loss = |plain: &[f64]| -> f64 {
        let outputs = fields.iter().map(|field| reference::forward(plain, field));
        outputs.zip(d_output).map(|(y, d)| y * f64::from(d)).sum()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for tensor in TENSORS {
        let scale = tensor.of(&gradient).iter().fold(0.0_f32, |high, g| high.max(g.abs()));
        assert!(scale > 1e-3, "{} has a gradient to compare", tensor.name);
        for _ in 0..tensor.len().min(24) {
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
    let (mut fields, parameters) = (fields(6), network(7));
    let d_output = [1.0, -1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0];
    let gradient_of = |fields: &[FieldCells; LANES]| {
        let mut workspace = loaded(fields);
        workspace.forward(&parameters);
        let mut gradient = vec![0.0; PARAMETERS];
        workspace.backward(&parameters, d_output, &mut gradient);
        gradient
    };
    let before = gradient_of(&fields);
    fields[5] = [0.9; 341];
    assert_eq!(before, gradient_of(&fields));
}

#[test]
fn a_mirrored_sample_is_the_mirrored_field() {
    let (fields, parameters) = (fields(8), network(9));
    let mirrored = fields.map(|field| std::array::from_fn(|at| field[at / 11 * 11 + 10 - at % 11]));
    let mut workspace = Workspace::default();
    for (lane, field) in fields.iter().enumerate() {
        workspace.load(lane, field, true);
    }
    assert_eq!(workspace.forward(&parameters), loaded(&mirrored).forward(&parameters));
}

#[test]
fn wide_instructions_change_no_bit() {
    let (fields, parameters) = (fields(10), network(11));
    let (mut plain, mut wide) = (loaded(&fields), loaded(&fields));
    forward(&mut plain, &parameters);
    assert_eq!(plain.output[0].0, wide.forward(&parameters));
    let (mut g_plain, mut g_wide) = (vec![0.0; PARAMETERS], vec![0.0; PARAMETERS]);
    backward(&mut plain, &parameters, [1.0; LANES], &mut g_plain);
    wide.backward(&parameters, [1.0; LANES], &mut g_wide);
    assert_eq!(g_plain, g_wide);
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
