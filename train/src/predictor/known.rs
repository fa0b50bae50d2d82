//! What terrain a predictor knows, fitted to the fields that it is fitted to.
//!
//! Directions from the rows trained on, the scale of each measure and the limit from those held out,
//! the rate of false flags from those kept back: no row serves twice.

use rayon::prelude::*;
use serde::Serialize;
use vocaloco_core::heightfield::{CELLS, Field};
use vocaloco_core::predictor::known_terrain::{COMPONENTS, KnownTerrain};

use super::kernel::FieldCells;
use super::samples::{Part, Sample, part};
use vocaloco_sim::promise::upper_bound;

/// Largest share of known terrain that may be flagged, with 95 % confidence where the rows suffice.
pub const FALSE_FLAGS: f64 = 0.01;
/// Share of the held-out fields below the scale of a measure; the common limit corrects it.
const SCALE_SHARE: f64 = 0.996;
/// Fields that directions are fitted to at most: more change them by less than their noise.
const FITTED_TO: usize = 20_000;
/// Rounds of the iteration that finds the directions.
const ROUNDS: usize = 60;

/// A check of terrain, and what it was measured on.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The check.
    pub known: KnownTerrain,
    /// How often it flags terrain of the data set.
    pub flags: Flags,
}

/// How many of some fields are flagged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Flags {
    /// Fields.
    pub n: usize,
    /// Of those, flagged.
    pub flagged: usize,
}

impl Flags {
    /// Of fields, by a check.
    pub fn count<'a>(known: &KnownTerrain, fields: impl Iterator<Item = &'a FieldCells>) -> Self {
        let mut flags = Self::default();
        for field in fields {
            flags.n += 1;
            // A field that is not finite does not get here: the fit refuses it.
            let is_known = Field::from_slice(field).is_some_and(|field| known.strangeness(&field) <= 1.0);
            flags.flagged += usize::from(!is_known);
        }
        flags
    }

    /// The share flagged; none of nothing.
    pub fn share(self) -> Option<f64> {
        (self.n > 0).then(|| self.flagged as f64 / self.n as f64)
    }
}

/// Fits the check to a data set's samples; none when a part of them is empty.
///
/// The limit is the least at which no more than [`FALSE_FLAGS`] of known terrain is flagged, with 95 %
/// confidence by the exact binomial bound; where fewer than 299 rows are held out, the strangest of them.
pub fn fit(samples: &[Sample]) -> Option<Fitted> {
    let fields = |wanted: Part| {
        samples.iter().filter(move |sample| part(sample.row) == wanted).map(|sample| &sample.field)
    };
    let trained_on: Vec<&FieldCells> = fields(Part::TrainedOn).take(FITTED_TO).collect();
    let held_out: Vec<&FieldCells> = fields(Part::HeldOut).collect();
    if trained_on.is_empty() || held_out.is_empty() {
        return None;
    }
    let (mean, components, variance) = directions(&trained_on);
    let known = KnownTerrain::new(&mean, &components, variance, [1.0; 3]);
    let measures: Vec<[f32; 3]> = held_out.par_iter().map(|field| known.measures(field)).collect();
    let scales: [f32; 3] = std::array::from_fn(|which| {
        let mut values: Vec<f32> = measures.iter().map(|measures| measures[which]).collect();
        values.sort_by(f32::total_cmp);
        let rank = (SCALE_SHARE * values.len() as f64).ceil() as usize;
        values[rank.clamp(1, values.len()) - 1].max(1e-6)
    });
    let largest = |measures: &[f32; 3]| {
        measures.iter().zip(&scales).map(|(measure, scale)| measure / scale).fold(0.0, f32::max)
    };
    let mut strangeness: Vec<f32> = measures.iter().map(largest).collect();
    strangeness.sort_by(|a, b| b.total_cmp(a));
    let n = strangeness.len();
    let allowed = (0..n).take_while(|flagged| upper_bound(*flagged, n) <= FALSE_FLAGS).last().unwrap_or(0);
    // A hair more, so that the row at the limit is inside after rounding.
    let limit = 1.0001 * strangeness[allowed];
    let known = known.with_limits(scales.map(|scale| limit * scale));
    let flags = Flags::count(&known, fields(Part::KeptBack));
    Some(Fitted { known, flags })
}

/// The mean, the [`COMPONENTS`] directions in which the fields, each less its own mean, differ most, and
/// their variances.
///
/// Orthogonal iteration on the covariance, in f64 and in one order: the same bytes on every machine.
fn directions(fields: &[&FieldCells]) -> ([f32; CELLS], Vec<[f32; CELLS]>, [f32; COMPONENTS]) {
    let levelled = |field: &FieldCells| {
        let mean = field.iter().map(|height| f64::from(*height)).sum::<f64>() / CELLS as f64;
        field.map(|height| f64::from(height) - mean)
    };
    let n = fields.len() as f64;
    let mut mean = [0.0; CELLS];
    for field in fields {
        mean.iter_mut().zip(levelled(field)).for_each(|(mean, height)| *mean += height / n);
    }
    let deviations: Vec<[f64; CELLS]> = fields
        .iter()
        .map(|field| {
            let mut field = levelled(field);
            field.iter_mut().zip(&mean).for_each(|(height, mean)| *height -= mean);
            field
        })
        .collect();
    let row = |i: usize| {
        let mut row = [0.0; CELLS];
        for deviation in &deviations {
            let scale = deviation[i] / n;
            row.iter_mut().zip(deviation).for_each(|(sum, other)| *sum += scale * other);
        }
        row
    };
    let covariance: Vec<[f64; CELLS]> = (0..CELLS).into_par_iter().map(row).collect();
    let times =
        |vector: &[f64; CELLS]| -> [f64; CELLS] { std::array::from_fn(|i| dot(&covariance[i], vector)) };
    let mut found: Vec<[f64; CELLS]> = (0..COMPONENTS)
        .map(|k| {
            std::array::from_fn(|cell| {
                libm::cos((k + 1) as f64 * (cell as f64 + 0.5) * std::f64::consts::PI / CELLS as f64)
            })
        })
        .collect();
    for _ in 0..ROUNDS {
        found = found.iter().map(times).collect();
        orthonormalise(&mut found);
    }
    let variance = std::array::from_fn(|k| dot(&found[k], &times(&found[k])).max(1e-6) as f32);
    let components = found.iter().map(|direction| direction.map(|value| value as f32)).collect();
    (mean.map(|value| value as f32), components, variance)
}

/// Gram and Schmidt's, in order; a direction that the others hold already becomes zero.
fn orthonormalise(vectors: &mut [[f64; CELLS]]) {
    for k in 0..vectors.len() {
        let (before, rest) = vectors.split_at_mut(k);
        let Some(vector) = rest.first_mut() else { return };
        // Twice, since once leaves what rounding has put back.
        for other in before.iter().chain(before.iter()) {
            let along = dot(other, vector);
            vector.iter_mut().zip(other).for_each(|(value, other)| *value -= along * other);
        }
        let length = dot(vector, vector).sqrt();
        let scale = if length > 1e-12 { 1.0 / length } else { 0.0 };
        for value in vector {
            *value *= scale;
        }
    }
}

fn dot(a: &[f64; CELLS], b: &[f64; CELLS]) -> f64 {
    let mut sums = [0.0; 4];
    for (a, b) in a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    sums.iter().sum::<f64>() + a[CELLS - 1] * b[CELLS - 1]
}

const _: () = assert!(CELLS % 4 == 1, "one cell is left of the sums of four");

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use vocaloco_sim::stream::{stream, uniform};

    /// Steps up or down somewhere ahead, under noise of ± `noise_m`; with a gap across when `gap`.
    fn sample(row: u64, noise_m: f32, gap: bool) -> Sample {
        let mut rng = stream(row, "test/known", &[]);
        let (height, edge) = (uniform(&mut rng, -0.4, 0.4), rng.random_range(4..28));
        let mut field = [0.0; CELLS];
        for (at, cell) in field.iter_mut().enumerate() {
            let i = at / 11;
            // A gap is seen where the floor around it is not clipped itself.
            let rise = if gap { 0.25 * height } else { height };
            let floor = rise * (i.saturating_sub(edge) / 3) as f32;
            let hole = if gap && (18..22).contains(&i) { -1.0 } else { 0.0 };
            *cell = (floor + hole).clamp(-1.0, 1.0) + uniform(&mut rng, -noise_m, noise_m);
        }
        Sample { row, field, label: 1.0 }
    }

    #[test]
    fn a_check_flags_what_was_left_out_and_hardly_anything_that_was_not() {
        let known: Vec<Sample> = (0..5000).map(|row| sample(row, 0.1, false)).collect();
        let fitted = fit(&known).unwrap();
        assert!(fitted.flags.n > 400 && fitted.flags.share().unwrap() <= 0.015, "{:?}", fitted.flags);
        let flagged = |noise_m: f32, gap: bool| {
            let fresh: Vec<Sample> = (10_000..10_500).map(|row| sample(row, noise_m, gap)).collect();
            Flags::count(&fitted.known, fresh.iter().map(|sample| &sample.field)).share().unwrap()
        };
        assert!(flagged(0.1, false) <= 0.015 && flagged(0.0, false) <= 0.015);
        assert!(flagged(0.1, true) > 0.95 && flagged(0.0, true) > 0.95);
    }

    #[test]
    fn the_number_of_threads_changes_no_bit() {
        let samples: Vec<Sample> = (0..300).map(|row| sample(row, 0.1, false)).collect();
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| fit(&samples).unwrap().known.to_text())
        };
        assert_eq!(on(1), on(2));
    }

    #[test]
    fn components_are_orthonormal_and_in_order_of_their_variance() {
        let samples: Vec<Sample> = (0..400).map(|row| sample(row, 0.1, false)).collect();
        let fields: Vec<&FieldCells> = samples.iter().map(|sample| &sample.field).collect();
        let (_, components, variance) = directions(&fields);
        for (i, a) in components.iter().enumerate() {
            for (j, b) in components.iter().enumerate() {
                let product: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                let wanted = if i == j { 1.0 } else { 0.0 };
                assert!((product - wanted).abs() < 1e-4, "{i} and {j}: {product}");
            }
        }
        assert!(variance[0] > variance[1] && variance[1] > variance[4], "{variance:?}");
    }

    #[test]
    fn nothing_is_known_of_no_rows() {
        assert_eq!(fit(&[]), None);
    }
}
