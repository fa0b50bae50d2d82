//! One step of stochastic gradient descent with momentum, on a batch split in a fixed way.
//!
//! A batch becomes groups of eight samples, the groups up to four chunks, each summed by one thread,
//! and the chunks are added in order: the number of threads cannot change a bit.

use rayon::prelude::*;

use super::kernel::{FieldCells, LANES, Workspace};
use super::network::PARAMETERS;

/// Parts of a batch that may be computed at the same time.
const CHUNKS: usize = 4;

/// Parameters that one thread moves at a time.
const STRETCH: usize = 8192;

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

/// The descent's state: the velocity, and the space that each chunk works in.
pub struct Sgd {
    velocity: Vec<f32>,
    chunks: Vec<Chunk>,
}

struct Chunk {
    workspace: Workspace,
    gradient: Vec<f32>,
    squared_error: f64,
}

impl Default for Sgd {
    fn default() -> Self {
        let chunk =
            || Chunk { workspace: Workspace::default(), gradient: vec![0.0; PARAMETERS], squared_error: 0.0 };
        Self { velocity: vec![0.0; PARAMETERS], chunks: (0..CHUNKS).map(|_| chunk()).collect() }
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
        self.sum_gradient(parameters, head, batch);
        let gradients: [&[f32]; CHUNKS] = std::array::from_fn(|chunk| self.chunks[chunk].gradient.as_slice());
        parameters.par_chunks_mut(STRETCH).zip(self.velocity.par_chunks_mut(STRETCH)).enumerate().for_each(
            |(stretch, (parameters, velocity))| {
                let [a, b, c, d] = gradients.map(|g| &g[stretch * STRETCH..][..parameters.len()]);
                for (at, (p, v)) in parameters.iter_mut().zip(velocity).enumerate() {
                    *v = rate.momentum * *v + ((a[at] + b[at]) + (c[at] + d[at]));
                    *p -= rate.learning_rate * *v;
                }
            },
        );
        self.chunks.iter().map(|chunk| chunk.squared_error).sum()
    }

    /// The gradient `g` of [`step`](Self::step), which it would follow.
    pub fn gradient(&mut self, parameters: &[f32], head: Head, batch: &[Example<'_>]) -> Vec<f32> {
        self.sum_gradient(parameters, head, batch);
        let [a, b, c, d]: [&[f32]; CHUNKS] =
            std::array::from_fn(|chunk| self.chunks[chunk].gradient.as_slice());
        (0..PARAMETERS).map(|at| (a[at] + b[at]) + (c[at] + d[at])).collect()
    }

    fn sum_gradient(&mut self, parameters: &[f32], head: Head, batch: &[Example<'_>]) {
        let groups: Vec<_> = batch.chunks(LANES).collect();
        let scale = 2.0 / batch.len() as f32;
        self.chunks.par_iter_mut().enumerate().for_each(|(at, chunk)| {
            chunk.gradient.fill(0.0);
            chunk.squared_error = 0.0;
            for group in &groups[at * groups.len() / CHUNKS..(at + 1) * groups.len() / CHUNKS] {
                for (lane, example) in group.iter().enumerate() {
                    chunk.workspace.load(lane, example.field, example.mirrored);
                }
                let outputs = chunk.workspace.forward(parameters);
                let mut d_output = [0.0; LANES];
                for ((d_output, x), example) in d_output.iter_mut().zip(outputs).zip(*group) {
                    let answer = head.answer(x);
                    let error = answer - example.label;
                    *d_output = scale * error * head.slope(answer);
                    chunk.squared_error += f64::from(error) * f64::from(error);
                }
                chunk.workspace.backward(parameters, d_output, &mut chunk.gradient);
            }
        });
    }
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
                let outputs = workspace.forward(parameters);
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
