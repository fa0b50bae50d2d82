//! The network of the method, computed here: one field in, one number out, nothing allocated.
//!
//! Fixed in shape, so every loop has constant bounds and the working memory lies on the stack. Sums
//! run in one order and every product is fused with its sum, so the bytes are the same on every
//! machine: wider instructions, where they are found, only do the same sums sooner. Which file it is
//! that holds such a network is for [`read`] to say; what the answer is worth, for the predictor.

#![allow(
    clippy::inline_always,
    reason = "a loop gets wide instructions only inside the function that asks for them"
)]

mod conv;
mod dense;
mod read;
#[cfg(test)]
mod tests;

use conv::{Convolution, Planes};
use dense::Dense;

use crate::heightfield::{CELLS, COLUMNS, ROWS};

/// Rows and columns behind the pooling, which leaves the odd last row and column out.
const POOLED_ROWS: usize = ROWS / 2;
const POOLED_COLUMNS: usize = COLUMNS / 2;
/// Values that the last convolution hands to the first fully connected layer.
const FLAT: usize = 8 * POOLED_ROWS * POOLED_COLUMNS;
/// Width of both hidden layers.
const HIDDEN: usize = 128;

/// Cells from a row to the next: its columns and one zero, which is the border of both.
const STRIDE: usize = COLUMNS + 1;
const POOLED_STRIDE: usize = POOLED_COLUMNS + 1;

/// Heightfield 31 × 11 → conv 1→4, conv 4→8, max-pool 2, conv 8→8 (3×3, stride 1, padding 1, `ReLU`
/// after each), flatten, fully connected 128 and 128 (`ReLU`), one output, a sigmoid or none.
///
/// # Source
/// Wu et al. (2025), section 4.
pub(super) struct FixedNetwork {
    conv1: Convolution<1, 4>,
    conv2: Convolution<4, 8>,
    conv3: Convolution<8, 8>,
    fc1: Dense<FLAT>,
    fc2: Dense<HIDDEN>,
    out_weight: [f32; HIDDEN],
    out_bias: f32,
    has_sigmoid: bool,
}

impl FixedNetwork {
    /// Whether this processor has the fused operation; without, every product would be a call.
    pub(super) fn is_fast_here() -> bool {
        #[cfg(target_arch = "x86_64")]
        return std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma");
        #[cfg(not(target_arch = "x86_64"))]
        cfg!(target_arch = "aarch64")
    }

    /// The network's output for a field; NaN when any of its cells is not finite.
    ///
    /// | argument | meaning | unit | shape |
    /// |---|---|---|---|
    /// | `field` | heights, centred | m | `[31][11]`: rows back to front, columns left to right |
    pub(super) fn run(&self, field: &[f32; CELLS]) -> f32 {
        #[cfg(target_arch = "x86_64")]
        {
            if Self::is_fast_here() && std::arch::is_x86_feature_detected!("avx512f") {
                #[expect(unsafe_code, reason = "compiled for AVX-512, whose presence was just asked for")]
                return unsafe { run_avx512(self, field) };
            }
            if Self::is_fast_here() {
                #[expect(unsafe_code, reason = "compiled for AVX2 and FMA, which were just asked for")]
                return unsafe { run_avx2(self, field) };
            }
        }
        self.run_anywhere(field)
    }

    #[inline(always)]
    fn run_anywhere(&self, field: &[f32; CELLS]) -> f32 {
        // The pooling would hide a NaN.
        if field.iter().fold(false, |any, cell| any | !cell.is_finite()) {
            return f32::NAN;
        }
        let mut input = Planes::<1, 416>::zero();
        for (row, heights) in field.as_chunks::<COLUMNS>().0.iter().enumerate() {
            input.row_mut::<STRIDE>(0, row)[..COLUMNS].copy_from_slice(heights);
        }
        let mut first = Planes::<4, 416>::zero();
        self.conv1.run::<STRIDE, 384, 416>(&input, &mut first);
        first.clear_border::<STRIDE, ROWS>();
        // The pooling leaves the last row out, so that it is not computed.
        let mut second = Planes::<8, 416>::zero();
        self.conv2.run::<STRIDE, 368, 416>(&first, &mut second);
        let mut pooled = Planes::<8, 128>::zero();
        pool(&second, &mut pooled);
        let mut third = Planes::<8, 128>::zero();
        self.conv3.run::<POOLED_STRIDE, 96, 128>(&pooled, &mut third);
        let mut flat = [0.0; FLAT];
        for (at, cells) in flat.as_chunks_mut::<POOLED_COLUMNS>().0.iter_mut().enumerate() {
            let row = third.row::<POOLED_STRIDE>(at / POOLED_ROWS, at % POOLED_ROWS);
            cells.copy_from_slice(&row[..POOLED_COLUMNS]);
        }
        let hidden = self.fc1.run(&flat);
        let hidden = self.fc2.run(&hidden);
        let x = self.out_bias + dense::dot(&self.out_weight, &hidden);
        if self.has_sigmoid { 1.0 / (1.0 + libm::expf(-x)) } else { x }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_avx2(network: &FixedNetwork, field: &[f32; CELLS]) -> f32 {
    network.run_anywhere(field)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
fn run_avx512(network: &FixedNetwork, field: &[f32; CELLS]) -> f32 {
    network.run_anywhere(field)
}

/// Zero for what is below it; a NaN stays one, which `max` would hide.
#[inline(always)]
fn relu(x: f32) -> f32 {
    if x < 0.0 { 0.0 } else { x }
}

/// Max-pooling 2×2, stride 2.
///
/// A row of the pooled planes is half as long with its border as one before them, so that neighbours in
/// a row meet in one run over the whole plane.
#[inline(always)]
fn pool(x: &Planes<8, 416>, y: &mut Planes<8, 128>) {
    let higher = |a: f32, b: f32| if a > b { a } else { b };
    for channel in 0..8 {
        let rows = x.rows::<STRIDE, { 2 * POOLED_ROWS }>(channel).as_chunks::<2>().0;
        let mut along = [0.0; 2 * POOLED_ROWS * POOLED_STRIDE];
        for (along, [left, right]) in along.iter_mut().zip(rows) {
            *along = higher(*left, *right);
        }
        let pairs = along.as_chunks::<{ 2 * POOLED_STRIDE }>().0;
        for (row, pair) in pairs.iter().enumerate() {
            let cells = y.row_mut::<POOLED_STRIDE>(channel, row);
            for (column, cell) in cells[..POOLED_COLUMNS].iter_mut().enumerate() {
                *cell = higher(pair[column], pair[POOLED_STRIDE + column]);
            }
        }
    }
}

const _: () = assert!(STRIDE == 2 * POOLED_STRIDE, "neighbours in a row are neighbours in memory");
