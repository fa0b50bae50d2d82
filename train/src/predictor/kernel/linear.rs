//! Fully connected layer with its two gradients; weights `[out][in]`.

use std::ops::Range;

use vocaloco_core::simd::Simd;

use super::lanes::{GROUP, LANES, Lanes, sum};

/// Sums that are computed side by side, so that none waits for the one before.
const TOGETHER: usize = 8;

/// `y[o] = bias[o] + Σ_i w[o][i] · x[i]`, one term after the other.
#[inline(always)]
pub(crate) fn forward<S: Simd, const IN: usize>(
    simd: S,
    weight: &[f32],
    bias: &[f32],
    x: &[Lanes; IN],
    y: &mut [Lanes],
) {
    let rows = weight.as_chunks::<IN>().0;
    for at in (0..LANES).step_by(S::WIDTH) {
        let (tiles, rest) = y.as_chunks_mut::<TOGETHER>();
        let behind = tiles.len() * TOGETHER;
        for (tile, y) in tiles.iter_mut().enumerate() {
            let first = tile * TOGETHER;
            outputs::<S, IN, TOGETHER>(simd, at, (&rows[first..], &bias[first..]), x, y);
        }
        for (o, y) in rest.iter_mut().enumerate() {
            let first = behind + o;
            outputs::<S, IN, 1>(simd, at, (&rows[first..], &bias[first..]), x, std::array::from_mut(y));
        }
    }
}

#[inline(always)]
fn outputs<S: Simd, const IN: usize, const N: usize>(
    simd: S,
    at: usize,
    (rows, bias): (&[[f32; IN]], &[f32]),
    x: &[Lanes; IN],
    y: &mut [Lanes; N],
) {
    let rows: &[[f32; IN]; N] = rows.first_chunk().expect("a row for each output");
    let bias: &[f32; N] = bias.first_chunk().expect("a bias for each output");
    let mut sums = [simd.splat(0.0); N];
    for o in 0..N {
        sums[o] = simd.splat(bias[o]);
    }
    for i in 0..IN {
        let x = simd.load(&x[i].0[at..]);
        for o in 0..N {
            sums[o] = simd.mul_add(simd.splat(rows[o][i]), x, sums[o]);
        }
    }
    for o in 0..N {
        simd.store(sums[o], &mut y[o].0[at..]);
    }
}

/// `dx[i] = Σ_o w[o][i] · dy[o]`, one term after the other.
#[inline(always)]
pub(crate) fn input_gradient<S: Simd, const IN: usize>(
    simd: S,
    weight: &[f32],
    dy: &[Lanes],
    dx: &mut [Lanes; IN],
) {
    const { assert!(IN.is_multiple_of(TOGETHER)) }
    let rows = weight.as_chunks::<IN>().0;
    for at in (0..LANES).step_by(S::WIDTH) {
        for (tile, dx) in dx.as_chunks_mut::<TOGETHER>().0.iter_mut().enumerate() {
            let mut sums = [simd.splat(0.0); TOGETHER];
            for (row, dy) in rows.iter().zip(dy) {
                let (row, dy) = (&row.as_chunks::<TOGETHER>().0[tile], simd.load(&dy.0[at..]));
                for i in 0..TOGETHER {
                    sums[i] = simd.mul_add(simd.splat(row[i]), dy, sums[i]);
                }
            }
            for i in 0..TOGETHER {
                simd.store(sums[i], &mut dx[i].0[at..]);
            }
        }
    }
}

/// Vectors of inputs that are summed side by side.
const VECTORS: usize = 4;

/// Parts of a batch whose gradients are summed one by one and then added in pairs.
pub(crate) const PARTS: usize = 4;

/// What a layer took in and its outputs' gradients, by sample, and the samples of each part.
#[derive(Clone, Copy)]
pub(crate) struct Batch<'a, const IN: usize, const OUT: usize> {
    pub(crate) x: &'a [[f32; IN]],
    pub(crate) dy: &'a [[f32; OUT]],
    pub(crate) parts: &'a [Range<usize>; PARTS],
}

/// `dw[o][i] = Σ_samples dy[sample][first + o] · x[sample][i]`, where `dw` has a row for each output from
/// `first` on; the samples of a part one after the other, the parts in pairs.
#[inline(always)]
pub(crate) fn weight_gradient<S: Simd, const IN: usize, const OUT: usize>(
    simd: S,
    batch: Batch<'_, IN, OUT>,
    first: usize,
    dw: &mut [[f32; IN]],
) {
    let (pairs, rest) = dw.as_chunks_mut::<2>();
    let behind = first + 2 * pairs.len();
    for (pair, dw) in pairs.iter_mut().enumerate() {
        rows::<S, IN, OUT, 2>(simd, batch, first + 2 * pair, dw);
    }
    for (o, dw) in rest.iter_mut().enumerate() {
        rows::<S, IN, OUT, 1>(simd, batch, behind + o, std::array::from_mut(dw));
    }
}

#[inline(always)]
fn rows<S: Simd, const IN: usize, const OUT: usize, const N: usize>(
    simd: S,
    batch: Batch<'_, IN, OUT>,
    first: usize,
    dw: &mut [[f32; IN]; N],
) {
    let mut at = 0;
    while at + VECTORS * S::WIDTH <= IN {
        vectors::<S, IN, OUT, N, VECTORS>(simd, batch, [first, at], dw);
        at += VECTORS * S::WIDTH;
    }
    while at + S::WIDTH <= IN {
        vectors::<S, IN, OUT, N, 1>(simd, batch, [first, at], dw);
        at += S::WIDTH;
    }
    for (o, dw) in dw.iter_mut().enumerate() {
        for at in at..IN {
            let mut sums = [0.0_f32; PARTS];
            for (sum, samples) in sums.iter_mut().zip(batch.parts) {
                for (x, dy) in batch.x[samples.clone()].iter().zip(&batch.dy[samples.clone()]) {
                    *sum = dy[first + o].mul_add(x[at], *sum);
                }
            }
            dw[at] = (sums[0] + sums[1]) + (sums[2] + sums[3]);
        }
    }
}

#[inline(always)]
fn vectors<S: Simd, const IN: usize, const OUT: usize, const N: usize, const M: usize>(
    simd: S,
    batch: Batch<'_, IN, OUT>,
    [first, at]: [usize; 2],
    dw: &mut [[f32; IN]; N],
) {
    let mut of_parts = [[[simd.splat(0.0); M]; N]; PARTS];
    for (of_part, samples) in of_parts.iter_mut().zip(batch.parts) {
        let mut sums = [[simd.splat(0.0); M]; N];
        for (x, dy) in batch.x[samples.clone()].iter().zip(&batch.dy[samples.clone()]) {
            let x = &x[at..at + M * S::WIDTH];
            let dy: &[f32; N] = dy[first..].first_chunk().expect("a value for each output");
            for m in 0..M {
                let x = simd.load(&x[m * S::WIDTH..]);
                for o in 0..N {
                    sums[o][m] = simd.mul_add(simd.splat(dy[o]), x, sums[o][m]);
                }
            }
        }
        *of_part = sums;
    }
    let [a, b, c, d] = of_parts;
    for o in 0..N {
        for m in 0..M {
            let sum = simd.add(simd.add(a[o][m], b[o][m]), simd.add(c[o][m], d[o][m]));
            simd.store(sum, &mut dw[o][at + m * S::WIDTH..]);
        }
    }
}

/// Values by sample instead of by place: `rows[sample][i]`.
pub(crate) fn by_sample<const N: usize>(x: &[Lanes; N], rows: &mut [[f32; N]]) {
    for (sample, row) in rows.iter_mut().enumerate() {
        for (value, x) in row.iter_mut().zip(x) {
            *value = x.0[sample];
        }
    }
}

/// `db[o] = Σ_samples dy[sample][o]`, summed by groups, parts and pairs.
pub(crate) fn bias_gradient<const OUT: usize>(
    dy: &[[f32; OUT]],
    parts: &[Range<usize>; PARTS],
    db: &mut [f32],
) {
    for (o, db) in db.iter_mut().enumerate() {
        let [a, b, c, d] = parts.each_ref().map(|samples| {
            let groups = dy[samples.clone()].chunks(GROUP);
            groups.fold(0.0, |total, group| {
                let mut values = [0.0; GROUP];
                for (value, dy) in values.iter_mut().zip(group) {
                    *value = dy[o];
                }
                total + sum(&values)
            })
        });
        *db = (a + b) + (c + d);
    }
}
