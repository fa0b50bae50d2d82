//! Forward pass of a network for one row: what an environment's step waits for.
//!
//! The weights stand in blocks of 32 outputs, `[block][input][32]`, read once from front to back, with
//! 32 sums kept in registers. Every sum runs over the inputs in order, multiplied and added separately, so
//! that the answer has the same bits on every processor.

use super::elu::elu;
use super::network::Network;
use super::normaliser::Scaling;

/// Outputs that are computed together.
const BLOCK: usize = 32;

struct Packed {
    inputs: usize,
    outputs: usize,
    /// `[block][input][32]`; outputs that fill the last block are 0.
    weights: Vec<f32>,
    /// `[block][32]`.
    biases: Vec<f32>,
}

/// A network's weights with the scaling in front of them, laid out for single rows; shared by threads.
pub struct SinglePass {
    scaling: Scaling,
    layers: Vec<Packed>,
}

/// What one thread writes while it computes.
#[derive(Default)]
pub struct Scratch {
    x: Vec<f32>,
    y: Vec<f32>,
}

impl SinglePass {
    /// Lays out `parameters`; inputs are scaled by `scaling` first.
    pub fn new(network: &Network, parameters: &[f32], scaling: Scaling) -> Self {
        let pack = |layer: &super::network::Layer| {
            let blocks = layer.outputs.div_ceil(BLOCK);
            let mut weights = vec![0.0; blocks * layer.inputs * BLOCK];
            let mut biases = vec![0.0; blocks * BLOCK];
            biases[..layer.outputs].copy_from_slice(layer.biases(parameters));
            for (input, row) in layer.weights(parameters).chunks_exact(layer.outputs).enumerate() {
                for (block, part) in row.chunks(BLOCK).enumerate() {
                    weights[(block * layer.inputs + input) * BLOCK..][..part.len()].copy_from_slice(part);
                }
            }
            Packed { inputs: layer.inputs, outputs: layer.outputs, weights, biases }
        };
        Self { scaling, layers: network.layers().iter().map(pack).collect() }
    }

    /// The network's answer for one raw row.
    pub fn answer<'a>(&self, input: &[f32], scratch: &'a mut Scratch) -> &'a [f32] {
        let Scratch { x, y } = scratch;
        x.clear();
        x.extend_from_slice(input);
        self.scaling.apply(x);
        let mut outputs = 0;
        for (at, layer) in self.layers.iter().enumerate() {
            outputs = layer.outputs;
            y.clear();
            let blocks = layer.weights.chunks_exact(layer.inputs * BLOCK);
            for (weights, biases) in blocks.zip(layer.biases.chunks_exact(BLOCK)) {
                let mut sums = [0.0; BLOCK];
                sums.copy_from_slice(biases);
                for (x, weights) in x.iter().zip(weights.chunks_exact(BLOCK)) {
                    for (sum, weight) in sums.iter_mut().zip(weights) {
                        *sum += x * weight;
                    }
                }
                if at + 1 < self.layers.len() {
                    for sum in &mut sums {
                        *sum = elu(*sum);
                    }
                }
                y.extend_from_slice(&sums);
            }
            y.truncate(outputs);
            std::mem::swap(x, y);
        }
        &x[..outputs]
    }
}

#[cfg(test)]
mod tests {
    use super::super::batch_pass::BatchPass;
    use super::super::normaliser::Normaliser;
    use super::*;
    use vocaloco_sim::stream::{stream, uniform};

    #[test]
    fn one_row_is_answered_as_in_a_batch() {
        let network = Network::new(41, &[70, 33], 12);
        let mut rng = stream(3, "test/start", &[]);
        let mut parameters = network.start_values(1.0, &mut rng);
        for p in &mut parameters {
            *p += uniform(&mut rng, -0.01, 0.01);
        }
        let rows: Vec<f32> = (0..6 * 41).map(|k| uniform(&mut rng, -1.0, 1.0) * (k % 41) as f32).collect();
        let mut normaliser = Normaliser::new(41);
        normaliser.add(rows.chunks_exact(41));
        let scaling = normaliser.scaling();
        let mut scaled = rows.clone();
        scaled.chunks_exact_mut(41).for_each(|row| scaling.apply(row));
        let mut pass = BatchPass::new(&network, 6);
        let wanted = pass.forward(&network, &parameters, &scaled);
        let single = SinglePass::new(&network, &parameters, scaling);
        let mut scratch = Scratch::default();
        for (row, wanted) in rows.chunks_exact(41).zip(wanted.chunks_exact(12)) {
            let found = single.answer(row, &mut scratch);
            for (found, wanted) in found.iter().zip(wanted) {
                assert!((found - wanted).abs() < 1e-5, "{found} against {wanted}");
            }
        }
    }
}
