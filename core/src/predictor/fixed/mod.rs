//! The network of the method, computed here: one field in, one number out, nothing allocated.
//!
//! Fixed in shape, so every loop has constant bounds and the working memory lies on the stack. Sums
//! run in one order and every product is fused with its sum, so the bytes are the same on every
//! machine: wider vectors, where they are found, only do the same sums sooner. Which file it is that
//! holds such a network is for [`read`] to say; what the answer is worth, for the predictor.

#![allow(
    clippy::inline_always,
    reason = "vector instructions are only made inside the function that asks for them"
)]

mod conv;
mod dense;
mod read;
#[cfg(test)]
mod tests;

use conv::{Convolution, Limits, MARGIN, Planes, STRIDE};
use dense::Dense;

use crate::heightfield::{CELLS, COLUMNS, ROWS};
use crate::simd::{self, Job, Simd};

/// Rows and columns behind the pooling, which leaves the odd last row and column out.
const POOLED_ROWS: usize = ROWS / 2;
const POOLED_COLUMNS: usize = COLUMNS / 2;
/// Values that the last convolution hands to the first fully connected layer.
const FLAT: usize = 8 * POOLED_ROWS * POOLED_COLUMNS;
/// Width of both hidden layers.
const HIDDEN: usize = 128;

/// Cells of a plane before the pooling, by phase: even rows and columns are one more than odd ones.
static PHASES: [Limits; 4] = [
    Limits::new(POOLED_ROWS + 1, POOLED_COLUMNS + 1),
    Limits::new(POOLED_ROWS + 1, POOLED_COLUMNS),
    Limits::new(POOLED_ROWS, POOLED_COLUMNS + 1),
    Limits::new(POOLED_ROWS, POOLED_COLUMNS),
];
/// Cells of a plane behind it.
static POOLED: [Limits; 1] = [Limits::new(POOLED_ROWS, POOLED_COLUMNS)];

/// Heightfield 31 × 11 → conv 1→4, conv 4→8, max-pool 2, conv 8→8 (3×3, stride 1, padding 1, `ReLU`
/// after each), flatten, fully connected 128 and 128 (`ReLU`), one output, a sigmoid or none.
///
/// # Source
/// Wu et al. (2025), section 4.
pub(super) struct FixedNetwork {
    conv1: Convolution<1>,
    conv2: Convolution<4>,
    conv3: Convolution<8>,
    fc1: Dense<8>,
    fc2: Dense<1>,
    out_weight: [f32; HIDDEN],
    out_bias: f32,
    has_sigmoid: bool,
}

impl FixedNetwork {
    /// Whether this processor has the fused operation; without, every product would be a call.
    pub(super) fn is_fast_here() -> bool {
        simd::has_fused()
    }

    /// The network's output for a field; NaN when any of its cells is not finite.
    ///
    /// | argument | meaning | unit | shape |
    /// |---|---|---|---|
    /// | `field` | heights, centred | m | `[31][11]`: rows back to front, columns left to right |
    pub(super) fn run(&self, field: &[f32; CELLS]) -> f32 {
        simd::on_widest(Forward(self, field))
    }

    /// `N` vectors of cells are summed together; their registers are all that there are.
    #[inline(always)]
    fn forward<S: Simd, const N: usize>(&self, simd: S, field: &[f32; CELLS]) -> f32 {
        // The pooling would hide a NaN.
        if field.iter().fold(false, |any, cell| any | !cell.is_finite()) {
            return f32::NAN;
        }
        let input = in_phases(field);
        let mut first = Planes::<4, 4>::zero();
        self.conv1.run::<S, N, _, _, _>(simd, &input, &mut first, &PHASES);
        let mut pooled = Planes::<8, 1>::zero();
        self.conv2.run::<S, N, _, _, _>(simd, &first, &mut pooled, &POOLED);
        let mut third = Planes::<8, 1>::zero();
        self.conv3.run::<S, N, _, _, _>(simd, &pooled, &mut third, &POOLED);
        let hidden = self.fc1.run(simd, third.0.each_ref().map(|[plane]| plane));
        let hidden = self.fc2.run(simd, [&hidden]);
        let x = self.out_bias + dense::dot(simd, &self.out_weight, &hidden.0);
        if self.has_sigmoid { 1.0 / (1.0 + libm::expf(-x)) } else { x }
    }
}

/// A network and the field that it looks at.
struct Forward<'a>(&'a FixedNetwork, &'a [f32; CELLS]);

impl Job for Forward<'_> {
    type Answer = f32;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> f32 {
        let Self(network, field) = self;
        // Sixteen lanes come with twice as many registers.
        if S::WIDTH == 16 {
            network.forward::<S, 6>(simd, field)
        } else {
            network.forward::<S, 3>(simd, field)
        }
    }
}

#[inline(always)]
fn in_phases(field: &[f32; CELLS]) -> Planes<1, 4> {
    let mut planes = Planes::zero();
    for (row, heights) in field.as_chunks::<COLUMNS>().0.iter().enumerate() {
        for (column, height) in heights.iter().enumerate() {
            let phase = 2 * (row % 2) + column % 2;
            planes.0[0][phase].0[MARGIN + row / 2 * STRIDE + column / 2] = *height;
        }
    }
    planes
}

const _: () = assert!(STRIDE == POOLED_COLUMNS + 1, "the border of a row is the cell behind its last one");
