//! The training kernel: forward and backward pass of the one network, sixteen samples at a time, and the
//! gradient of a whole batch.
//!
//! Fixed in shape by the method, so every loop has constant bounds. Results are the same bits on any
//! processor: every product is fused with its sum, which a processor without that operation does in
//! software, and wider vectors only do the same sums sooner. Gradients are summed by groups of eight
//! samples, groups to four parts of the batch, parts in pairs.

#![allow(
    clippy::inline_always,
    reason = "a loop gets wide instructions only inside the function that asks for them"
)]
#![allow(clippy::needless_range_loop, reason = "indices of sums that are to stay in registers")]

mod conv;
mod lanes;
mod linear;
mod pool;
#[cfg(test)]
mod reference;
#[cfg(test)]
mod tests;

use std::ops::Range;

use vocaloco_core::simd::{Job, Simd};

use self::conv::{Behind, Plane};
use self::lanes::{GROUPS, Lanes};
use super::network::{FLAT, HIDDEN, TENSORS};

pub(super) use self::lanes::GROUP;
pub use self::lanes::LANES;
pub(super) use self::linear::PARTS;

const ROWS: usize = 31;
const COLUMNS: usize = 11;
/// Values of the convolutions' tensors, which the flat vector begins with.
pub(super) const CONVOLUTIONS: usize = TENSORS[6].start;
/// A plane before the pooling, and one behind it, border included.
type Full = Plane<33, 13>;
type Pooled = Plane<17, 7>;

/// A heightfield as the networks see it: 31 × 11, row-major, metres, centred.
pub type FieldCells = [f32; ROWS * COLUMNS];

/// Activations and gradients of one tile of [`LANES`] samples, reused from tile to tile.
pub struct Workspace {
    input: Vec<Full>,
    conv1: Vec<Full>,
    conv2: Vec<Full>,
    pool: Vec<Pooled>,
    conv3: Vec<Pooled>,
    flat: Box<[Lanes; FLAT]>,
    fc1: [Lanes; HIDDEN],
    fc2: [Lanes; HIDDEN],
    output: [Lanes; 1],
    d_conv1: Vec<Full>,
    d_conv2: Vec<Full>,
    d_pool: Vec<Pooled>,
    d_conv3: Vec<Pooled>,
    d_flat: Box<[Lanes; FLAT]>,
    d_fc1: [Lanes; HIDDEN],
    d_fc2: [Lanes; HIDDEN],
    turned: [Vec<f32>; 2],
    /// Of the convolutions' tensors, of each group of samples.
    gradients: [Vec<f32>; GROUPS],
}

impl Default for Workspace {
    #[allow(clippy::large_stack_arrays, reason = "a plane of 27 kB, copied to the heap")]
    fn default() -> Self {
        let full = |channels: usize| vec![[[Lanes::ZERO; 13]; 33]; channels];
        let pooled = |channels: usize| vec![[[Lanes::ZERO; 7]; 17]; channels];
        let flat = || vec![Lanes::ZERO; FLAT].try_into().expect("as long as its type says");
        Self {
            input: full(1),
            conv1: full(4),
            conv2: full(8),
            pool: pooled(8),
            conv3: pooled(8),
            flat: flat(),
            fc1: [Lanes::ZERO; HIDDEN],
            fc2: [Lanes::ZERO; HIDDEN],
            output: [Lanes::ZERO; 1],
            d_conv1: full(4),
            d_conv2: full(8),
            d_pool: pooled(8),
            d_conv3: pooled(8),
            d_flat: flat(),
            d_fc1: [Lanes::ZERO; HIDDEN],
            d_fc2: [Lanes::ZERO; HIDDEN],
            turned: [TENSORS[2], TENSORS[4]].map(|tensor| vec![0.0; tensor.len()]),
            gradients: std::array::from_fn(|_| vec![0.0; CONVOLUTIONS]),
        }
    }
}

impl Workspace {
    /// Puts a sample into a lane; `mirrored` exchanges left and right (column j becomes 10 − j).
    ///
    /// | argument | meaning | shape |
    /// |---|---|---|
    /// | `lane` | below [`LANES`] | |
    /// | `field` | heights, metres, centred | `[31][11]` row-major, back to front, left to right |
    pub fn load(&mut self, lane: usize, field: &FieldCells, mirrored: bool) {
        for (row, heights) in field.as_chunks::<COLUMNS>().0.iter().enumerate() {
            for (column, height) in heights.iter().enumerate() {
                let column = if mirrored { COLUMNS - 1 - column } else { column };
                self.input[0][row + 1][column + 1].0[lane] = *height;
            }
        }
    }

    /// What the last [`Backward`] came to for the convolutions, of each group of samples.
    pub(super) fn gradients(&self) -> &[Vec<f32>; GROUPS] {
        &self.gradients
    }
}

/// The network's output, before the sigmoid that viability has, for the loaded samples.
pub struct Forward<'a> {
    /// Where they were loaded.
    pub workspace: &'a mut Workspace,
    /// Of the network.
    pub parameters: &'a [f32],
}

impl Job for Forward<'_> {
    type Answer = [f32; LANES];

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> [f32; LANES] {
        let w = self.workspace;
        let [w1, b1, w2, b2, w3, b3, w4, b4, w5, b5, w6, b6] =
            TENSORS.map(|tensor| tensor.of(self.parameters));
        conv::forward::<S, 1, 33, 13>(simd, (w1, b1, Behind::Relu), &w.input, &mut w.conv1);
        conv::forward::<S, 4, 33, 13>(simd, (w2, b2, Behind::Relu), &w.conv1, &mut w.conv2);
        pool::forward(&w.conv2, &mut w.pool);
        conv::forward::<S, 8, 17, 7>(simd, (w3, b3, Behind::Relu), &w.pool, &mut w.conv3);
        for (flat, x) in w.flat.iter_mut().zip(inner(&w.conv3)) {
            *flat = *x;
        }
        linear::forward::<S, FLAT>(simd, w4, b4, &w.flat, &mut w.fc1);
        relu(&mut w.fc1);
        linear::forward::<S, HIDDEN>(simd, w5, b5, &w.fc1, &mut w.fc2);
        relu(&mut w.fc2);
        linear::forward::<S, HIDDEN>(simd, w6, b6, &w.fc2, &mut w.output);
        w.output[0].0
    }
}

/// What the samples of the last [`Forward`] contribute to the gradient: the convolutions' share stays in
/// the workspace, what the other layers' is computed from goes into `rows`.
pub(super) struct Backward<'a> {
    pub(super) workspace: &'a mut Workspace,
    pub(super) parameters: &'a [f32],
    /// ∂loss/∂output of each sample, before the sigmoid; 0 in an unused lane.
    pub(super) d_output: [f32; LANES],
    /// The tile's own.
    pub(super) rows: RowsMut<'a>,
}

impl Job for Backward<'_> {
    type Answer = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let w = self.workspace;
        let [_, _, w2, _, w3, _, w4, _, w5, _, w6, _] = TENSORS.map(|tensor| tensor.of(self.parameters));
        let d_output = [Lanes(self.d_output)];
        linear::input_gradient(simd, w6, &d_output, &mut w.d_fc2);
        relu_gradient(&w.fc2, &mut w.d_fc2);
        linear::input_gradient(simd, w5, &w.d_fc2, &mut w.d_fc1);
        relu_gradient(&w.fc1, &mut w.d_fc1);
        linear::input_gradient(simd, w4, &w.d_fc1, &mut w.d_flat);
        let rows = self.rows;
        linear::by_sample(&w.flat, rows.flat);
        linear::by_sample(&w.fc1, rows.fc1);
        linear::by_sample(&w.fc2, rows.fc2);
        linear::by_sample(&w.d_fc1, rows.d_fc1);
        linear::by_sample(&w.d_fc2, rows.d_fc2);
        linear::by_sample(&d_output, rows.d_output);
        for (dx, flat) in inner_mut(&mut w.d_conv3).zip(w.d_flat.iter()) {
            *dx = *flat;
        }

        let [first, second] = &mut w.gradients;
        let [[g1, h1, g2, h2, g3, h3], [i1, j1, i2, j2, i3, j3]] =
            [convolutions(first), convolutions(second)];
        let [t2, t3] = &mut w.turned;
        conv::relu_gradient(&w.conv3, &mut w.d_conv3);
        conv::weight_gradient::<S, 8, 17, 7>(simd, &w.pool, &w.d_conv3, [g3, i3], [h3, j3]);
        conv::turned::<8>(w3, t3);
        conv::forward::<S, 8, 17, 7>(simd, (t3, &[0.0; 8], Behind::Nothing), &w.d_conv3, &mut w.d_pool);
        pool::input_gradient(&w.conv2, &w.pool, &w.d_pool, &mut w.d_conv2);
        conv::relu_gradient(&w.conv2, &mut w.d_conv2);
        conv::weight_gradient::<S, 4, 33, 13>(simd, &w.conv1, &w.d_conv2, [g2, i2], [h2, j2]);
        conv::turned::<4>(w2, t2);
        conv::forward::<S, 8, 33, 13>(simd, (t2, &[0.0; 4], Behind::Nothing), &w.d_conv2, &mut w.d_conv1);
        conv::relu_gradient(&w.conv1, &mut w.d_conv1);
        conv::weight_gradient::<S, 1, 33, 13>(simd, &w.input, &w.d_conv1, [g1, i1], [h1, j1]);
    }
}

/// Activations and gradients of the fully connected layers by sample, for a whole batch.
#[derive(Default)]
pub(super) struct Rows {
    flat: Vec<[f32; FLAT]>,
    fc1: Vec<[f32; HIDDEN]>,
    fc2: Vec<[f32; HIDDEN]>,
    d_fc1: Vec<[f32; HIDDEN]>,
    d_fc2: Vec<[f32; HIDDEN]>,
    d_output: Vec<[f32; 1]>,
}

/// A tile's part of [`Rows`].
pub(super) struct RowsMut<'a> {
    flat: &'a mut [[f32; FLAT]],
    fc1: &'a mut [[f32; HIDDEN]],
    fc2: &'a mut [[f32; HIDDEN]],
    d_fc1: &'a mut [[f32; HIDDEN]],
    d_fc2: &'a mut [[f32; HIDDEN]],
    d_output: &'a mut [[f32; 1]],
}

impl Rows {
    /// Room for so many tiles, tile by tile.
    pub(super) fn tiles(&mut self, tiles: usize) -> Vec<RowsMut<'_>> {
        let samples = tiles * LANES;
        self.flat.resize(samples, [0.0; FLAT]);
        self.fc1.resize(samples, [0.0; HIDDEN]);
        self.fc2.resize(samples, [0.0; HIDDEN]);
        self.d_fc1.resize(samples, [0.0; HIDDEN]);
        self.d_fc2.resize(samples, [0.0; HIDDEN]);
        self.d_output.resize(samples, [0.0]);
        let hidden = self.fc1.chunks_mut(LANES).zip(self.fc2.chunks_mut(LANES));
        let d_hidden = self.d_fc1.chunks_mut(LANES).zip(self.d_fc2.chunks_mut(LANES));
        let ends = self.flat.chunks_mut(LANES).zip(self.d_output.chunks_mut(LANES));
        let all = ends.zip(hidden).zip(d_hidden);
        all.map(|(((flat, d_output), (fc1, fc2)), (d_fc1, d_fc2))| RowsMut {
            flat,
            fc1,
            fc2,
            d_fc1,
            d_fc2,
            d_output,
        })
        .collect()
    }
}

/// The gradient of some rows of a fully connected layer, weights or biases, over a whole batch.
pub(super) struct LinearGradient<'a> {
    pub(super) rows: &'a Rows,
    /// Samples of each part of the batch, whole groups but for the last.
    pub(super) parts: &'a [Range<usize>; PARTS],
    pub(super) layer: Layer,
    /// The layer's first output that is asked for.
    pub(super) first: usize,
    /// `[output][input]`, from that one on.
    pub(super) weights: &'a mut [f32],
}

/// A fully connected layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layer {
    First,
    Second,
    Output,
}

impl Layer {
    pub(super) const ALL: [Self; 3] = [Self::First, Self::Second, Self::Output];

    /// Values that an output sums over.
    pub(super) fn inputs(self) -> usize {
        if self == Self::First { FLAT } else { HIDDEN }
    }
}

impl Job for LinearGradient<'_> {
    type Answer = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self { rows, parts, layer, first, weights } = self;
        match layer {
            Layer::First => linear::weight_gradient::<S, FLAT, HIDDEN>(
                simd,
                linear::Batch { x: &rows.flat, dy: &rows.d_fc1, parts },
                first,
                weights.as_chunks_mut().0,
            ),
            Layer::Second => linear::weight_gradient::<S, HIDDEN, HIDDEN>(
                simd,
                linear::Batch { x: &rows.fc1, dy: &rows.d_fc2, parts },
                first,
                weights.as_chunks_mut().0,
            ),
            Layer::Output => linear::weight_gradient::<S, HIDDEN, 1>(
                simd,
                linear::Batch { x: &rows.fc2, dy: &rows.d_output, parts },
                first,
                weights.as_chunks_mut().0,
            ),
        }
    }
}

impl Rows {
    /// The gradient of a layer's biases.
    pub(super) fn bias_gradient(&self, parts: &[Range<usize>; PARTS], layer: Layer, biases: &mut [f32]) {
        match layer {
            Layer::First => linear::bias_gradient(&self.d_fc1, parts, biases),
            Layer::Second => linear::bias_gradient(&self.d_fc2, parts, biases),
            Layer::Output => linear::bias_gradient(&self.d_output, parts, biases),
        }
    }
}

#[inline(always)]
fn relu(values: &mut [Lanes]) {
    for y in values.iter_mut().flat_map(|lanes| &mut lanes.0) {
        *y = if *y > 0.0 { *y } else { 0.0 };
    }
}

#[inline(always)]
fn relu_gradient(values: &[Lanes], gradients: &mut [Lanes]) {
    for (y, dy) in values.iter().zip(gradients) {
        *dy = y.relu_gradient(dy);
    }
}

/// The cells inside the border, channel by channel and row by row: the order of ONNX's `Flatten`.
#[inline(always)]
fn inner(planes: &[Pooled]) -> impl Iterator<Item = &Lanes> {
    planes.iter().flat_map(|plane| &plane[1..16]).flat_map(|row| &row[1..6])
}

#[inline(always)]
fn inner_mut(planes: &mut [Pooled]) -> impl Iterator<Item = &mut Lanes> {
    planes.iter_mut().flat_map(|plane| &mut plane[1..16]).flat_map(|row| &mut row[1..6])
}

/// The convolutions' part of a gradient, as its tensors.
fn convolutions(gradient: &mut [f32]) -> [&mut [f32]; 6] {
    assert_eq!(gradient.len(), CONVOLUTIONS, "a value for each parameter");
    let mut rest = gradient;
    std::array::from_fn(|tensor| {
        let (tensor, behind) = std::mem::take(&mut rest).split_at_mut(TENSORS[tensor].len());
        rest = behind;
        tensor
    })
}
