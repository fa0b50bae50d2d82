//! Fully connected layer with its two gradients; weights `[out][in]`.

use super::lanes::{LANES, Lanes};

/// `y[o] = bias[o] + Σ_i w[o][i] · x[i]`, eight inputs at a time.
#[inline(always)]
pub(crate) fn forward<const IN: usize>(weight: &[f32], bias: &[f32], x: &[Lanes; IN], y: &mut [Lanes]) {
    for (y, bias) in y.iter_mut().zip(bias) {
        *y = Lanes::splat(*bias);
    }
    let rows = weight.as_chunks::<IN>().0;
    for (block, x) in x.as_chunks::<8>().0.iter().enumerate() {
        for (y, row) in y.iter_mut().zip(rows) {
            y.add_scaled(&row.as_chunks().0[block], x);
        }
    }
}

/// `dx[i] = Σ_o w[o][i] · dy[o]`, eight outputs at a time.
#[inline(always)]
pub(crate) fn input_gradient<const IN: usize>(weight: &[f32], dy: &[Lanes], dx: &mut [Lanes; IN]) {
    *dx = [Lanes::ZERO; IN];
    let rows = weight.as_chunks::<IN>().0;
    let (blocks, rest) = rows.as_chunks::<8>();
    let (dy_blocks, dy_rest) = dy.as_chunks::<8>();
    for (rows, dy) in blocks.iter().zip(dy_blocks) {
        for (i, dx) in dx.iter_mut().enumerate() {
            dx.add_scaled(&rows.each_ref().map(|row| row[i]), dy);
        }
    }
    for (row, dy) in rest.iter().zip(dy_rest) {
        for (dx, w) in dx.iter_mut().zip(row) {
            dx.add_scaled(&[*w], &[*dy]);
        }
    }
}

/// Adds `dw[o][i] += Σ_samples dy[o] · x[i]` and `db[o] += Σ_samples dy[o]`.
///
/// Here eight neighbouring *inputs* of one sample lie side by side: `turned[i / 8][sample]` holds
/// inputs `i..i + 8`, since the sum over samples would otherwise run across the lanes.
#[inline(always)]
pub(crate) fn weight_gradient<const IN: usize>(
    x: &[Lanes; IN],
    turned: &mut [[Lanes; LANES]],
    dy: &[Lanes],
    dw: &mut [f32],
    db: &mut [f32],
) {
    for (turned, x) in turned.iter_mut().zip(x.as_chunks::<LANES>().0) {
        for (sample, turned) in turned.iter_mut().enumerate() {
            for (turned, x) in turned.0.iter_mut().zip(x) {
                *turned = x.0[sample];
            }
        }
    }
    for (row, dy) in dw.as_chunks_mut::<IN>().0.iter_mut().zip(dy) {
        for (dw, x) in row.as_chunks_mut::<LANES>().0.iter_mut().zip(turned.iter()) {
            let mut sum = Lanes(*dw);
            sum.add_scaled(&dy.0, x);
            *dw = sum.0;
        }
    }
    for (db, dy) in db.iter_mut().zip(dy) {
        *db += dy.sum();
    }
}
