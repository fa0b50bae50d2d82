//! Terrain that no data set has: noise alone, and ground as an elevation map shows it.

use rand_chacha::ChaCha8Rng;
use vocaloco_core::heightfield::{CELLS, COLUMNS, Heightfield, Noise};
use vocaloco_sim::stream::{stream, uniform};

use super::super::kernel::FieldCells;

/// Draws one field.
type Maker = fn(&mut ChaCha8Rng) -> FieldCells;

/// Kinds by name: fields with the fields' noise, and the same without.
pub(super) fn all(
    samples: u64,
    seed: u64,
    noise_m: f32,
) -> Vec<(&'static str, Vec<FieldCells>, Vec<FieldCells>)> {
    let kinds: [(&str, Maker); 3] = [
        ("noise of ±0.3 m", |rng| noise(rng, 0.3)),
        ("noise of ±0.5 m", |rng| noise(rng, 0.5)),
        ("elevation map", elevation_map),
    ];
    let made = kinds.map(|(name, make)| {
        let fields = (0..samples).map(|index| {
            let mut rng = stream(seed, "novelty", &[name.len() as u64, index]);
            let raw = make(&mut rng);
            let added: Noise =
                std::array::from_fn(|_| std::array::from_fn(|_| uniform(&mut rng, -noise_m, noise_m)));
            (prepared(&raw, Some(&added)), prepared(&raw, None))
        });
        let (noisy, clean) = fields.unzip();
        (name, noisy, clean)
    });
    made.into()
}

fn prepared(raw: &FieldCells, noise: Option<&Noise>) -> FieldCells {
    let cells_m = std::array::from_fn(|i| std::array::from_fn(|j| raw[i * COLUMNS + j]));
    // Heights and noise made here are finite, so there is nothing to refuse.
    Heightfield { cells_m }.prepare(noise).map_or([0.0; CELLS], |field| *field.as_slice())
}

/// Every cell for itself.
fn noise(rng: &mut ChaCha8Rng, half_width_m: f32) -> FieldCells {
    std::array::from_fn(|_| uniform(rng, -half_width_m, half_width_m))
}

/// Rolling, broken ground: smooth noise of wavelengths from 1.6 m down to 0.2 m, each half as high as
/// the one before, scaled to a standard deviation of 10 to 35 cm.
fn elevation_map(rng: &mut ChaCha8Rng) -> FieldCells {
    let mut field = [0.0; CELLS];
    let mut height = 1.0;
    for spacing in [16.0, 8.0, 4.0, 2.0_f32] {
        let knots: Vec<f32> = (0..20 * 20).map(|_| uniform(rng, -height, height)).collect();
        let offset = [uniform(rng, 0.0, 1.0), uniform(rng, 0.0, 1.0)];
        for (at, cell) in field.iter_mut().enumerate() {
            let [x, y] =
                [(at / COLUMNS) as f32 / spacing + offset[0], (at % COLUMNS) as f32 / spacing + offset[1]];
            let knot = |i: usize, j: usize| knots[(x as usize + i) * 20 + y as usize + j];
            let [u, v] = [x.fract(), y.fract()].map(|t| t * t * (3.0 - 2.0 * t));
            let across = |i: usize| knot(i, 0) + v * (knot(i, 1) - knot(i, 0));
            *cell += across(0) + u * (across(1) - across(0));
        }
        height *= 0.5;
    }
    let mean = field.iter().sum::<f32>() / CELLS as f32;
    let deviation = (field.iter().map(|h| (h - mean).powi(2)).sum::<f32>() / CELLS as f32).sqrt();
    let scale = uniform(rng, 0.1, 0.35) / deviation.max(1e-3);
    field.map(|height| scale * (height - mean))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_finite_and_differ_and_noise_is_small() {
        for (name, noisy, clean) in all(20, 3, 0.1) {
            assert_eq!((noisy.len(), clean.len()), (20, 20), "{name}");
            assert!(clean[0] != clean[1], "{name}");
            for (noisy, clean) in noisy.iter().zip(&clean) {
                for (a, b) in noisy.iter().zip(clean) {
                    assert!(a.is_finite() && (a - b).abs() <= 0.2 + 1e-5, "{name}: {a} and {b}");
                }
            }
        }
    }
}
