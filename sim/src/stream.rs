//! Named random streams: every number that a result depends on is drawn from a stream keyed by the
//! seed, the name of what it feeds and an index, so that neither order nor threads can change it.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sha2::{Digest, Sha256};

/// The stream `name` of a seed, at an index such as `[row, repeat]`.
///
/// The key is SHA-256 over the length and bytes of the name, the seed, and each part of the index
/// (little endian), so two different (seed, name, index) never share a stream.
pub fn stream(seed: u64, name: &str, index: &[u64]) -> ChaCha8Rng {
    let mut hash = Sha256::new();
    hash.update((name.len() as u64).to_le_bytes());
    hash.update(name.as_bytes());
    hash.update(seed.to_le_bytes());
    hash.update((index.len() as u64).to_le_bytes());
    for part in index {
        hash.update(part.to_le_bytes());
    }
    ChaCha8Rng::from_seed(hash.finalize().into())
}

/// A number drawn evenly from `low` to `high`.
pub fn uniform(rng: &mut ChaCha8Rng, low: f32, high: f32) -> f32 {
    low + (high - low) * rng.random::<f32>()
}

/// A seed for something that takes one, such as a terrain: the first word of the stream.
pub fn derived_seed(seed: u64, name: &str, index: &[u64]) -> u64 {
    stream(seed, name, index).random()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first_words(seed: u64, name: &str, index: &[u64]) -> [u64; 4] {
        stream(seed, name, index).random()
    }

    #[test]
    fn a_stream_repeats() {
        assert_eq!(first_words(7, "pose", &[3, 1]), first_words(7, "pose", &[3, 1]));
    }

    #[test]
    fn seed_name_and_every_part_of_the_index_give_another_stream() {
        let reference = first_words(7, "pose", &[3, 1]);
        for other in [
            first_words(8, "pose", &[3, 1]),
            first_words(7, "posf", &[3, 1]),
            first_words(7, "pose", &[4, 1]),
            first_words(7, "pose", &[3, 2]),
            first_words(7, "pose", &[3]),
            first_words(7, "pose", &[1, 3]),
        ] {
            assert!(reference.iter().zip(&other).all(|(a, b)| a != b), "{reference:?} {other:?}");
        }
    }

    #[test]
    fn neighbouring_rows_are_not_correlated() {
        let n = 20_000_u64;
        let draws: Vec<f64> =
            (0..n).map(|row| f64::from(uniform(&mut stream(1, "pose", &[row]), -1.0, 1.0))).collect();
        let mean = draws.iter().sum::<f64>() / n as f64;
        let variance = draws.iter().map(|x| x * x).sum::<f64>() / n as f64;
        let lagged = draws.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / n as f64;
        assert!(mean.abs() < 0.02, "mean {mean}");
        assert!((variance - 1.0 / 3.0).abs() < 0.01, "variance {variance}");
        assert!(lagged.abs() < 0.01, "correlation of neighbours {lagged}");
    }
}
