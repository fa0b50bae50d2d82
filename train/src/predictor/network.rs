//! The predictor network: its tensors, in the one order used everywhere, and how they start.
//!
//! Heightfield 31 × 11 → conv 1→4, conv 4→8, max-pool 2, conv 8→8 (3×3, stride 1, padding 1, ReLU
//! after each), flatten, fully connected 128 and 128 (ReLU), one output. Wu et al. (2025), section 4.
//! All parameters are one flat vector, so that sums, steps and tests need no structure.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// One weight or bias tensor: its place in the flat vector and its meaning to a reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tensor {
    /// Name in the ONNX file.
    pub name: &'static str,
    /// Shape, PyTorch's axis order: `[out][in][row][column]`, `[out][in]` or `[out]`.
    pub shape: &'static [usize],
    /// Inputs that one output sums over: what the start values are scaled by.
    pub fan_in: usize,
    /// Where it begins.
    pub start: usize,
}

impl Tensor {
    /// Number of values.
    pub const fn len(&self) -> usize {
        let (mut n, mut axis) = (1, 0);
        while axis < self.shape.len() {
            n *= self.shape[axis];
            axis += 1;
        }
        n
    }

    /// Never: every tensor of the network holds values.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Its part of the flat vector.
    pub fn of<'a>(&self, parameters: &'a [f32]) -> &'a [f32] {
        &parameters[self.start..self.start + self.len()]
    }

    /// Its part of the flat vector, to write.
    pub fn of_mut<'a>(&self, parameters: &'a mut [f32]) -> &'a mut [f32] {
        &mut parameters[self.start..self.start + self.len()]
    }
}

/// Values that the last convolution hands to the first fully connected layer: 8 channels of 15 × 5.
pub const FLAT: usize = 8 * 15 * 5;

/// Width of both hidden layers.
pub const HIDDEN: usize = 128;

const SHAPES: [(&str, &[usize], usize); 12] = [
    ("conv1.weight", &[4, 1, 3, 3], 9),
    ("conv1.bias", &[4], 9),
    ("conv2.weight", &[8, 4, 3, 3], 36),
    ("conv2.bias", &[8], 36),
    ("conv3.weight", &[8, 8, 3, 3], 72),
    ("conv3.bias", &[8], 72),
    ("fc1.weight", &[HIDDEN, FLAT], FLAT),
    ("fc1.bias", &[HIDDEN], FLAT),
    ("fc2.weight", &[HIDDEN, HIDDEN], HIDDEN),
    ("fc2.bias", &[HIDDEN], HIDDEN),
    ("out.weight", &[1, HIDDEN], HIDDEN),
    ("out.bias", &[1], HIDDEN),
];

/// All tensors, in the order of the flat vector.
pub const TENSORS: [Tensor; 12] = {
    let mut tensors = [Tensor { name: "", shape: &[], fan_in: 1, start: 0 }; 12];
    let (mut at, mut start) = (0, 0);
    while at < SHAPES.len() {
        let (name, shape, fan_in) = SHAPES[at];
        tensors[at] = Tensor { name, shape, fan_in, start };
        start += tensors[at].len();
        at += 1;
    }
    tensors
};

/// Length of the flat vector.
pub const PARAMETERS: usize = TENSORS[11].start + 1;

/// Start values, uniform: hidden weights in ±√(6/fan-in), the rest in ±1/√fan-in.
///
/// Ours, since the paper does not say. With ±1/√fan-in everywhere, as PyTorch's layers start, the
/// signal fades through five layers of ReLU, and 5,000 samples need 150 epochs for the loss that these
/// values reach in 60.
///
/// # Source
/// He et al., *Delving deep into rectifiers*, ICCV 2015, eq. 10, as a uniform distribution.
pub fn start_values(rng: &mut ChaCha8Rng) -> Vec<f32> {
    let mut parameters = vec![0.0; PARAMETERS];
    for tensor in &TENSORS {
        let hidden_weight = tensor.shape.len() > 1 && tensor.shape[0] > 1;
        let gain = if hidden_weight { 6.0 } else { 1.0 };
        let bound = (gain / tensor.fan_in as f32).sqrt();
        for value in tensor.of_mut(&mut parameters) {
            *value = rng.random_range(-bound..bound);
        }
    }
    parameters
}

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_sim::stream::stream;

    #[test]
    fn the_tensors_are_the_method_s_and_fill_the_vector_without_gaps() {
        assert_eq!(
            PARAMETERS,
            4 * 9 + 4 + 8 * 36 + 8 + 8 * 72 + 8 + 128 * 600 + 128 + 128 * 128 + 128 + 128 + 1
        );
        for pair in TENSORS.windows(2) {
            assert_eq!(pair[0].start + pair[0].len(), pair[1].start, "{}", pair[1].name);
        }
    }

    #[test]
    fn hidden_layers_start_with_a_variance_of_two_over_fan_in() {
        let parameters = start_values(&mut stream(1, "test/start", &[]));
        for tensor in TENSORS.iter().filter(|tensor| tensor.len() > 200 && tensor.shape[0] > 1) {
            let values = tensor.of(&parameters);
            let variance = values.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / values.len() as f64;
            let wanted = 2.0 / tensor.fan_in as f64;
            assert!((variance / wanted - 1.0).abs() < 0.15, "{}: {variance} against {wanted}", tensor.name);
        }
    }
}
