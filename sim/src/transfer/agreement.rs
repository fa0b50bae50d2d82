//! How far two success rates over the same poses are apart.

use serde::Serialize;

use crate::evaluate::wilson;

/// The difference of two shares, in points (hundredths).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// Number of pairs.
    pub n: u64,
    /// Second minus first.
    pub points: f64,
    /// Lower end of its 95 % interval.
    pub points_low: f64,
    /// Upper end of its 95 % interval.
    pub points_high: f64,
}

/// Difference of the shares of success of two trials of the same items, second minus first, with its
/// 95 % interval.
///
/// ```text
/// D = p₂ − p₁,   from D − √(δ₂² − 2φδ₂ε₁ + ε₁²)  to  D + √(ε₂² − 2φε₂δ₁ + δ₁²)
/// δ = p − lower, ε = upper − p  (Wilson),   φ = (ad − bc) / √((a+b)(c+d)(a+c)(b+d))
/// ```
///
/// with a, b, c, d the pairs of which both, the first alone, the second alone, neither succeeded, and
/// φ = 0 where its denominator is 0.
///
/// # Source
/// R. G. Newcombe, Stat. Med. 17, 2635 (1998), method 8.
pub fn agreement(pairs: impl IntoIterator<Item = (bool, bool)>) -> Agreement {
    let [mut both, mut first, mut second, mut neither] = [0_usize; 4];
    for pair in pairs {
        match pair {
            (true, true) => both += 1,
            (true, false) => first += 1,
            (false, true) => second += 1,
            (false, false) => neither += 1,
        }
    }
    let n = both + first + second + neither;
    if n == 0 {
        return Agreement { n: 0, points: 0.0, points_low: -100.0, points_high: 100.0 };
    }
    let share = |count: usize| count as f64 / n as f64;
    let half_widths = |successes: usize| {
        let [low, high] = wilson(successes, n);
        (share(successes) - low, high - share(successes))
    };
    let [a, b, c, d] = [both, first, second, neither].map(|count| count as f64);
    let square = (a + b) * (c + d) * (a + c) * (b + d);
    let phi = if square > 0.0 { (a * d - b * c) / square.sqrt() } else { 0.0 };
    let (below_first, above_first) = half_widths(both + first);
    let (below_second, above_second) = half_widths(both + second);
    let joined = |x: f64, y: f64| (x * x - 2.0 * phi * x * y + y * y).max(0.0).sqrt();
    let difference = share(both + second) - share(both + first);
    Agreement {
        n: n as u64,
        points: 100.0 * difference,
        points_low: 100.0 * (difference - joined(below_second, above_first)),
        points_high: 100.0 * (difference + joined(above_second, below_first)),
    }
}
