//! Max-pooling 2×2, stride 2: an odd last row or column is left out, as PyTorch leaves it.

use super::conv::Plane;
use super::lanes::{LANES, Lanes};

/// `y[row][column] = max x[2·row ..][2·column ..]`; both planes carry their border.
#[inline(always)]
pub(crate) fn forward<const PH: usize, const PW: usize, const QH: usize, const QW: usize>(
    x: &[Plane<PH, PW>],
    y: &mut [Plane<QH, QW>],
) {
    for (x, y) in x.iter().zip(y) {
        for row in 0..QH - 2 {
            for column in 0..QW - 2 {
                let (r, c) = (2 * row + 1, 2 * column + 1);
                let window = [&x[r][c], &x[r][c + 1], &x[r + 1][c], &x[r + 1][c + 1]];
                let mut highest = *window[0];
                for other in &window[1..] {
                    for (highest, other) in highest.0.iter_mut().zip(&other.0) {
                        *highest = if *other > *highest { *other } else { *highest };
                    }
                }
                y[row + 1][column + 1] = highest;
            }
        }
    }
}

/// Hands each gradient to the first cell of its window that holds the maximum; all others get 0.
#[inline(always)]
pub(crate) fn input_gradient<const PH: usize, const PW: usize, const QH: usize, const QW: usize>(
    x: &[Plane<PH, PW>],
    y: &[Plane<QH, QW>],
    dy: &[Plane<QH, QW>],
    dx: &mut [Plane<PH, PW>],
) {
    for (((x, y), dy), dx) in x.iter().zip(y).zip(dy).zip(dx) {
        for row in 0..QH - 2 {
            for column in 0..QW - 2 {
                let highest = &y[row + 1][column + 1];
                let mut left = dy[row + 1][column + 1];
                for (u, v) in [(1, 1), (1, 2), (2, 1), (2, 2)] {
                    let x = &x[2 * row + u][2 * column + v];
                    let mut routed = Lanes::ZERO;
                    for lane in 0..LANES {
                        let here = x.0[lane] >= highest.0[lane];
                        routed.0[lane] = if here { left.0[lane] } else { 0.0 };
                        left.0[lane] = if here { 0.0 } else { left.0[lane] };
                    }
                    dx[2 * row + u][2 * column + v] = routed;
                }
            }
        }
    }
}
