//! How well predictions match what was collected. Every function takes `(predicted, collected)`
//! pairs, one a heightfield; a collected viability is the share of its rollouts that succeeded.

use serde::Serialize;

/// Bins of the expected calibration error.
pub const ECE_BINS: usize = 15;

/// Mean squared difference between the predicted probability and single rollouts' outcomes.
///
/// ```text
/// Brier = 1/n Σ [(p − l)² + l·(1 − l)]
/// ```
///
/// With one rollout a field the second term vanishes; with more it is the scatter of single outcomes
/// around their share `l`, so that data sets with different numbers of rollouts compare.
pub fn brier(pairs: &[(f32, f32)]) -> f64 {
    mean(pairs.iter().map(|(p, l)| {
        let (p, l) = (f64::from(*p), f64::from(*l));
        (p - l).powi(2) + l * (1.0 - l)
    }))
}

/// Mean squared difference from what was collected.
pub fn mse(pairs: &[(f32, f32)]) -> f64 {
    mean(pairs.iter().map(|(p, l)| (f64::from(*p) - f64::from(*l)).powi(2)))
}

/// Expected calibration error over [`ECE_BINS`] equal bins of the predicted probability.
///
/// ```text
/// ECE = Σ_bin n_bin/n · |mean p − mean l|
/// ```
pub fn ece(pairs: &[(f32, f32)]) -> f64 {
    let gaps = reliability(pairs, ECE_BINS)
        .into_iter()
        .map(|bin| bin.n as f64 * (bin.predicted - bin.collected).abs());
    gaps.sum::<f64>() / pairs.len() as f64
}

/// One bin of a reliability diagram.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Bin {
    /// Fields whose prediction falls into it.
    pub n: usize,
    /// Their mean predicted probability.
    pub predicted: f64,
    /// The share of their rollouts that succeeded.
    pub collected: f64,
}

/// The bins that hold anything, from the lowest prediction up.
pub fn reliability(pairs: &[(f32, f32)], bins: usize) -> Vec<Bin> {
    let mut sums = vec![(0_usize, 0.0, 0.0); bins];
    for (p, l) in pairs {
        let (n, predicted, collected) = &mut sums[((p * bins as f32) as usize).min(bins - 1)];
        *n += 1;
        *predicted += f64::from(*p);
        *collected += f64::from(*l);
    }
    let filled = sums.into_iter().filter(|(n, ..)| *n > 0);
    filled.map(|(n, p, l)| Bin { n, predicted: p / n as f64, collected: l / n as f64 }).collect()
}

/// Area under the ROC curve: the chance that a successful rollout's field was predicted higher than
/// a failed one's, ties counting half. `None` when all succeeded or all failed.
///
/// A field with share `l` counts as `l` successes and `1 − l` failures.
pub fn auc(pairs: &[(f32, f32)]) -> Option<f64> {
    let mut sorted = pairs.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut failures_below, mut wins, mut successes) = (0.0, 0.0, 0.0);
    for tied in sorted.chunk_by(|a, b| a.0.total_cmp(&b.0).is_eq()) {
        let here: f64 = tied.iter().map(|(_, l)| f64::from(*l)).sum();
        let failed = tied.len() as f64 - here;
        wins += here * (failures_below + 0.5 * failed);
        failures_below += failed;
        successes += here;
    }
    let comparisons = successes * failures_below;
    (comparisons > 0.0).then(|| wins / comparisons)
}

/// Mean absolute difference.
pub fn mae(pairs: &[(f32, f32)]) -> f64 {
    mean(pairs.iter().map(|(p, l)| f64::from(p - l).abs()))
}

/// Share of the collected values' variance that the predictions explain; `None` when they do not vary.
///
/// ```text
/// R² = 1 − Σ (p − l)² / Σ (l − mean l)²
/// ```
pub fn r2(pairs: &[(f32, f32)]) -> Option<f64> {
    let centre = mean(pairs.iter().map(|(_, l)| f64::from(*l)));
    let spread: f64 = pairs.iter().map(|(_, l)| (f64::from(*l) - centre).powi(2)).sum();
    let left: f64 = pairs.iter().map(|(p, l)| f64::from(p - l).powi(2)).sum();
    (spread > 0.0).then(|| 1.0 - left / spread)
}

/// Mean and standard deviation, both `NaN` of nothing.
pub fn mean_and_deviation(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let centre = mean(values.clone());
    (centre, mean(values.map(|value| (value - centre).powi(2))).sqrt())
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = values.fold((0_usize, 0.0), |(n, sum), value| (n + 1, sum + value));
    sum / n as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brier_counts_single_outcomes_whatever_the_number_of_rollouts() {
        // Two fields of one rollout each, and one field of two rollouts with one success.
        let single = brier(&[(0.7, 1.0), (0.7, 0.0)]);
        let shared = brier(&[(0.7, 0.5)]);
        assert!((single - shared).abs() < 1e-7, "{single} {shared}");
        assert!((single - 0.29).abs() < 1e-7);
    }

    #[test]
    fn calibrated_predictions_have_no_calibration_error_and_shifted_ones_their_shift() {
        let honest: Vec<(f32, f32)> = (0..1000)
            .map(|k| {
                (if k < 500 { 0.2 } else { 0.9 }, f32::from(u8::from(k % 10 < if k < 500 { 2 } else { 9 })))
            })
            .collect();
        assert!(ece(&honest) < 1e-6);
        let shifted: Vec<(f32, f32)> = honest.iter().map(|(p, l)| (p - 0.1, *l)).collect();
        assert!((ece(&shifted) - 0.1).abs() < 1e-6);
    }

    #[test]
    fn auc_is_the_share_of_pairs_in_the_right_order() {
        assert_eq!(auc(&[(0.1, 0.0), (0.2, 1.0), (0.3, 0.0), (0.4, 1.0)]), Some(0.75));
        assert_eq!(auc(&[(0.5, 0.0), (0.5, 1.0)]), Some(0.5));
        assert_eq!(auc(&[(0.5, 1.0), (0.6, 1.0)]), None);
        // A share of one half is one success and one failure at the same prediction.
        assert_eq!(auc(&[(0.5, 0.5)]), Some(0.5));
    }

    #[test]
    fn r2_is_one_for_the_truth_and_zero_for_the_mean() {
        let truth = [(1.0, 1.0), (2.0, 2.0), (4.5, 4.5)];
        assert_eq!(r2(&truth), Some(1.0));
        let only_the_mean = truth.map(|(_, l)| (2.5, l));
        assert!(r2(&only_the_mean).unwrap().abs() < 1e-9);
        assert_eq!(r2(&[(1.0, 3.0), (2.0, 3.0)]), None);
        assert!((mae(&only_the_mean) - (1.5 + 0.5 + 2.0) / 3.0).abs() < 1e-6);
    }
}
