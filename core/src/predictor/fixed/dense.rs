//! A fully connected layer of 128 outputs on one row, `ReLU` behind it.

use super::{HIDDEN, relu};

/// Inputs whose products are added to a sum at a time.
const TOGETHER: usize = 8;

/// `y = relu(W·x + b)`, every output summed in the order of the inputs.
///
/// An input that is zero, as about half of those behind a `ReLU` are, adds nothing: its weights are
/// finite, so they are not read. With many networks the time goes into reading weights.
pub(super) struct Dense<const IN: usize> {
    /// `[in][out]`, and a row of zeros that fills up the last inputs.
    weight: Vec<[f32; HIDDEN]>,
    bias: [f32; HIDDEN],
}

impl<const IN: usize> Dense<IN> {
    /// The layer with weight `weight(out, in)`.
    pub(super) fn new(weight: impl Fn(usize, usize) -> f32, bias: &[f32; HIDDEN]) -> Self {
        let rows = (0..IN).map(|input| std::array::from_fn(|output| weight(output, input)));
        Self { weight: rows.chain([[0.0; HIDDEN]]).collect(), bias: *bias }
    }

    #[inline(always)]
    pub(super) fn run(&self, x: &[f32; IN]) -> [f32; HIDDEN] {
        // Where the values are that are no zeros (a NaN is none), filled up with the row of zeros.
        let (mut present, mut values) = ([0_u16; IN], [0.0; IN]);
        let mut count = 0;
        for (input, x) in x.iter().enumerate() {
            (present[count], values[count]) = (input as u16, *x);
            count += usize::from(*x != 0.0);
        }
        present[count..].fill(IN as u16);
        values[count..].fill(0.0);
        let mut sums = self.bias;
        let groups = present.as_chunks::<TOGETHER>().0.iter().zip(values.as_chunks::<TOGETHER>().0);
        for (inputs, values) in groups.take(count.div_ceil(TOGETHER)) {
            let rows = inputs.map(|input| &self.weight[usize::from(input)]);
            for (output, sum) in sums.iter_mut().enumerate() {
                for (row, x) in rows.iter().zip(values) {
                    *sum = row[output].mul_add(*x, *sum);
                }
            }
        }
        sums.map(relu)
    }
}

/// `Σ a·b` in sixteen sums, which are added in order.
#[inline(always)]
pub(super) fn dot(a: &[f32; HIDDEN], b: &[f32; HIDDEN]) -> f32 {
    let mut sums = [0.0; 16];
    for (a, b) in a.as_chunks::<16>().0.iter().zip(b.as_chunks::<16>().0) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum = a.mul_add(*b, *sum);
        }
    }
    sums.iter().sum()
}
