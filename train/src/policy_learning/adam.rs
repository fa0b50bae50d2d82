//! Adam, and the clipping of a gradient's length in front of it.

use rayon::prelude::*;

const BETA_1: f32 = 0.9;
const BETA_2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// Parameters that one thread moves at a time.
const STRETCH: usize = 16_384;

/// Memory of the descent of one parameter vector.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    /// Running mean of the gradient.
    pub mean: Vec<f32>,
    /// Running mean of its square.
    pub square: Vec<f32>,
    /// Steps taken.
    pub steps: u64,
}

impl Adam {
    /// Before the first step on `parameters` parameters.
    pub fn new(parameters: usize) -> Self {
        Self { mean: vec![0.0; parameters], square: vec![0.0; parameters], steps: 0 }
    }

    /// One step down `scale`·`gradient`.
    ///
    /// ```text
    /// m ← β₁m + (1−β₁)g     v ← β₂v + (1−β₂)g²     p ← p − rate · (m/(1−β₁ᵗ)) / (√(v/(1−β₂ᵗ)) + 1e-8)
    /// ```
    ///
    /// # Source
    /// Kingma and Ba, *Adam*, ICLR 2015, algorithm 1; β₁ 0.9, β₂ 0.999.
    pub fn step(&mut self, parameters: &mut [f32], gradient: &[f32], scale: f32, rate: f32) {
        self.steps += 1;
        let steps = self.steps as f64;
        let unbiased_1 = (1.0 / (1.0 - libm::pow(f64::from(BETA_1), steps))) as f32;
        let unbiased_2 = (1.0 / (1.0 - libm::pow(f64::from(BETA_2), steps))) as f32;
        let parts = parameters.par_chunks_mut(STRETCH).zip(gradient.par_chunks(STRETCH));
        let memory = self.mean.par_chunks_mut(STRETCH).zip(self.square.par_chunks_mut(STRETCH));
        parts.zip(memory).for_each(|((parameters, gradient), (mean, square))| {
            for (((p, g), m), v) in parameters.iter_mut().zip(gradient).zip(mean).zip(square) {
                let g = scale * g;
                *m = BETA_1 * *m + (1.0 - BETA_1) * g;
                *v = BETA_2 * *v + (1.0 - BETA_2) * g * g;
                *p -= rate * (*m * unbiased_1) / ((*v * unbiased_2).sqrt() + EPSILON);
            }
        });
    }
}

/// What gradients are multiplied by so that together they are at most `longest` long.
pub fn clipping(gradients: &[&[f32]], longest: f32) -> f32 {
    let squares: f64 = gradients.iter().flat_map(|gradient| *gradient).map(|g| f64::from(g * g)).sum();
    // Phrased so that a length that is not a number clips to nothing instead of letting it through.
    if squares <= f64::from(longest * longest) {
        1.0
    } else if squares.is_finite() {
        longest / squares.sqrt() as f32
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_is_as_long_as_the_learning_rate_whatever_the_gradient() {
        let mut parameters = [1.0, 1.0, 1.0];
        Adam::new(3).step(&mut parameters, &[250.0, -0.003, 0.0], 1.0, 0.01);
        assert!((parameters[0] - 0.99).abs() < 1e-6, "{parameters:?}");
        assert!((parameters[1] - 1.01).abs() < 1e-6, "{parameters:?}");
        assert_eq!(parameters[2], 1.0);
    }

    #[test]
    fn the_second_step_follows_the_running_means() {
        let mut parameters = [0.0];
        let mut adam = Adam::new(1);
        adam.step(&mut parameters, &[1.0], 1.0, 0.1);
        adam.step(&mut parameters, &[-0.5], 1.0, 0.1);
        // m = 0.9·0.1 − 0.1·0.5 = 0.04, v = 0.999·0.001 + 0.001·0.25 = 0.001249.
        let wanted = -0.1 - 0.1 * (0.04 / 0.19) / (0.001_249_f64 / 0.001_999).sqrt();
        assert!((f64::from(parameters[0]) - wanted).abs() < 1e-6, "{} {wanted}", parameters[0]);
    }

    #[test]
    fn a_long_gradient_is_shortened_and_a_short_one_kept() {
        assert_eq!(clipping(&[&[3.0], &[4.0]], 10.0), 1.0);
        assert!((clipping(&[&[3.0], &[4.0]], 1.0) - 0.2).abs() < 1e-7);
        assert_eq!(clipping(&[&[f32::NAN]], 1.0), 0.0);
    }
}
