//! Forward and backward pass of a [`Network`] over many rows at once.
//!
//! The matrix products fuse multiplication and addition where the processor can, so that trained weights
//! repeat on one kind of processor; nothing here depends on the number of threads.

use super::elu::{elu, elu_slope};
use super::network::Network;
use super::product::{Matrix, multiply};

/// What a pass over at most a number of rows needs to remember.
pub struct BatchPass {
    /// Of each layer, `[row][output]`.
    outputs: Vec<Vec<f32>>,
    /// Gradient by the present layer's output and by the one before, `[row][value]`.
    gradients: [Vec<f32>; 2],
}

impl BatchPass {
    /// Room for `rows` rows through `network`.
    pub fn new(network: &Network, rows: usize) -> Self {
        let widest = network.layers().iter().map(|layer| layer.outputs).max().unwrap_or(0);
        Self {
            outputs: network.layers().iter().map(|layer| vec![0.0; rows * layer.outputs]).collect(),
            gradients: [vec![0.0; rows * widest], vec![0.0; rows * widest]],
        }
    }

    /// The network's answers, `[row][output]`, for `input`, `[row][input]`.
    ///
    /// ```text
    /// y₀ = input     y_l = elu(y_{l−1}·W_l + b_l)     answer = y_{L−1}·W_L + b_L
    /// ```
    pub fn forward(&mut self, network: &Network, parameters: &[f32], input: &[f32]) -> &[f32] {
        let rows = input.len() / network.inputs();
        for (at, layer) in network.layers().iter().enumerate() {
            let (before, behind) = self.outputs.split_at_mut(at);
            let x = if at == 0 { input } else { &before[at - 1][..rows * layer.inputs] };
            let y = &mut behind[0][..rows * layer.outputs];
            let biases = layer.biases(parameters);
            for row in y.chunks_exact_mut(layer.outputs) {
                row.copy_from_slice(biases);
            }
            multiply(
                y,
                1.0,
                Matrix::new(x, rows, layer.inputs),
                Matrix::new(layer.weights(parameters), layer.inputs, layer.outputs),
            );
            if at + 1 < network.layers().len() {
                for value in y {
                    *value = elu(*value);
                }
            }
        }
        &self.outputs[network.layers().len() - 1][..rows * network.outputs()]
    }

    /// Adds to `gradient` the derivative by the parameters, given `by_answer`, the one by the answers of
    /// the [`forward`](Self::forward) just before with the same `input`.
    ///
    /// ```text
    /// ∂W_l = y_{l−1}ᵀ·δ_l     ∂b_l = Σ_row δ_l     δ_{l−1} = (δ_l·W_lᵀ) ∘ elu'(y_{l−1})
    /// ```
    pub fn backward(
        &mut self,
        network: &Network,
        parameters: &[f32],
        input: &[f32],
        by_answer: &[f32],
        gradient: &mut [f32],
    ) {
        let rows = input.len() / network.inputs();
        let [mut delta, mut next] = self.gradients.each_mut();
        delta[..by_answer.len()].copy_from_slice(by_answer);
        for (at, layer) in network.layers().iter().enumerate().rev() {
            let x = if at == 0 { input } else { &self.outputs[at - 1][..rows * layer.inputs] };
            let behind = &delta[..rows * layer.outputs];
            let (weights, biases) = layer.split_mut(gradient);
            let by_outputs = Matrix::new(behind, rows, layer.outputs);
            multiply(weights, 1.0, Matrix::new(x, rows, layer.inputs).transposed(), by_outputs);
            for row in behind.chunks_exact(layer.outputs) {
                for (sum, value) in biases.iter_mut().zip(row) {
                    *sum += value;
                }
            }
            if at == 0 {
                break;
            }
            let before = &mut next[..rows * layer.inputs];
            let weights = Matrix::new(layer.weights(parameters), layer.inputs, layer.outputs);
            multiply(before, 0.0, by_outputs, weights.transposed());
            for (value, y) in before.iter_mut().zip(x) {
                *value *= elu_slope(*y);
            }
            std::mem::swap(&mut delta, &mut next);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_sim::stream::{stream, uniform};

    fn values(name: &str, count: usize) -> Vec<f32> {
        let mut rng = stream(5, name, &[]);
        (0..count).map(|_| uniform(&mut rng, -1.0, 1.0)).collect()
    }

    /// `Σ answer · weight`, in f64, without matrices.
    fn weighed(network: &Network, parameters: &[f64], input: &[f32], weight: &[f32]) -> f64 {
        let mut sum = 0.0;
        for (row, weight) in input.chunks(network.inputs()).zip(weight.chunks(network.outputs())) {
            let mut x: Vec<f64> = row.iter().map(|v| f64::from(*v)).collect();
            for (at, layer) in network.layers().iter().enumerate() {
                let biases = layer.start + layer.inputs * layer.outputs;
                x = (0..layer.outputs)
                    .map(|out| {
                        let weight = |i: usize| parameters[layer.start + i * layer.outputs + out];
                        let y = parameters[biases + out]
                            + x.iter().enumerate().map(|(i, x)| x * weight(i)).sum::<f64>();
                        let is_last = at + 1 == network.layers().len();
                        if is_last || y > 0.0 { y } else { libm::expm1(y) }
                    })
                    .collect();
            }
            sum += x.iter().zip(weight).map(|(y, w)| y * f64::from(*w)).sum::<f64>();
        }
        sum
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        // Widths on both sides of the threshold for small products.
        let network = Network::new(9, &[17, 6], 3);
        let rows = 11;
        let parameters = network.start_values(1.0, &mut stream(2, "test/start", &[]));
        let (input, weight) = (values("test/input", rows * 9), values("test/weight", rows * 3));
        let mut pass = BatchPass::new(&network, 20);
        pass.forward(&network, &parameters, &input);
        let mut gradient = vec![0.0; network.parameters()];
        pass.backward(&network, &parameters, &input, &weight, &mut gradient);
        let exact: Vec<f64> = parameters.iter().map(|p| f64::from(*p)).collect();
        for (at, found) in gradient.iter().enumerate() {
            let moved = |step: f64| {
                let mut moved = exact.clone();
                moved[at] += step;
                weighed(&network, &moved, &input, &weight)
            };
            let wanted = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!(
                (f64::from(*found) - wanted).abs() < 2e-5 * (1.0 + wanted.abs()),
                "parameter {at}: {found} against {wanted}"
            );
        }
    }

    #[test]
    fn the_answers_do_not_depend_on_what_was_computed_before() {
        let network = Network::new(9, &[17, 6], 3);
        let parameters = network.start_values(1.0, &mut stream(2, "test/start", &[]));
        let input = values("test/input", 4 * 9);
        let mut pass = BatchPass::new(&network, 8);
        let fresh = pass.forward(&network, &parameters, &input).to_vec();
        pass.forward(&network, &parameters, &values("test/other", 8 * 9));
        assert_eq!(pass.forward(&network, &parameters, &input), fresh);
    }
}
