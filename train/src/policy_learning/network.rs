//! A fully connected network: its shape, where its parameters stand, and how they start.
//!
//! All parameters are one flat vector, so that steps, sums and files need no structure. A layer is its
//! weights `[input][output]`, then its biases; ELU between layers, nothing behind the last.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// One layer's place in the flat vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layer {
    /// Values it takes.
    pub inputs: usize,
    /// Values it answers.
    pub outputs: usize,
    /// Where its weights begin; the biases follow them.
    pub start: usize,
}

impl Layer {
    /// Weights, `[input][output]`.
    pub fn weights<'a>(&self, parameters: &'a [f32]) -> &'a [f32] {
        &parameters[self.start..][..self.inputs * self.outputs]
    }

    /// Biases, `[output]`.
    pub fn biases<'a>(&self, parameters: &'a [f32]) -> &'a [f32] {
        &parameters[self.start + self.inputs * self.outputs..][..self.outputs]
    }

    /// Weights and biases, to write.
    pub fn split_mut<'a>(&self, parameters: &'a mut [f32]) -> (&'a mut [f32], &'a mut [f32]) {
        let (weights, rest) = parameters[self.start..].split_at_mut(self.inputs * self.outputs);
        (weights, &mut rest[..self.outputs])
    }
}

/// The shape of a network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Network {
    layers: Vec<Layer>,
}

impl Network {
    /// `inputs` → each of `hidden` → `outputs`.
    pub fn new(inputs: usize, hidden: &[usize], outputs: usize) -> Self {
        let widths: Vec<usize> =
            std::iter::once(inputs).chain(hidden.iter().copied()).chain(std::iter::once(outputs)).collect();
        let mut start = 0;
        let layer = |pair: &[usize]| {
            let layer = Layer { inputs: pair[0], outputs: pair[1], start };
            start += (pair[0] + 1) * pair[1];
            layer
        };
        Self { layers: widths.windows(2).map(layer).collect() }
    }

    /// The layers, from the input on.
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// Values that it takes.
    pub fn inputs(&self) -> usize {
        self.layers[0].inputs
    }

    /// Values that it answers.
    pub fn outputs(&self) -> usize {
        self.layers[self.layers.len() - 1].outputs
    }

    /// Length of the flat vector.
    pub fn parameters(&self) -> usize {
        self.layers.iter().map(|layer| (layer.inputs + 1) * layer.outputs).sum()
    }

    /// Start values: weights uniform with variance `2 / inputs` (the last layer's `last_gain² / inputs`),
    /// biases 0.
    ///
    /// With a small `last_gain` a policy starts at its default pose whatever it sees.
    ///
    /// # Source
    /// He et al., *Delving deep into rectifiers*, ICCV 2015, eq. 10, as a uniform distribution; Andrychowicz
    /// et al., *What matters in on-policy reinforcement learning*, ICLR 2021, for the small last layer.
    pub fn start_values(&self, last_gain: f32, rng: &mut ChaCha8Rng) -> Vec<f32> {
        let mut parameters = vec![0.0; self.parameters()];
        for (at, layer) in self.layers.iter().enumerate() {
            let is_last = at + 1 == self.layers.len();
            let gain = if is_last { last_gain } else { std::f32::consts::SQRT_2 };
            let bound = gain * (3.0 / layer.inputs as f32).sqrt();
            for weight in layer.split_mut(&mut parameters).0 {
                *weight = bound * (2.0 * rng.random::<f32>() - 1.0);
            }
        }
        parameters
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_sim::stream::stream;

    #[test]
    fn layers_fill_the_vector_without_gaps() {
        let network = Network::new(5, &[7, 3], 2);
        assert_eq!(network.parameters(), 6 * 7 + 8 * 3 + 4 * 2);
        for pair in network.layers().windows(2) {
            assert_eq!(pair[0].start + (pair[0].inputs + 1) * pair[0].outputs, pair[1].start);
        }
        assert_eq!((network.inputs(), network.outputs()), (5, 2));
    }

    #[test]
    fn a_small_last_gain_starts_near_zero() {
        let network = Network::new(40, &[60], 30);
        let parameters = network.start_values(0.01, &mut stream(1, "test/start", &[]));
        let spread = |layer: &Layer| {
            let weights = layer.weights(&parameters);
            (weights.iter().map(|w| w * w).sum::<f32>() / weights.len() as f32).sqrt()
        };
        let [hidden, last] = [0, 1].map(|at| spread(&network.layers()[at]));
        assert!((hidden - (2.0_f32 / 40.0).sqrt()).abs() < 0.01, "{hidden}");
        assert!((last - 0.01 / 60.0_f32.sqrt()).abs() < 1e-4, "{last}");
    }
}
