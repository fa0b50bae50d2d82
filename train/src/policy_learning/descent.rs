//! Gradients of a loss over chosen rows, on all threads, the same bits on any number of them.
//!
//! A batch is split into `PARTS` parts of fixed size, each summed by one thread; the parts are added in
//! order.

use std::ops::Range;

use rayon::prelude::*;

use super::batch_pass::BatchPass;
use super::network::Network;

/// Parts of a batch that may be computed at the same time.
const PARTS: usize = 8;

/// Rows that go through the network together.
const ROWS: usize = 128;

/// What a loss says about one row.
pub trait Loss: Sync {
    /// How many numbers are summed over the rows beside the gradient.
    fn sums(&self) -> usize;

    /// Copies the input of row `row` of the data.
    fn input(&self, row: usize, input: &mut [f32]);

    /// Writes the loss's derivative by the answer of row `row`, already divided by the batch's rows, and
    /// adds to `sums`.
    fn derivative(&self, row: usize, answer: &[f32], by_answer: &mut [f32], sums: &mut [f64]);
}

struct Part {
    pass: BatchPass,
    input: Vec<f32>,
    by_answer: Vec<f32>,
    gradient: Vec<f32>,
    sums: Vec<f64>,
}

/// Room for the gradients of one network.
pub struct Descent {
    network: Network,
    parts: Vec<Part>,
    gradient: Vec<f32>,
}

impl Descent {
    /// Room for `network`.
    pub fn new(network: Network) -> Self {
        let part = || Part {
            pass: BatchPass::new(&network, ROWS),
            input: vec![0.0; ROWS * network.inputs()],
            by_answer: vec![0.0; ROWS * network.outputs()],
            gradient: vec![0.0; network.parameters()],
            sums: Vec::new(),
        };
        let parts = (0..PARTS).map(|_| part()).collect();
        Self { parts, gradient: vec![0.0; network.parameters()], network }
    }

    /// Gradient and sums of `loss` over `rows` of its data.
    pub fn gradient<L: Loss>(&mut self, parameters: &[f32], rows: &[u32], loss: &L) -> (&[f32], Vec<f64>) {
        let network = &self.network;
        self.parts.par_iter_mut().enumerate().for_each(|(at, part)| {
            part.gradient.fill(0.0);
            part.sums.clear();
            part.sums.resize(loss.sums(), 0.0);
            let own = &rows[share(rows.len(), at)];
            for rows in own.chunks(ROWS) {
                let input = &mut part.input[..rows.len() * network.inputs()];
                for (row, input) in rows.iter().zip(input.chunks_exact_mut(network.inputs())) {
                    loss.input(*row as usize, input);
                }
                let answers = part.pass.forward(network, parameters, input);
                let by_answer = &mut part.by_answer[..answers.len()];
                let pairs = answers
                    .chunks_exact(network.outputs())
                    .zip(by_answer.chunks_exact_mut(network.outputs()));
                for (row, (answer, by_answer)) in rows.iter().zip(pairs) {
                    loss.derivative(*row as usize, answer, by_answer, &mut part.sums);
                }
                part.pass.backward(network, parameters, input, by_answer, &mut part.gradient);
            }
        });
        let parts = &self.parts;
        self.gradient.par_chunks_mut(8192).enumerate().for_each(|(stretch, sum)| {
            sum.fill(0.0);
            for part in parts {
                for (sum, value) in sum.iter_mut().zip(&part.gradient[stretch * 8192..]) {
                    *sum += value;
                }
            }
        });
        let mut sums = vec![0.0; loss.sums()];
        for part in parts {
            for (sum, value) in sums.iter_mut().zip(&part.sums) {
                *sum += value;
            }
        }
        (&self.gradient, sums)
    }
}

fn share(rows: usize, part: usize) -> Range<usize> {
    part * rows / PARTS..(part + 1) * rows / PARTS
}

/// The answers of a network with one output to many rows, `[row][input]`, in their order.
pub fn values(network: &Network, parameters: &[f32], rows: &[f32]) -> Vec<f32> {
    rows.par_chunks(ROWS * network.inputs())
        .flat_map_iter(|rows| {
            let mut pass = BatchPass::new(network, rows.len() / network.inputs());
            pass.forward(network, parameters, rows).to_vec()
        })
        .collect()
}
