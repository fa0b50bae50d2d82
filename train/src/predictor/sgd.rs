//! One step of stochastic gradient descent with momentum, on a batch split in a fixed way.
//!
//! Tiles of a batch, each computed by one thread, leave what its gradient is summed from; the sums have one
//! order, whoever computes them: the number of threads cannot change a bit.

use std::ops::Range;

use rayon::prelude::*;
use vocaloco_core::simd::on_widest;

use super::kernel::{
    Backward, CONVOLUTIONS, FieldCells, Forward, GROUP, LANES, Layer, LinearGradient, PARTS, Rows, Workspace,
};
use super::network::{PARAMETERS, TENSORS};

/// Parameters that one thread moves at a time.
const STRETCH: usize = 8192;

/// Outputs of a layer whose weights one thread sums the gradient of at a time.
const OUTPUTS: usize = 16;

/// A sample in a batch.
#[derive(Debug, Clone, Copy)]
pub struct Example<'a> {
    /// Heights, `[31][11]` row-major, metres, centred.
    pub field: &'a FieldCells,
    /// What the network should answer.
    pub label: f32,
    /// Whether left and right are exchanged first.
    pub mirrored: bool,
}

/// The function behind the last layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Head {
    /// `1 / (1 + e⁻ˣ)`: viability, a probability.
    Sigmoid,
    /// None: cost of transport.
    Linear,
}

impl Head {
    /// The network's answer for the last layer's output `x`.
    pub fn answer(self, x: f32) -> f32 {
        match self {
            Self::Sigmoid => 1.0 / (1.0 + libm::expf(-x)),
            Self::Linear => x,
        }
    }

    /// Derivative of the answer by `x`, told by the answer.
    fn slope(self, answer: f32) -> f32 {
        match self {
            Self::Sigmoid => answer * (1.0 - answer),
            Self::Linear => 1.0,
        }
    }
}

/// Step size and memory of the descent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// Learning rate.
    pub learning_rate: f32,
    /// Share of the last step that the next one keeps.
    pub momentum: f32,
}

/// The descent's state: the velocity, and the space to work in.
pub struct Sgd {
    velocity: Vec<f32>,
    gradient: Vec<f32>,
    tiles: Vec<Tile>,
    rows: Rows,
}

#[derive(Default)]
struct Tile {
    workspace: Workspace,
    squared_errors: [f64; LANES],
}

impl Default for Sgd {
    fn default() -> Self {
        Self {
            velocity: vec![0.0; PARAMETERS],
            gradient: vec![0.0; PARAMETERS],
            tiles: Vec::new(),
            rows: Rows::default(),
        }
    }
}

impl Sgd {
    /// Moves the parameters one step down the mean squared error of a batch.
    ///
    /// ```text
    /// g = ∂/∂p 1/B Σ (answer − label)²      v ← momentum·v + g      p ← p − learning_rate·v
    /// ```
    ///
    /// Returns `Σ (answer − label)²` as it was before the step. Runs on the rayon pool it is called in.
    pub fn step(&mut self, parameters: &mut [f32], head: Head, batch: &[Example<'_>], rate: Rate) -> f64 {
        let squared_error = self.sum_gradient(parameters, head, batch);
        let moved = parameters.par_chunks_mut(STRETCH).zip(self.velocity.par_chunks_mut(STRETCH));
        moved.zip(self.gradient.par_chunks(STRETCH)).for_each(|((parameters, velocity), gradient)| {
            for ((p, v), g) in parameters.iter_mut().zip(velocity).zip(gradient) {
                *v = rate.momentum * *v + g;
                *p -= rate.learning_rate * *v;
            }
        });
        squared_error
    }

    /// The gradient `g` of [`step`](Self::step), which it would follow.
    pub fn gradient(&mut self, parameters: &[f32], head: Head, batch: &[Example<'_>]) -> Vec<f32> {
        self.sum_gradient(parameters, head, batch);
        self.gradient.clone()
    }

    /// Sets `gradient`; the sum of squared errors.
    fn sum_gradient(&mut self, parameters: &[f32], head: Head, batch: &[Example<'_>]) -> f64 {
        let tiles = batch.len().div_ceil(LANES);
        if self.tiles.len() < tiles {
            self.tiles.resize_with(tiles, Tile::default);
        }
        let scale = 2.0 / batch.len() as f32;
        let rows = self.rows.tiles(tiles);
        let work = self.tiles.par_iter_mut().zip(batch.par_chunks(LANES)).zip(rows);
        work.for_each(|((tile, examples), rows)| {
            let workspace = &mut tile.workspace;
            for (lane, example) in examples.iter().enumerate() {
                workspace.load(lane, example.field, example.mirrored);
            }
            let outputs = on_widest(Forward { workspace, parameters });
            let mut d_output = [0.0; LANES];
            tile.squared_errors = [0.0; LANES];
            for (lane, (x, example)) in outputs.iter().zip(examples).enumerate() {
                let answer = head.answer(*x);
                let error = answer - example.label;
                d_output[lane] = scale * error * head.slope(answer);
                tile.squared_errors[lane] = f64::from(error) * f64::from(error);
            }
            on_widest(Backward { workspace: &mut tile.workspace, parameters, d_output, rows });
        });

        let parts = parts(batch.len());
        self.sum_convolutions(&parts);
        let Self { gradient, rows, .. } = self;
        let mut rest = &mut gradient[CONVOLUTIONS..];
        let mut jobs = Vec::new();
        for (at, layer) in Layer::ALL.into_iter().enumerate() {
            let [weights, biases] = [TENSORS[6 + 2 * at], TENSORS[7 + 2 * at]];
            let (weights, behind) = std::mem::take(&mut rest).split_at_mut(weights.len());
            let (biases, behind) = behind.split_at_mut(biases.len());
            rest = behind;
            rows.bias_gradient(&parts, layer, biases);
            let stripes = weights.chunks_mut(OUTPUTS * layer.inputs()).enumerate();
            jobs.extend(stripes.map(|(stripe, weights)| LinearGradient {
                rows,
                parts: &parts,
                layer,
                first: stripe * OUTPUTS,
                weights,
            }));
        }
        jobs.into_par_iter().for_each(on_widest);

        let errors = self.tiles[..tiles].iter().flat_map(|tile| &tile.squared_errors);
        let errors: Vec<f64> = errors.copied().collect();
        parts.iter().map(|samples| errors[samples.clone()].iter().sum::<f64>()).sum()
    }

    /// The convolutions' part of the gradient: group after group, then the parts in pairs.
    fn sum_convolutions(&mut self, parts: &[Range<usize>; PARTS]) {
        let groups: Vec<&[f32]> =
            self.tiles.iter().flat_map(|tile| tile.workspace.gradients()).map(Vec::as_slice).collect();
        let of_parts = parts.each_ref().map(|samples| {
            let mut sum = [0.0; CONVOLUTIONS];
            for group in &groups[samples.start.div_ceil(GROUP)..samples.end.div_ceil(GROUP)] {
                for (sum, g) in sum.iter_mut().zip(*group) {
                    *sum += g;
                }
            }
            sum
        });
        let [a, b, c, d] = &of_parts;
        for (at, g) in self.gradient[..CONVOLUTIONS].iter_mut().enumerate() {
            *g = (a[at] + b[at]) + (c[at] + d[at]);
        }
    }
}

/// Samples of each part of a batch: whole groups, as evenly as they go.
fn parts(samples: usize) -> [Range<usize>; PARTS] {
    let groups = samples.div_ceil(GROUP);
    let bound = |part: usize| (part * groups / PARTS * GROUP).min(samples);
    std::array::from_fn(|part| bound(part)..bound(part + 1))
}

/// The network's answers for many fields, in their order.
pub fn answers(parameters: &[f32], head: Head, fields: &[&FieldCells]) -> Vec<f32> {
    fields
        .par_chunks(32 * LANES)
        .flat_map_iter(|fields| {
            let mut workspace = Workspace::default();
            let mut answers = Vec::with_capacity(fields.len());
            for group in fields.chunks(LANES) {
                for (lane, field) in group.iter().enumerate() {
                    workspace.load(lane, field, false);
                }
                let outputs = on_widest(Forward { workspace: &mut workspace, parameters });
                answers.extend(outputs.iter().take(group.len()).map(|x| head.answer(*x)));
            }
            answers
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::predictor::network::start_values;
    use vocaloco_sim::stream::stream;

    const RATE: Rate = Rate { learning_rate: 0.005, momentum: 0.9 };

    fn fields(n: usize) -> Vec<FieldCells> {
        let mut rng = stream(11, "test/fields", &[]);
        let mut draw = || vocaloco_sim::stream::uniform(&mut rng, -1.0, 1.0);
        (0..n).map(|_| std::array::from_fn(|_| draw())).collect()
    }

    #[test]
    fn only_viability_has_a_sigmoid() {
        assert!((Head::Linear.answer(-3.5) + 3.5).abs() < 1e-9);
        assert!((Head::Sigmoid.answer(-3.5) - 0.029_312_23).abs() < 1e-7);
        assert_eq!((Head::Sigmoid.answer(-200.0), Head::Sigmoid.answer(200.0)), (0.0, 1.0));
    }

    #[test]
    fn a_step_follows_the_gradient_of_the_mean_squared_error() {
        let fields = fields(11);
        let batch: Vec<Example<'_>> = fields
            .iter()
            .enumerate()
            .map(|(k, field)| Example { field, label: k as f32 / 10.0, mirrored: false })
            .collect();
        let start = start_values(&mut stream(1, "test/start", &[]));
        let mean_squared_error = |parameters: &[f32]| -> f64 {
            let inputs: Vec<_> = fields.iter().collect();
            let errors = answers(parameters, Head::Sigmoid, &inputs);
            errors.iter().zip(&batch).map(|(y, e)| f64::from(y - e.label).powi(2)).sum::<f64>() / 11.0
        };
        let mut moved = start.clone();
        let rate = Rate { learning_rate: 2e-4, momentum: 0.0 };
        let told = Sgd::default().step(&mut moved, Head::Sigmoid, &batch, rate);
        assert!((told / 11.0 - mean_squared_error(&start)).abs() < 1e-7);
        // To first order a step of −r·g lowers the loss by r·|g|².
        let squared_gradient: f64 =
            start.iter().zip(&moved).map(|(a, b)| f64::from((a - b) / rate.learning_rate).powi(2)).sum();
        let expected = f64::from(rate.learning_rate) * squared_gradient;
        let found = mean_squared_error(&start) - mean_squared_error(&moved);
        assert!((found / expected - 1.0).abs() < 0.05, "{found} against {expected}");
    }

    #[test]
    fn the_number_of_threads_changes_no_bit() {
        let fields = fields(45);
        let batch: Vec<Example<'_>> =
            fields.iter().map(|field| Example { field, label: field[7], mirrored: field[3] > 0.0 }).collect();
        let after = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut parameters = start_values(&mut stream(2, "test/start", &[]));
            let mut sgd = Sgd::default();
            pool.install(|| {
                for _ in 0..3 {
                    sgd.step(&mut parameters, Head::Linear, &batch, RATE);
                }
            });
            parameters
        };
        assert_eq!(after(1), after(2));
    }
}
