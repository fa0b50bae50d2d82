//! Convolution 3×3, stride 1, padding 1, over planes that lie flat in memory.
//!
//! A plane before the pooling lies apart in four phases, even and odd rows by even and odd columns: the
//! four cells that the pooling compares then have the same place in four phases, and their neighbours
//! are runs of cells as well.

use crate::simd::Simd;

/// Numbers of a plane or phase, margins included.
pub(super) const LENGTH: usize = 128;
/// Zeros before the first row; a row and a cell of them are read.
pub(super) const MARGIN: usize = 16;
/// Cells from a row to the next. Where the last of them is no cell it is zero, the border of both rows.
pub(super) const STRIDE: usize = 6;
/// Rows that are computed.
const ROWS: usize = 16;
const COUNT: usize = ROWS * STRIDE;
/// Outputs that are summed together, of the same inputs.
const TOGETHER: usize = 4;

/// A plane, or a phase of one: rows from [`MARGIN`] on, zeros around them.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Plane(pub(super) [f32; LENGTH]);

impl Plane {
    pub(super) const ZERO: Self = Self([0.0; LENGTH]);
}

/// `CHANNELS` planes in four phases, or in one.
///
/// | phases | cell `[row][column]` is in phase | at |
/// |---|---|---|
/// | 4 | 2·(row mod 2) + column mod 2 | `MARGIN + (row / 2)·STRIDE + column / 2` |
/// | 1 | 0 | `MARGIN + row·STRIDE + column` |
pub(super) struct Planes<const CHANNELS: usize, const PHASES: usize>(pub(super) [[Plane; PHASES]; CHANNELS]);

impl<const CHANNELS: usize, const PHASES: usize> Planes<CHANNELS, PHASES> {
    #[inline(always)]
    pub(super) const fn zero() -> Self {
        Self([[Plane::ZERO; PHASES]; CHANNELS])
    }
}

/// The greatest value of each cell of a phase: infinity, and zero at the border.
#[repr(align(64))]
pub(super) struct Limits([f32; COUNT]);

impl Limits {
    /// Of a phase that has so many rows and columns.
    pub(super) const fn new(rows: usize, columns: usize) -> Self {
        let mut limits = [0.0; COUNT];
        let mut cell = 0;
        while cell < COUNT {
            if cell / STRIDE < rows && cell % STRIDE < columns {
                limits[cell] = f32::INFINITY;
            }
            cell += 1;
        }
        Self(limits)
    }
}

/// Where the neighbours of a phase's first cell lie.
#[derive(Clone, Copy)]
struct Neighbour {
    phase: usize,
    at: usize,
}

/// The neighbours of each phase in the order of the kernel's weights.
const fn neighbours<const PHASES: usize>() -> [[Neighbour; 9]; PHASES] {
    let mut all = [[Neighbour { phase: 0, at: 0 }; 9]; PHASES];
    let mut index = 0;
    while index < 9 * PHASES {
        let (phase, tap) = (index / 9, index % 9);
        let (row_phase, row) = along(PHASES, phase / 2, tap / 3);
        let (column_phase, column) = along(PHASES, phase % 2, tap % 3);
        // One more than the places away, so that none is negative.
        let at = MARGIN + row * STRIDE + column - STRIDE - 1;
        all[phase][tap] = Neighbour { phase: 2 * row_phase + column_phase, at };
        index += 1;
    }
    all
}

/// Of a neighbour before (0), at (1) or behind (2) a cell, along one axis: its phase, and its place there,
/// 1 for the cell's own place.
const fn along(phases: usize, phase: usize, neighbour: usize) -> (usize, usize) {
    match (phases, phase + neighbour) {
        (1, _) => (0, neighbour),
        (_, 0) => (1, 0),
        (_, 1) => (0, 1),
        (_, 2) => (1, 1),
        _ => (0, 2),
    }
}

/// Weights of `IN` channels to as many as there are biases.
pub(super) struct Convolution<const IN: usize> {
    /// By [`TOGETHER`] outputs, then input, then row and column of the kernel, then output.
    weight: Vec<[[[f32; TOGETHER]; 9]; IN]>,
    bias: Vec<[f32; TOGETHER]>,
}

impl<const IN: usize> Convolution<IN> {
    /// From weights `[out][in][3][3]` and biases `[out]`; none when their numbers do not fit.
    pub(super) fn new(weight: &[f32], bias: &[f32]) -> Option<Self> {
        let (bias, []) = bias.as_chunks::<TOGETHER>() else { return None };
        if weight.len() != 9 * IN * TOGETHER * bias.len() {
            return None;
        }
        let block = |block: usize| {
            let of = |input, tap, output| weight[((block * TOGETHER + output) * IN + input) * 9 + tap];
            std::array::from_fn(|input| {
                std::array::from_fn(|tap| std::array::from_fn(|output| of(input, tap, output)))
            })
        };
        Some(Self { weight: (0..bias.len()).map(block).collect(), bias: bias.to_vec() })
    }

    /// `y[o] = max(0, bias[o] + Σ_c Σ_uv w[o][c][u][v] · x[c][row + u − 1][column + v − 1])`, into planes
    /// of zeros, the border left zero; from four phases into one also the largest of the four, which is
    /// the max-pooling 2×2.
    ///
    /// Summed in that order whatever the vectors' width; `N` of them are summed together. A phase's rows
    /// are a whole number of times so many.
    #[inline(always)]
    pub(super) fn run<S: Simd, const N: usize, const OUT: usize, const FROM: usize, const TO: usize>(
        &self,
        simd: S,
        x: &Planes<IN, FROM>,
        y: &mut Planes<OUT, TO>,
        limits: &[Limits; TO],
    ) {
        let neighbours = const { neighbours::<FROM>() };
        let blocks = y.0.as_chunks_mut::<TOGETHER>().0.iter_mut();
        for ((y, weight), bias) in blocks.zip(&self.weight).zip(&self.bias) {
            for (phase, neighbours) in neighbours.iter().enumerate() {
                for from in (0..COUNT).step_by(N * S::WIDTH) {
                    let sums = sums::<S, N, IN, FROM>(simd, weight, bias, x, neighbours, from);
                    let to = phase % TO;
                    let limits = &limits[to].0[from..][..N * S::WIDTH];
                    for (y, sums) in y.iter_mut().zip(sums) {
                        let y = &mut y[to].0[MARGIN + from..][..N * S::WIDTH];
                        for (n, sum) in sums.into_iter().enumerate() {
                            let at = n * S::WIDTH;
                            // A NaN comes second, so that it stays.
                            let largest = simd.max(simd.load(&y[at..]), sum);
                            simd.store(simd.min(simd.load(&limits[at..]), largest), &mut y[at..]);
                        }
                    }
                }
            }
        }
    }
}

/// The sums of [`TOGETHER`] outputs for `N` vectors of cells of one phase.
#[inline(always)]
fn sums<S: Simd, const N: usize, const IN: usize, const FROM: usize>(
    simd: S,
    weight: &[[[f32; TOGETHER]; 9]; IN],
    bias: &[f32; TOGETHER],
    x: &Planes<IN, FROM>,
    neighbours: &[Neighbour; 9],
    from: usize,
) -> [[S::Lanes; N]; TOGETHER] {
    let mut sums = bias.map(|bias| [simd.splat(bias); N]);
    for (x, weight) in x.0.iter().zip(weight) {
        for (neighbour, weight) in neighbours.iter().zip(weight) {
            let x = &x[neighbour.phase].0[neighbour.at + from..][..N * S::WIDTH];
            let mut cells = [simd.splat(0.0); N];
            for (n, cells) in cells.iter_mut().enumerate() {
                *cells = simd.load(&x[n * S::WIDTH..]);
            }
            for output in 0..TOGETHER {
                let weight = simd.splat(weight[output]);
                for n in 0..N {
                    sums[output][n] = simd.mul_add(weight, cells[n], sums[output][n]);
                }
            }
        }
    }
    sums
}
