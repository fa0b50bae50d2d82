//! What a predictor is fitted to: fields and labels, and the split that holds some of them out.

use rand::RngExt;
use vocaloco_sim::stream::stream;

use super::kernel::FieldCells;

/// One sample: a heightfield and what was measured on it.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Row number in the data set.
    pub row: u64,
    /// Heights as the networks see them, noise included: `[31][11]` row-major, metres, centred.
    pub field: FieldCells,
    /// Viability (share of successful rollouts) or cost of transport.
    pub label: f32,
}

/// What a row is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Its gradient is followed.
    TrainedOn,
    /// Its loss chooses the epoch.
    HeldOut,
    /// It has no part in the fit: scores and thresholds come from it.
    KeptBack,
}

/// The part of a row: about one in ten held out and one in ten kept back, by its number alone, so that
/// neither the seed of a training nor more data moves a row from one part to another.
pub fn part(row: u64) -> Part {
    match stream(0, "train/held-out", &[row]).random::<f32>() {
        drawn if drawn < 0.1 => Part::HeldOut,
        drawn if drawn < 0.2 => Part::KeptBack,
        _ => Part::TrainedOn,
    }
}

/// Mean and standard deviation of the labels; a deviation of zero is told as 1.
pub fn label_scale(samples: &[&Sample]) -> (f32, f32) {
    let n = samples.len().max(1) as f64;
    let mean = samples.iter().map(|s| f64::from(s.label)).sum::<f64>() / n;
    let variance = samples.iter().map(|s| (f64::from(s.label) - mean).powi(2)).sum::<f64>() / n;
    let deviation = variance.sqrt() as f32;
    (mean as f32, if deviation > 1e-6 { deviation } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_row_in_ten_is_held_out_another_kept_back_and_always_the_same() {
        for wanted in [Part::HeldOut, Part::KeptBack] {
            let rows: Vec<u64> = (0..5000).filter(|row| part(*row) == wanted).collect();
            assert!((420..580).contains(&rows.len()), "{wanted:?}: {} of 5000", rows.len());
            assert!(rows.iter().all(|row| part(*row) == wanted));
        }
    }
}
