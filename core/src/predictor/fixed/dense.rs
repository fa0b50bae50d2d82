//! A fully connected layer of 128 outputs on one row, `ReLU` behind it.

use super::HIDDEN;
use super::conv::{LENGTH, Plane};
use crate::simd::Simd;

/// Vectors of sums that are kept in registers.
const TOGETHER: usize = 8;
/// The greatest whole number that a weight is kept as.
const LARGEST: f32 = i16::MAX as f32;

/// `y = max(0, W·x + b)`, every output summed in the order of the inputs.
///
/// With many networks the time goes into reading weights. So they are kept in two bytes, as whole
/// multiples of a step, one step an input: `w[o][i] = k[o][i]·s[i]` with `|k| ≤ 32767`, off by half a step
/// at most, which is 1/65534 of the input's largest weight. And an input that is zero, as about half of
/// those behind a `ReLU` are, adds nothing: its weights are finite, so they are not read.
pub(super) struct Dense<const PLANES: usize> {
    /// `k`: by plane, input within it, output.
    weight: Vec<Row>,
    /// `s`, by plane and lane; zero in lanes that are no input.
    step: [Plane; PLANES],
    /// Which input of its plane a lane is.
    input_of_lane: [u8; LENGTH],
    /// Inputs of a plane.
    inputs: usize,
    bias: Plane,
}

#[derive(Clone, Copy)]
#[repr(align(64))]
struct Row([i16; HIDDEN]);

impl<const PLANES: usize> Dense<PLANES> {
    /// The layer with weight `weight(out, in)`, whose inputs are these lanes of one plane after the other.
    pub(super) fn new(lanes: &[usize], weight: impl Fn(usize, usize) -> f32, bias: &[f32; HIDDEN]) -> Self {
        let mut layer = Self {
            weight: Vec::with_capacity(PLANES * lanes.len()),
            step: [Plane::ZERO; PLANES],
            input_of_lane: [0; LENGTH],
            inputs: lanes.len(),
            bias: Plane(*bias),
        };
        for (input, &lane) in lanes.iter().enumerate() {
            layer.input_of_lane[lane] = input as u8;
        }
        for (plane, steps) in layer.step.iter_mut().enumerate() {
            for (input, &lane) in lanes.iter().enumerate() {
                let weights: [f32; HIDDEN] =
                    std::array::from_fn(|output| weight(output, plane * lanes.len() + input));
                let largest = weights.iter().fold(0.0, |largest: f32, weight| largest.max(weight.abs()));
                let step = largest / LARGEST;
                steps.0[lane] = step;
                // Where the step is zero the input is as well, and its weights are never read.
                layer.weight.push(Row(weights.map(|weight| (weight / step).round() as i16)));
            }
        }
        layer
    }

    #[inline(always)]
    pub(super) fn run<S: Simd>(&self, simd: S, x: [&Plane; PLANES]) -> Plane {
        let mut scaled = [Plane::ZERO; PLANES];
        for ((scaled, x), step) in scaled.iter_mut().zip(x).zip(&self.step) {
            for at in (0..LENGTH).step_by(S::WIDTH) {
                let product = simd.mul(simd.load(&x.0[at..]), simd.load(&step.0[at..]));
                simd.store(product, &mut scaled.0[at..]);
            }
        }
        let mut y = Plane::ZERO;
        for from in (0..HIDDEN).step_by(TOGETHER * S::WIDTH) {
            let bias = &self.bias.0[from..];
            let mut sums = [simd.splat(0.0); TOGETHER];
            for (n, sum) in sums.iter_mut().enumerate() {
                *sum = simd.load(&bias[n * S::WIDTH..]);
            }
            for (x, weight) in scaled.iter().zip(self.weight.chunks_exact(self.inputs)) {
                self.add(simd, x, weight, from, &mut sums);
            }
            for (n, sum) in sums.into_iter().enumerate() {
                // A NaN comes second, so that it stays.
                simd.store(simd.max(simd.splat(0.0), sum), &mut y.0[from + n * S::WIDTH..]);
            }
        }
        y
    }

    /// Adds the products of one plane's inputs to the sums of the outputs from `from` on.
    #[inline(always)]
    fn add<S: Simd>(&self, simd: S, x: &Plane, weight: &[Row], from: usize, sums: &mut [S::Lanes; TOGETHER]) {
        for half in [0, LENGTH / 2] {
            let mut present = 0;
            for at in (0..LENGTH / 2).step_by(S::WIDTH) {
                present |= simd.nonzero(simd.load(&x.0[half + at..])) << at;
            }
            while present != 0 {
                let lane = half + present.trailing_zeros() as usize;
                present &= present - 1;
                let x = simd.splat(x.0[lane]);
                let row = &weight[usize::from(self.input_of_lane[lane])].0[from..][..TOGETHER * S::WIDTH];
                for n in 0..TOGETHER {
                    sums[n] = simd.mul_add(simd.load_i16(&row[n * S::WIDTH..]), x, sums[n]);
                }
            }
        }
    }
}

/// `Σ a·b` in sixteen sums, which are added in order.
#[inline(always)]
pub(super) fn dot<S: Simd>(simd: S, a: &[f32; HIDDEN], b: &[f32; HIDDEN]) -> f32 {
    let mut sums = [0.0; 16];
    for at in (0..sums.len()).step_by(S::WIDTH) {
        let mut sum = simd.splat(0.0);
        for from in (at..HIDDEN).step_by(sums.len()) {
            sum = simd.mul_add(simd.load(&a[from..]), simd.load(&b[from..]), sum);
        }
        simd.store(sum, &mut sums[at..]);
    }
    sums.iter().sum()
}
