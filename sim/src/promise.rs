//! Viability thresholds that promise something: how much of the terrain on which a skill fails is let
//! through, bounded from rows that neither trained the predictor nor chose its epoch.

use std::fmt;

use serde::Serialize;

/// Chance that a promise does not hold, over draws of the rows it is computed from.
const ERROR: f64 = 0.05;
/// Thresholds that are tried, from 1 downwards in equal steps.
const STEPS: usize = 1000;

/// What is unsafe, and how much of it may be let through.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Risk {
    /// Terrain is unsafe where a smaller share of its rollouts succeeded.
    pub required_viability: f32,
    /// Largest share of unsafe terrain that may be let through.
    pub alpha: f64,
}

/// The least threshold that keeps a promise, and what it rests on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Promise {
    /// What is promised.
    pub risk: Risk,
    /// The threshold; none when there is too little unsafe terrain to promise anything.
    pub threshold: Option<f32>,
    /// Rows of unsafe terrain that it was computed from.
    pub unsafe_rows: usize,
    /// Of those, rows predicted at or above the threshold.
    pub let_through: usize,
    /// Upper end of the one-sided 95 % interval of the share let through.
    pub upper_bound: Option<f64>,
    /// Share of the other rows that the threshold refuses.
    pub safe_refused: Option<f64>,
}

impl fmt::Display for Promise {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { risk, threshold, unsafe_rows, safe_refused, .. } = self;
        let threshold = threshold.map_or("none".to_owned(), |threshold| format!("{threshold:.3}"));
        write!(
            formatter,
            "threshold {threshold}: at most {} of terrain viable in fewer than {} of rollouts is let through, \
             with 95 % confidence, from {unsafe_rows} such rows; {:.1} % of other terrain refused",
            risk.alpha,
            risk.required_viability,
            100.0 * safe_refused.unwrap_or(f64::NAN)
        )
    }
}

/// The least threshold of 1, 0.999, 0.998 … at which, with 95 % confidence,
///
/// ```text
/// P(predicted ≥ threshold | share of successful rollouts < required viability) ≤ α
/// ```
///
/// for a row of the same distribution as `pairs`: terrain drawn by the collection's mixture, noise,
/// and as many rollouts. Thresholds are tested in a fixed sequence from the strictest down, each by the
/// exact binomial test at 5 %, until one is not shown to be safe; the one before it is the answer. A
/// fixed sequence needs no correction for the number of tests.
///
/// | argument | meaning | shape |
/// |---|---|---|
/// | `pairs` | predicted viability and share of successful rollouts, of rows that had no part in the fit | one a row |
///
/// # Source
/// Angelopoulos, Bates, Candès, Jordan, Lei: *Learn then Test* (2021), arXiv 2110.01052, fixed-sequence
/// testing; the test is Clopper and Pearson's (Biometrika 26, 1934).
pub fn promise(pairs: &[(f32, f32)], risk: Risk) -> Promise {
    let is_unsafe = |label: f32| label < risk.required_viability;
    let unsafe_terrain: Vec<f32> = pairs.iter().filter(|(_, l)| is_unsafe(*l)).map(|(p, _)| *p).collect();
    let n = unsafe_terrain.len();
    // As the selector compares: an f32 against the manifest's value as f32. NaN lets nothing through.
    let passing = |threshold: f32| unsafe_terrain.iter().filter(|p| **p >= threshold).count();
    let thresholds = (0..=STEPS).rev().map(|step| (step as f64 / STEPS as f64) as f32);
    let tested = thresholds.map(|threshold| (threshold, passing(threshold)));
    let safe = tested.take_while(|(_, k)| n > 0 && binomial_cdf(*k, n, risk.alpha) <= ERROR);
    let Some((threshold, let_through)) = safe.last() else {
        return Promise {
            risk,
            threshold: None,
            unsafe_rows: n,
            let_through: 0,
            upper_bound: None,
            safe_refused: None,
        };
    };
    let others = pairs.iter().filter(|(_, label)| !is_unsafe(*label));
    let refused = others.clone().filter(|(predicted, _)| *predicted < threshold).count();
    Promise {
        risk,
        threshold: Some(threshold),
        unsafe_rows: n,
        let_through,
        upper_bound: Some(upper_bound(let_through, n)),
        safe_refused: (n < pairs.len()).then(|| refused as f64 / others.count() as f64),
    }
}

/// The most events among `n` draws by which a share of at most `alpha` is still shown, with the chance
/// `error` of being wrong; none where `n` draws without one do not show it.
pub fn most_allowed(n: usize, alpha: f64, error: f64) -> Option<usize> {
    (0..=n).take_while(|k| binomial_cdf(*k, n, alpha) <= error).last()
}

/// The most events among `n` draws that a share of `alpha` gives but for the chance `error`: more of them
/// speak against the share.
pub fn most_usual(n: usize, alpha: f64, error: f64) -> usize {
    (0..n).find(|k| 1.0 - binomial_cdf(*k, n, alpha) <= error).unwrap_or(n)
}

/// Upper end of the one-sided 95 % interval of a share, `k` of `n` seen: the share at which so few
/// would be seen in 5 % of cases.
///
/// # Source
/// Clopper, Pearson: *The use of confidence or fiducial limits illustrated in the case of the binomial*,
/// Biometrika 26 (1934).
pub fn upper_bound(k: usize, n: usize) -> f64 {
    bound(k, n, ERROR)
}

/// [`upper_bound`] with another chance of `error`.
pub fn bound(k: usize, n: usize, error: f64) -> f64 {
    if k >= n {
        return 1.0;
    }
    let (mut low, mut high) = (k as f64 / n as f64, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if binomial_cdf(k, n, middle) > error { low = middle } else { high = middle }
    }
    high
}

/// `P(X ≤ k)`, X binomial of `n` draws with probability `p` inside 0 to 1.
fn binomial_cdf(k: usize, n: usize, p: f64) -> f64 {
    if k >= n {
        return 1.0;
    }
    let [n_f, log_p, log_q] = [n as f64, libm::log(p), libm::log1p(-p)];
    let log_choose = |j: f64| libm::lgamma(n_f + 1.0) - libm::lgamma(j + 1.0) - libm::lgamma(n_f - j + 1.0);
    let term = |j: usize| libm::exp(log_choose(j as f64) + j as f64 * log_p + (n - j) as f64 * log_q);
    (0..=k).map(term).sum::<f64>().min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::stream;
    use rand::RngExt;

    const RISK: Risk = Risk { required_viability: 0.5, alpha: 0.05 };

    #[test]
    fn the_interval_has_its_published_values() {
        // The rule of three: nothing seen in 59 draws bounds a share by 5 %.
        assert!((upper_bound(0, 59) - 0.0495).abs() < 1e-4, "{}", upper_bound(0, 59));
        // R: binom.test(3, 100, alternative = "less")$conf.int
        assert!((upper_bound(3, 100) - 0.075_711).abs() < 1e-5, "{}", upper_bound(3, 100));
        assert_eq!(upper_bound(7, 7), 1.0);
    }

    #[test]
    fn so_many_events_are_allowed_as_bound_a_share() {
        assert_eq!(most_allowed(58, 0.05, ERROR), None);
        assert_eq!(most_allowed(59, 0.05, ERROR), Some(0));
        let k = most_allowed(1600, 0.01, ERROR).unwrap();
        assert!(upper_bound(k, 1600) <= 0.01 && upper_bound(k + 1, 1600) > 0.01, "{k}");
        assert!(most_allowed(1600, 0.01, ERROR / 16.0) < Some(k));
    }

    #[test]
    fn more_events_than_usual_speak_against_a_share() {
        // R: qbinom(0.95, 50, 0.01), qbinom(1 - 0.05 / 32, 50, 0.01), qbinom(0.95, 100, 0.5)
        assert_eq!(most_usual(50, 0.01, ERROR), 2);
        assert_eq!(most_usual(50, 0.01, ERROR / 32.0), 4);
        assert_eq!(most_usual(100, 0.5, ERROR), 58);
        assert_eq!(most_usual(3, 0.999, ERROR), 3);
    }

    #[test]
    fn too_little_unsafe_terrain_promises_nothing() {
        let rows = |n: usize| vec![(0.1, 0.0); n];
        assert_eq!(promise(&rows(58), RISK).threshold, None);
        assert_eq!(promise(&[], RISK).threshold, None);
        assert_eq!(promise(&[(0.9, 1.0); 500], RISK).threshold, None);
        // Nothing predicted above 0.1 in 59 rows: the step above it is the least that lets none through.
        assert_eq!(promise(&rows(59), RISK).threshold, Some(0.101));
    }

    #[test]
    fn a_row_that_fails_at_a_high_prediction_raises_the_threshold() {
        let mut pairs = vec![(0.2, 0.0); 70];
        pairs.extend([(0.99, 1.0); 100]);
        let before = promise(&pairs, RISK);
        pairs[0].0 = 0.97;
        let after = promise(&pairs, RISK);
        assert_eq!((before.threshold, before.safe_refused), (Some(0.201), Some(0.0)));
        assert_eq!((after.threshold, after.let_through), (Some(0.971), 0));
    }

    /// A world whose predictions are too sure: viability v, predicted as v + ¼·(1 − v) with noise.
    fn draw(rows: usize, seed: u64) -> Vec<(f32, f32)> {
        let mut rng = stream(seed, "test/threshold", &[]);
        let mut row = || {
            let viability: f32 = if rng.random::<f32>() < 0.5 { rng.random() } else { 1.0 };
            let successes = (0..3).filter(|_| rng.random::<f32>() < viability).count();
            let predicted = viability + 0.25 * (1.0 - viability) * rng.random::<f32>();
            (predicted, successes as f32 / 3.0)
        };
        (0..rows).map(|_| row()).collect()
    }

    #[test]
    fn the_promise_is_broken_in_no_more_than_one_draw_of_twenty() {
        let population: Vec<(f32, f32)> = draw(200_000, 0).into_iter().filter(|(_, l)| *l < 0.5).collect();
        let let_through = |threshold: f32| {
            population.iter().filter(|(p, _)| *p >= threshold).count() as f64 / population.len() as f64
        };
        let (mut broken, mut loose) = (0, 0);
        let draws = 400;
        for seed in 1..=draws {
            let found = promise(&draw(1500, seed), RISK);
            let share = let_through(found.threshold.unwrap());
            broken += usize::from(share > RISK.alpha);
            loose += usize::from(share > 0.4 * RISK.alpha);
        }
        // Of 400 draws 20 may break it; 32 would be seen once in a hundred times at 5 %.
        assert!(broken <= 32, "{broken} of {draws} broken");
        assert!(loose > draws as usize / 2, "the threshold is stricter than it has to be: {loose}");
    }
}
