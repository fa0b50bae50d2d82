//! A fully connected layer on one row.

#![allow(
    clippy::inline_always,
    reason = "vector instructions are only made inside the function that asks for them"
)]

use crate::simd::{self, Job, Simd};

/// Outputs of a block; the last one is filled up with zeros.
const LANES: usize = 32;
/// Blocks that are summed side by side where there are so many: enough to hide the time of an addition.
const TOGETHER: usize = 4;

/// `y = W·x + b`.
///
/// Every output is summed in the order of the inputs, each product rounded before it is added, so that
/// vector instructions of any width give the same bytes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Dense {
    inputs: usize,
    outputs: usize,
    /// By block of [`LANES`] outputs, then input, then output; padded with zeros.
    weights: Vec<[f32; LANES]>,
    bias: Vec<[f32; LANES]>,
}

impl Dense {
    /// The layer with weight `weight(output, input)`.
    pub(super) fn new(inputs: usize, bias: &[f32], weight: impl Fn(usize, usize) -> f32) -> Self {
        let outputs = bias.len();
        let blocks = outputs.div_ceil(LANES);
        let lane = |block: usize, value: &dyn Fn(usize) -> f32| {
            std::array::from_fn(|lane| {
                let output = block * LANES + lane;
                if output < outputs { value(output) } else { 0.0 }
            })
        };
        let mut weights = Vec::with_capacity(blocks * inputs);
        for block in 0..blocks {
            for input in 0..inputs {
                weights.push(lane(block, &|output| weight(output, input)));
            }
        }
        let bias = (0..blocks).map(|block| lane(block, &|output| bias[output])).collect();
        Self { inputs, outputs, weights, bias }
    }

    pub(super) fn outputs(&self) -> usize {
        self.outputs
    }

    /// `x` has the layer's inputs, `y` its outputs.
    pub(super) fn run(&self, x: &[f32], y: &mut [f32]) {
        simd::on_widest(Forward { layer: self, x, y });
    }

    /// `COUNT` blocks of outputs from `block` on.
    #[inline(always)]
    fn blocks<S: Simd, const COUNT: usize>(&self, simd: S, block: usize, x: &[f32], y: &mut [f32]) {
        let weights: [&[[f32; LANES]]; COUNT] =
            std::array::from_fn(|k| &self.weights[(block + k) * self.inputs..][..self.inputs]);
        let mut sums: [[f32; LANES]; COUNT] = std::array::from_fn(|k| self.bias[block + k]);
        // Two vectors of each block at a time.
        for at in (0..LANES).step_by(2 * S::WIDTH) {
            let mut lanes =
                sums.each_ref().map(|sums| [simd.load(&sums[at..]), simd.load(&sums[at + S::WIDTH..])]);
            for (input, &x) in x.iter().enumerate().take(self.inputs) {
                let x = simd.splat(x);
                for (lanes, weights) in lanes.iter_mut().zip(weights) {
                    let row = &weights[input];
                    for (half, sum) in lanes.iter_mut().enumerate() {
                        *sum = simd.add(*sum, simd.mul(simd.load(&row[at + half * S::WIDTH..]), x));
                    }
                }
            }
            for (sums, [first, second]) in sums.iter_mut().zip(lanes) {
                simd.store(first, &mut sums[at..]);
                simd.store(second, &mut sums[at + S::WIDTH..]);
            }
        }
        for (sums, y) in sums.iter().zip(y[block * LANES..].chunks_mut(LANES)) {
            y.copy_from_slice(&sums[..y.len()]);
        }
    }
}

/// A layer on its way from `x` to `y`.
struct Forward<'a> {
    layer: &'a Dense,
    x: &'a [f32],
    y: &'a mut [f32],
}

impl Job for Forward<'_> {
    type Answer = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self { layer, x, y } = self;
        let blocks = layer.bias.len();
        let whole = blocks / TOGETHER * TOGETHER;
        for block in (0..whole).step_by(TOGETHER) {
            layer.blocks::<S, TOGETHER>(simd, block, x, y);
        }
        for block in whole..blocks {
            layer.blocks::<S, 1>(simd, block, x, y);
        }
    }
}
