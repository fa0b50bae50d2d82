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

/// Whether a row is held out: about one in ten, by its number alone, so that neither the seed of a
/// training nor more data moves a row from one side to the other.
pub fn is_held_out(row: u64) -> bool {
    stream(0, "train/held-out", &[row]).random::<f32>() < 0.1
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
    fn one_row_in_ten_is_held_out_and_always_the_same() {
        let held_out = (0..5000).filter(|row| is_held_out(*row)).count();
        assert!((420..580).contains(&held_out), "{held_out} of 5000");
        let again: Vec<u64> = (0..5000).filter(|row| is_held_out(*row)).collect();
        assert_eq!(again.len(), held_out);
        assert!(again.iter().all(|row| is_held_out(*row)));
    }
}
