//! Convolution 3×3, stride 1, padding 1, with its two gradients.
//!
//! Planes carry one cell of zeros all round, so that no loop asks whether it stands at the edge. Four
//! channels and up to three columns are summed side by side: each value that is read is used several
//! times, and no sum waits for the one before.

use vocaloco_core::simd::Simd;

use super::lanes::{GROUP, GROUPS, LANES, Lanes, sum};

/// One channel with its border of zeros: `[row + 1][column + 1]`.
pub(crate) type Plane<const PH: usize, const PW: usize> = [[Lanes; PW]; PH];

/// Channels that are summed side by side.
const TOGETHER: usize = 4;
/// Columns likewise, at most.
const COLUMNS: usize = 3;

/// What becomes of a sum.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Behind {
    Relu,
    Nothing,
}

/// `y[o] = bias[o] + Σ_c Σ_uv w[o][c][u][v] · x[c][row + u − 1][column + v − 1]`, one term after the other.
///
/// `weight` is `[o][c][u][v]`, flat.
#[inline(always)]
pub(crate) fn forward<S: Simd, const IN: usize, const PH: usize, const PW: usize>(
    simd: S,
    (weight, bias, behind): (&[f32], &[f32], Behind),
    x: &[Plane<PH, PW>],
    y: &mut [Plane<PH, PW>],
) {
    let weight = weight.as_chunks::<9>().0.as_chunks::<IN>().0.as_chunks::<TOGETHER>().0;
    let bias = bias.as_chunks::<TOGETHER>().0;
    let x: &[Plane<PH, PW>; IN] = x.first_chunk().expect("a plane for each input");
    for ((weight, bias), y) in weight.iter().zip(bias).zip(y.as_chunks_mut::<TOGETHER>().0) {
        for row in 0..PH - 2 {
            for at in (0..LANES).step_by(S::WIDTH) {
                let mut column = 0;
                while column + COLUMNS <= PW - 2 {
                    tile::<S, IN, PH, PW, COLUMNS>(simd, (weight, bias, behind), x, y, [row, column, at]);
                    column += COLUMNS;
                }
                if column + 2 == PW - 2 {
                    tile::<S, IN, PH, PW, 2>(simd, (weight, bias, behind), x, y, [row, column, at]);
                } else if column + 1 == PW - 2 {
                    tile::<S, IN, PH, PW, 1>(simd, (weight, bias, behind), x, y, [row, column, at]);
                }
            }
        }
    }
}

#[inline(always)]
fn tile<S: Simd, const IN: usize, const PH: usize, const PW: usize, const N: usize>(
    simd: S,
    (weight, bias, behind): (&[[[f32; 9]; IN]; TOGETHER], &[f32; TOGETHER], Behind),
    x: &[Plane<PH, PW>; IN],
    y: &mut [Plane<PH, PW>; TOGETHER],
    [row, column, at]: [usize; 3],
) {
    let mut sums = [[simd.splat(0.0); N]; TOGETHER];
    for o in 0..TOGETHER {
        sums[o] = [simd.splat(bias[o]); N];
    }
    for c in 0..IN {
        for u in 0..3 {
            let mut cells = [simd.splat(0.0); COLUMNS + 2];
            for (cell, x) in cells.iter_mut().zip(&x[c][row + u][column..column + N + 2]) {
                *cell = simd.load(&x.0[at..]);
            }
            for v in 0..3 {
                for o in 0..TOGETHER {
                    let weight = simd.splat(weight[o][c][3 * u + v]);
                    for k in 0..N {
                        sums[o][k] = simd.mul_add(weight, cells[k + v], sums[o][k]);
                    }
                }
            }
        }
    }
    for o in 0..TOGETHER {
        for (sum, y) in sums[o].iter().zip(&mut y[o][row + 1][column + 1..column + 1 + N]) {
            let sum = if behind == Behind::Relu { simd.max(*sum, simd.splat(0.0)) } else { *sum };
            simd.store(sum, &mut y.0[at..]);
        }
    }
}

/// The weights with which [`forward`] computes the gradient of its own input from the gradient before the
/// ReLU: `[c][o][u][v]`, each kernel turned.
pub(crate) fn turned<const IN: usize>(weight: &[f32], turned: &mut [f32]) {
    let weight = weight.as_chunks::<9>().0.as_chunks::<IN>().0;
    for (o, of_output) in weight.iter().enumerate() {
        for (c, kernel) in of_output.iter().enumerate() {
            let to = &mut turned.as_chunks_mut::<9>().0[c * weight.len() + o];
            *to = *kernel;
            to.reverse();
        }
    }
}

/// Gradients of weights `[o][c][u][v]` and biases `[o]`, summed over each group of samples.
///
/// `dw[o][c][u][v] = Σ_samples Σ_row,column dy[o][row][column] · x[c][row + u − 1][column + v − 1]`
#[inline(always)]
pub(crate) fn weight_gradient<S: Simd, const IN: usize, const PH: usize, const PW: usize>(
    simd: S,
    x: &[Plane<PH, PW>],
    dy: &[Plane<PH, PW>],
    mut dw: [&mut [f32]; GROUPS],
    mut db: [&mut [f32]; GROUPS],
) {
    for (tile, dy) in dy.as_chunks::<TOGETHER>().0.iter().enumerate() {
        for (c, x) in x.iter().enumerate() {
            for u in 0..3 {
                for at in (0..LANES).step_by(S::WIDTH) {
                    let mut sums = [[simd.splat(0.0); 3]; TOGETHER];
                    for row in 0..PH - 2 {
                        let x = &x[row + u];
                        for column in 0..PW - 2 {
                            let mut cells = [simd.splat(0.0); 3];
                            for v in 0..3 {
                                cells[v] = simd.load(&x[column + v].0[at..]);
                            }
                            for o in 0..TOGETHER {
                                let dy = simd.load(&dy[o][row + 1][column + 1].0[at..]);
                                for v in 0..3 {
                                    sums[o][v] = simd.mul_add(dy, cells[v], sums[o][v]);
                                }
                            }
                        }
                    }
                    for o in 0..TOGETHER {
                        for v in 0..3 {
                            let place = ((tile * TOGETHER + o) * IN + c) * 9 + 3 * u + v;
                            by_group(simd, sums[o][v], at, |group, sum| dw[group][place] = sum);
                        }
                    }
                }
            }
        }
        for at in (0..LANES).step_by(S::WIDTH) {
            let mut sums = [simd.splat(0.0); TOGETHER];
            for row in 1..PH - 1 {
                for column in 1..PW - 1 {
                    for o in 0..TOGETHER {
                        sums[o] = simd.add(sums[o], simd.load(&dy[o][row][column].0[at..]));
                    }
                }
            }
            for o in 0..TOGETHER {
                by_group(simd, sums[o], at, |group, sum| db[group][tile * TOGETHER + o] = sum);
            }
        }
    }
}

/// Tells the sum of each group of samples in a vector that begins with sample `at`.
#[inline(always)]
fn by_group<S: Simd>(simd: S, lanes: S::Lanes, at: usize, mut tell: impl FnMut(usize, f32)) {
    let mut values = [0.0; LANES];
    simd.store(lanes, &mut values);
    for (group, values) in values[..S::WIDTH].as_chunks::<GROUP>().0.iter().enumerate() {
        tell(at / GROUP + group, sum(values));
    }
}

/// Turns the gradient behind the ReLU into the one before it, in place.
#[inline(always)]
pub(crate) fn relu_gradient<const PH: usize, const PW: usize>(y: &[Plane<PH, PW>], dy: &mut [Plane<PH, PW>]) {
    for (y, dy) in y.iter().flatten().flatten().zip(dy.iter_mut().flatten().flatten()) {
        *dy = y.relu_gradient(dy);
    }
}
