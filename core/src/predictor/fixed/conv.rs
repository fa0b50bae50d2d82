//! Convolution 3×3, stride 1, padding 1, over planes that lie flat in memory.
//!
//! A plane is one run of cells with a single zero between its rows and zeros before and after, so that
//! a neighbour is always the same number of cells away and no loop asks whether it stands at the edge.

use super::relu;

/// Zeros before the first row; a row and a cell of them are read.
const MARGIN: usize = 16;

/// `CHANNELS` flat planes of `LENGTH` cells, margins and borders included.
#[repr(align(64))]
pub(super) struct Planes<const CHANNELS: usize, const LENGTH: usize>([[f32; LENGTH]; CHANNELS]);

impl<const CHANNELS: usize, const LENGTH: usize> Planes<CHANNELS, LENGTH> {
    #[inline(always)]
    pub(super) const fn zero() -> Self {
        Self([[0.0; LENGTH]; CHANNELS])
    }

    /// A row with the zero behind it.
    #[inline(always)]
    pub(super) fn row<const STRIDE: usize>(&self, channel: usize, row: usize) -> &[f32] {
        &self.0[channel][MARGIN + row * STRIDE..][..STRIDE]
    }

    /// The first `ROWS` rows, each with the zero behind it.
    #[inline(always)]
    pub(super) fn rows<const STRIDE: usize, const ROWS: usize>(&self, channel: usize) -> &[f32] {
        &self.0[channel][MARGIN..MARGIN + ROWS * STRIDE]
    }

    /// The same row, to write.
    #[inline(always)]
    pub(super) fn row_mut<const STRIDE: usize>(&mut self, channel: usize, row: usize) -> &mut [f32] {
        &mut self.0[channel][MARGIN + row * STRIDE..][..STRIDE]
    }

    /// Puts back the zeros that a convolution has written over: behind every row, and after the last.
    #[inline(always)]
    pub(super) fn clear_border<const STRIDE: usize, const ROWS: usize>(&mut self) {
        for plane in &mut self.0 {
            for row in 0..ROWS {
                plane[MARGIN + row * STRIDE + STRIDE - 1] = 0.0;
            }
            plane[MARGIN + ROWS * STRIDE..].fill(0.0);
        }
    }
}

/// Weights of `IN` channels to `OUT`.
pub(super) struct Convolution<const IN: usize, const OUT: usize> {
    /// `[out][in][row and column of the kernel]`.
    weight: [[[f32; 9]; IN]; OUT],
    bias: [f32; OUT],
}

impl<const IN: usize, const OUT: usize> Convolution<IN, OUT> {
    /// From weights `[out][in][3][3]` and biases `[out]`; none when their numbers are others.
    pub(super) fn new(weight: &[f32], bias: &[f32]) -> Option<Self> {
        let (taps, []) = weight.as_chunks::<9>() else { return None };
        let (weight, []) = taps.as_chunks::<IN>() else { return None };
        Some(Self { weight: weight.try_into().ok()?, bias: bias.try_into().ok()? })
    }

    /// `y[o] = relu(bias[o] + Σ_c Σ_uv w[o][c][u][v] · x[c][row + u − 1][column + v − 1])` for the
    /// first `COUNT` cells, borders included: those of `y` hold no zeros afterwards.
    #[inline(always)]
    pub(super) fn run<const STRIDE: usize, const COUNT: usize, const LENGTH: usize>(
        &self,
        x: &Planes<IN, LENGTH>,
        y: &mut Planes<OUT, LENGTH>,
    ) {
        let pairs = y.0.as_chunks_mut::<2>().0.iter_mut().zip(self.weight.as_chunks::<2>().0);
        for ((y, [first, second]), bias) in pairs.zip(self.bias.as_chunks::<2>().0) {
            let mut sums = bias.map(|bias| [bias; COUNT]);
            for ((x, first), second) in x.0.iter().zip(first).zip(second) {
                correlate::<STRIDE, COUNT, LENGTH>([first, second], x, &mut sums);
            }
            for (y, sums) in y.iter_mut().zip(&sums) {
                for (y, sum) in y[MARGIN..].iter_mut().zip(sums) {
                    *y = relu(*sum);
                }
            }
        }
    }
}

/// `sums[o][cell] += Σ_uv taps[o][u][v] · x[cell + (u − 1)·STRIDE + v − 1]`, the cells from the margin
/// on, of two outputs at a time, which share what is loaded.
///
/// One loop over all cells with both sums as its body: in this form the compiler makes vectors.
#[inline(always)]
fn correlate<const STRIDE: usize, const COUNT: usize, const LENGTH: usize>(
    [first, second]: [&[f32; 9]; 2],
    x: &[f32; LENGTH],
    [sums, other_sums]: &mut [[f32; COUNT]; 2],
) {
    // One run of neighbours a tap, so that the loop counts one thing only.
    let neighbours: [&[f32]; 9] = std::array::from_fn(|tap| {
        let from = MARGIN + (tap / 3) * STRIDE + tap % 3 - STRIDE - 1;
        &x[from..from + COUNT]
    });
    for cell in 0..COUNT {
        let (mut sum, mut other) = (sums[cell], other_sums[cell]);
        for ((x, first), second) in neighbours.iter().zip(first).zip(second) {
            sum = first.mul_add(x[cell], sum);
            other = second.mul_add(x[cell], other);
        }
        (sums[cell], other_sums[cell]) = (sum, other);
    }
}
