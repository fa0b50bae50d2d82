//! The exponential linear unit, in arithmetic that the compiler turns into vector instructions.

/// `eˣ` for `x ≤ 0`, within 2 units in the last place; the same bits on every processor.
///
/// ```text
/// n = round(x / ln 2)     r = x − n·ln 2     eˣ = 2ⁿ · Σ_{k=0}^{6} rᵏ / k!
/// ```
///
/// Below −87 the answer is that of −87 (1.6e-38). NaN stays NaN.
///
/// # Source
/// Cody and Waite, *Software Manual for the Elementary Functions*, 1980: the two parts of ln 2.
#[inline]
pub(super) fn exp_of_negative(x: f32) -> f32 {
    /// 1.5·2²³: adding it rounds a small number to an integer, which then stands in the low bits.
    const ROUNDER: f32 = 12_582_912.0;
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    let x = if x < -87.0 { -87.0 } else { x };
    let rounded = x * std::f32::consts::LOG2_E + ROUNDER;
    let n = rounded - ROUNDER;
    let r = (x - n * LN_2_HIGH) - n * LN_2_LOW;
    let tail = 0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0))));
    let mantissa = 1.0 + (r + r * r * tail);
    let power = rounded.to_bits().wrapping_sub(ROUNDER.to_bits()).wrapping_add(127) << 23;
    mantissa * f32::from_bits(power)
}

/// `x` where it is positive, `eˣ − 1` where not.
#[inline]
pub(super) fn elu(x: f32) -> f32 {
    let below = exp_of_negative(if x > 0.0 { 0.0 } else { x }) - 1.0;
    if x > 0.0 { x } else { below }
}

/// Derivative of [`elu`] by `x`, told by its answer `y`: 1 where positive, `y + 1` where not.
#[inline]
pub(super) fn elu_slope(y: f32) -> f32 {
    if y > 0.0 { 1.0 } else { y + 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_within_two_units_in_the_last_place() {
        for k in 0..80_000 {
            let x = -87.0 * k as f32 / 80_000.0;
            let wanted = libm::exp(f64::from(x));
            let found = f64::from(exp_of_negative(x));
            assert!(
                (found / wanted - 1.0).abs() < 2.5 * f64::from(f32::EPSILON),
                "at {x}: {found} against {wanted}"
            );
        }
        assert_eq!(exp_of_negative(0.0), 1.0);
    }

    #[test]
    fn a_nan_stays_one() {
        assert!(elu(f32::NAN).is_nan());
    }

    #[test]
    fn elu_is_the_identity_above_zero_and_ends_at_minus_one() {
        assert_eq!((elu(2.5), elu(0.0), elu(-500.0)), (2.5, 0.0, -1.0));
        assert!((elu(-0.5) - (libm::expf(-0.5) - 1.0)).abs() < 1e-7);
        assert_eq!((elu_slope(2.5), elu_slope(-1.0)), (1.0, 0.0));
    }
}
