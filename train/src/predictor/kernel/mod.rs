//! The training kernel: forward and backward pass of the one network, eight samples at a time.
//!
//! Fixed in shape by the method, so every loop has constant bounds. Results are the same bits on any
//! processor: every product is fused with its sum, which a processor without that operation does in
//! software, and the widest instructions found only do the same sums sooner.

#![allow(
    clippy::inline_always,
    reason = "a loop gets wide instructions only inside the function that asks for them"
)]
#![allow(clippy::needless_range_loop, reason = "the loop over lanes is the one that becomes a vector")]

mod conv;
mod lanes;
mod linear;
mod pool;
#[cfg(test)]
mod reference;
#[cfg(test)]
mod tests;

use self::conv::Plane;
use self::lanes::Lanes;
use super::network::{FLAT, HIDDEN, PARAMETERS, TENSORS};

pub use self::lanes::LANES;

const ROWS: usize = 31;
const COLUMNS: usize = 11;
/// A plane before the pooling, and one behind it, border included.
type Full = Plane<33, 13>;
type Pooled = Plane<17, 7>;

/// A heightfield as the networks see it: 31 × 11, row-major, metres, centred.
pub type FieldCells = [f32; ROWS * COLUMNS];

/// Activations and gradients of one group of [`LANES`] samples, reused from group to group.
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
    turned: Vec<[Lanes; LANES]>,
}

impl Default for Workspace {
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
            turned: vec![[Lanes::ZERO; LANES]; FLAT / LANES],
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

    /// The network's output, before the sigmoid that viability has, for the loaded samples.
    pub fn forward(&mut self, parameters: &[f32]) -> [f32; LANES] {
        #[cfg(target_arch = "x86_64")]
        if has_wide_instructions() {
            #[expect(unsafe_code, reason = "compiled for AVX2 and FMA, which were just asked for")]
            unsafe {
                forward_avx2(self, parameters);
            }
            return self.output[0].0;
        }
        forward(self, parameters);
        self.output[0].0
    }

    /// Adds to `gradient` what the samples of the last [`Workspace::forward`] contribute.
    ///
    /// `d_output` is ∂loss/∂output of each sample, before the sigmoid; 0 in an unused lane.
    pub fn backward(&mut self, parameters: &[f32], d_output: [f32; LANES], gradient: &mut [f32]) {
        #[cfg(target_arch = "x86_64")]
        if has_wide_instructions() {
            #[expect(unsafe_code, reason = "compiled for AVX2 and FMA, which were just asked for")]
            unsafe {
                backward_avx2(self, parameters, d_output, gradient);
            }
            return;
        }
        backward(self, parameters, d_output, gradient);
    }
}

#[cfg(target_arch = "x86_64")]
fn has_wide_instructions() -> bool {
    std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn forward_avx2(w: &mut Workspace, parameters: &[f32]) {
    forward(w, parameters);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn backward_avx2(w: &mut Workspace, parameters: &[f32], d_output: [f32; LANES], gradient: &mut [f32]) {
    backward(w, parameters, d_output, gradient);
}

#[inline(always)]
fn forward(w: &mut Workspace, parameters: &[f32]) {
    let [w1, b1, w2, b2, w3, b3, w4, b4, w5, b5, w6, b6] = TENSORS.map(|tensor| tensor.of(parameters));
    conv::forward::<1, 33, 13>(w1, b1, &w.input, &mut w.conv1);
    conv::forward::<4, 33, 13>(w2, b2, &w.conv1, &mut w.conv2);
    pool::forward(&w.conv2, &mut w.pool);
    conv::forward::<8, 17, 7>(w3, b3, &w.pool, &mut w.conv3);
    for (flat, x) in w.flat.iter_mut().zip(inner(&w.conv3)) {
        *flat = *x;
    }
    linear::forward::<FLAT>(w4, b4, &w.flat, &mut w.fc1);
    for y in &mut w.fc1 {
        *y = y.relu();
    }
    linear::forward::<HIDDEN>(w5, b5, &w.fc1, &mut w.fc2);
    for y in &mut w.fc2 {
        *y = y.relu();
    }
    linear::forward::<HIDDEN>(w6, b6, &w.fc2, &mut w.output);
}

#[inline(always)]
fn backward(w: &mut Workspace, parameters: &[f32], d_output: [f32; LANES], gradient: &mut [f32]) {
    let [_, _, w2, _, w3, _, w4, _, w5, _, w6, _] = TENSORS.map(|tensor| tensor.of(parameters));
    let [g1, h1, g2, h2, g3, h3, g4, h4, g5, h5, g6, h6] = split(gradient);
    let d_output = [Lanes(d_output)];
    linear::weight_gradient::<HIDDEN>(&w.fc2, &mut w.turned, &d_output, g6, h6);
    linear::input_gradient(w6, &d_output, &mut w.d_fc2);
    for (y, dy) in w.fc2.iter().zip(&mut w.d_fc2) {
        *dy = y.relu_gradient(dy);
    }
    linear::weight_gradient::<HIDDEN>(&w.fc1, &mut w.turned, &w.d_fc2, g5, h5);
    linear::input_gradient(w5, &w.d_fc2, &mut w.d_fc1);
    for (y, dy) in w.fc1.iter().zip(&mut w.d_fc1) {
        *dy = y.relu_gradient(dy);
    }
    linear::weight_gradient::<FLAT>(&w.flat, &mut w.turned, &w.d_fc1, g4, h4);
    linear::input_gradient(w4, &w.d_fc1, &mut w.d_flat);
    for (dx, flat) in inner_mut(&mut w.d_conv3).zip(w.d_flat.iter()) {
        *dx = *flat;
    }
    conv::relu_gradient(&w.conv3, &mut w.d_conv3);
    conv::weight_gradient::<8, 5, 17, 7>(&w.pool, &w.d_conv3, g3, h3);
    conv::input_gradient::<8, 17, 7>(w3, &w.d_conv3, &mut w.d_pool);
    pool::input_gradient(&w.conv2, &w.pool, &w.d_pool, &mut w.d_conv2);
    conv::relu_gradient(&w.conv2, &mut w.d_conv2);
    conv::weight_gradient::<4, 11, 33, 13>(&w.conv1, &w.d_conv2, g2, h2);
    conv::input_gradient::<4, 33, 13>(w2, &w.d_conv2, &mut w.d_conv1);
    conv::relu_gradient(&w.conv1, &mut w.d_conv1);
    conv::weight_gradient::<1, 11, 33, 13>(&w.input, &w.d_conv1, g1, h1);
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

/// The flat gradient as its tensors.
fn split(gradient: &mut [f32]) -> [&mut [f32]; 12] {
    assert_eq!(gradient.len(), PARAMETERS, "a gradient has one value per parameter");
    let mut rest = gradient;
    TENSORS.map(|tensor| {
        let (tensor, behind) = std::mem::take(&mut rest).split_at_mut(tensor.len());
        rest = behind;
        tensor
    })
}
