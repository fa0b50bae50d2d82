//! The policy's distribution: independent Gaussians around the network's answer, whose spread does not
//! depend on the state.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// `½·ln 2π`.
const HALF_LN_2_PI: f32 = 0.918_938_5;

/// Spread of the actions, one standard deviation each, kept as its logarithm.
#[derive(Clone, Copy, Debug)]
pub struct Spread<'a> {
    /// `ln σ`, one per action.
    pub log_std: &'a [f32],
}

impl Spread<'_> {
    /// `ln p(a) = Σ −½((a − μ)/σ)² − ln σ − ½ ln 2π`.
    pub fn log_probability(&self, mean: &[f32], action: &[f32]) -> f32 {
        let of = |((mean, action), log_std): ((&f32, &f32), &f32)| {
            let z = (action - mean) * libm::expf(-log_std);
            -0.5 * z * z - log_std - HALF_LN_2_PI
        };
        mean.iter().zip(action).zip(self.log_std).map(of).sum()
    }

    /// Draws an action around `mean`.
    pub fn draw(&self, mean: &[f32], rng: &mut ChaCha8Rng, action: &mut [f32]) {
        for ((action, mean), log_std) in action.iter_mut().zip(mean).zip(self.log_std) {
            *action = mean + libm::expf(*log_std) * normal(rng);
        }
    }

    /// `H = Σ ln σ + ½ ln 2πe`.
    pub fn entropy(&self) -> f32 {
        self.log_std.iter().map(|log_std| log_std + HALF_LN_2_PI + 0.5).sum()
    }

    /// Divergence of this distribution around `mean` from an older one.
    ///
    /// ```text
    /// KL(old ‖ new) = Σ ln(σ/σ₀) + (σ₀² + (μ₀ − μ)²)/(2σ²) − ½
    /// ```
    pub fn divergence_from(&self, old: Spread<'_>, old_mean: &[f32], mean: &[f32]) -> f32 {
        let mut sum = 0.0;
        for at in 0..mean.len() {
            let difference = old_mean[at] - mean[at];
            let (log_std, old_log_std) = (self.log_std[at], old.log_std[at]);
            let old_variance = libm::expf(2.0 * old_log_std);
            sum += log_std - old_log_std
                + (old_variance + difference * difference) * 0.5 * libm::expf(-2.0 * log_std)
                - 0.5;
        }
        sum
    }
}

/// A number from the standard normal distribution.
///
/// # Source
/// Box and Muller (1958).
pub fn normal(rng: &mut ChaCha8Rng) -> f32 {
    // 1 − u lies in (0, 1], where the logarithm is finite.
    let radius = (-2.0 * libm::logf(1.0 - rng.random::<f32>())).sqrt();
    radius * libm::cosf(std::f32::consts::TAU * rng.random::<f32>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_sim::stream::stream;

    const SPREAD: Spread<'static> = Spread { log_std: &[-0.7, 0.2] };

    #[test]
    fn draws_have_the_mean_and_spread_they_should() {
        let mut rng = stream(1, "test/normal", &[]);
        let n = 40_000;
        let mut sums = [[0.0_f64; 2]; 2];
        let mut action = [0.0; 2];
        for _ in 0..n {
            SPREAD.draw(&[1.0, -3.0], &mut rng, &mut action);
            for at in 0..2 {
                sums[at][0] += f64::from(action[at]);
                sums[at][1] += f64::from(action[at]).powi(2);
            }
        }
        for (at, mean) in [1.0, -3.0].into_iter().enumerate() {
            let found = sums[at][0] / f64::from(n);
            let std = (sums[at][1] / f64::from(n) - found * found).sqrt();
            let wanted = f64::from(libm::expf(SPREAD.log_std[at]));
            assert!((found - mean).abs() < 0.02 && (std / wanted - 1.0).abs() < 0.02, "{found} {std}");
        }
    }

    #[test]
    fn the_density_integrates_to_one_and_gives_the_entropy() {
        let spread = Spread { log_std: &[-0.7] };
        let (mut mass, mut entropy) = (0.0, 0.0);
        for k in -4000..4000 {
            let log_p = f64::from(spread.log_probability(&[0.3], &[0.3 + k as f32 * 1e-3]));
            mass += libm::exp(log_p) * 1e-3;
            entropy -= libm::exp(log_p) * log_p * 1e-3;
        }
        assert!((mass - 1.0).abs() < 1e-4, "{mass}");
        assert!((entropy - f64::from(spread.entropy())).abs() < 1e-3, "{entropy}");
    }

    #[test]
    fn a_distribution_does_not_diverge_from_itself() {
        assert!(SPREAD.divergence_from(SPREAD, &[1.0, 2.0], &[1.0, 2.0]).abs() < 1e-6);
        // Moved by one σ in one direction: ½.
        let moved = [1.0 + libm::expf(-0.7), 2.0];
        assert!((SPREAD.divergence_from(SPREAD, &[1.0, 2.0], &moved) - 0.5).abs() < 1e-5);
    }
}
