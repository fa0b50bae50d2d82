//! Convolution 3×3, stride 1, padding 1, with its two gradients.
//!
//! Planes carry one cell of zeros all round, so that no loop asks whether it stands at the edge.

use super::lanes::{LANES, Lanes};

/// One channel with its border of zeros: `[row + 1][column + 1]`.
pub(crate) type Plane<const PH: usize, const PW: usize> = [[Lanes; PW]; PH];

/// `y[o] = relu(bias[o] + Σ_c Σ_uv w[o][c][u][v] · x[c][row + u − 1][column + v − 1])`.
///
/// `weight` is `[o][c][u][v]`, flat.
#[inline(always)]
pub(crate) fn forward<const IN: usize, const PH: usize, const PW: usize>(
    weight: &[f32],
    bias: &[f32],
    x: &[Plane<PH, PW>],
    y: &mut [Plane<PH, PW>],
) {
    for ((y, weight), bias) in y.iter_mut().zip(weight.as_chunks::<9>().0.as_chunks::<IN>().0).zip(bias) {
        for y in interior(y) {
            *y = Lanes::splat(*bias);
        }
        for (x, taps) in x.iter().zip(weight) {
            correlate(taps, x, y);
        }
        for y in interior(y) {
            *y = y.relu();
        }
    }
}

/// Gradient of the input of [`forward`]: the same sum with the kernel turned and the channels
/// exchanged. `dy` is the gradient before the ReLU.
#[inline(always)]
pub(crate) fn input_gradient<const IN: usize, const PH: usize, const PW: usize>(
    weight: &[f32],
    dy: &[Plane<PH, PW>],
    dx: &mut [Plane<PH, PW>],
) {
    let weight = weight.as_chunks::<9>().0.as_chunks::<IN>().0;
    for (c, dx) in dx.iter_mut().enumerate() {
        for dx in interior(dx) {
            *dx = Lanes::ZERO;
        }
        for (dy, weight) in dy.iter().zip(weight) {
            let mut turned = weight[c];
            turned.reverse();
            correlate(&turned, dy, dx);
        }
    }
}

/// `y[row][column] += Σ_uv taps[u][v] · x[row + u − 1][column + v − 1]`
#[inline(always)]
fn correlate<const PH: usize, const PW: usize>(taps: &[f32; 9], x: &Plane<PH, PW>, y: &mut Plane<PH, PW>) {
    let [a, b, c, d, e, f, g, h, i] = *taps;
    for row in 0..PH - 2 {
        let [above, here, below] = [&x[row], &x[row + 1], &x[row + 2]];
        let y = &mut y[row + 1];
        for column in 0..PW - 2 {
            for lane in 0..LANES {
                let mut sum = y[column + 1].0[lane];
                sum = a.mul_add(above[column].0[lane], sum);
                sum = b.mul_add(above[column + 1].0[lane], sum);
                sum = c.mul_add(above[column + 2].0[lane], sum);
                sum = d.mul_add(here[column].0[lane], sum);
                sum = e.mul_add(here[column + 1].0[lane], sum);
                sum = f.mul_add(here[column + 2].0[lane], sum);
                sum = g.mul_add(below[column].0[lane], sum);
                sum = h.mul_add(below[column + 1].0[lane], sum);
                sum = i.mul_add(below[column + 2].0[lane], sum);
                y[column + 1].0[lane] = sum;
            }
        }
    }
}

#[inline(always)]
fn interior<const PH: usize, const PW: usize>(plane: &mut Plane<PH, PW>) -> impl Iterator<Item = &mut Lanes> {
    plane[1..PH - 1].iter_mut().flat_map(|row| &mut row[1..PW - 1])
}

/// Adds the gradients of weights `[o][c][u][v]` and biases `[o]` of one group of samples.
///
/// `dw[o][c][u][v] += Σ_samples Σ_row,column dy[o][row][column] · x[c][row + u − 1][column + v − 1]`
#[inline(always)]
pub(crate) fn weight_gradient<const IN: usize, const W: usize, const PH: usize, const PW: usize>(
    x: &[Plane<PH, PW>],
    dy: &[Plane<PH, PW>],
    dw: &mut [f32],
    db: &mut [f32],
) {
    let rows = dw.as_chunks_mut::<9>().0.as_chunks_mut::<IN>().0;
    for (dy, dw) in dy.iter().zip(rows) {
        let mut sum = [[Lanes::ZERO; 9]; IN];
        for row in 0..PH - 2 {
            let dy: &[Lanes; W] = dy[row + 1][1..].first_chunk().expect("W is PW - 2");
            for (x, sum) in x.iter().zip(&mut sum) {
                for (tap, sum) in sum.iter_mut().enumerate() {
                    let x = x[row + tap / 3][tap % 3..].first_chunk().expect("W is PW - 2");
                    sum.add_products(dy, x);
                }
            }
        }
        for (dw, sum) in dw.as_flattened_mut().iter_mut().zip(sum.as_flattened()) {
            *dw += sum.sum();
        }
    }
    for (db, dy) in db.iter_mut().zip(dy) {
        let mut sum = Lanes::ZERO;
        for row in &dy[1..PH - 1] {
            for dy in &row[1..PW - 1] {
                sum.add(dy);
            }
        }
        *db += sum.sum();
    }
}

/// Turns the gradient behind the ReLU into the one before it, in place.
#[inline(always)]
pub(crate) fn relu_gradient<const PH: usize, const PW: usize>(y: &[Plane<PH, PW>], dy: &mut [Plane<PH, PW>]) {
    for (y, dy) in y.iter().flatten().flatten().zip(dy.iter_mut().flatten().flatten()) {
        *dy = y.relu_gradient(dy);
    }
}
