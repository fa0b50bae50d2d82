//! Sixteen samples side by side: the unit every loop of the kernel works on.
//!
//! A value of the network is kept for sixteen samples at once, so that each operation is the same
//! arithmetic on sixteen neighbours, in vectors as wide as the processor has them.

/// Samples that are computed together.
pub const LANES: usize = 16;

/// Samples whose gradients are summed before those of others are added.
pub(crate) const GROUP: usize = 8;

/// Groups that are computed together.
pub(crate) const GROUPS: usize = LANES / GROUP;

/// One value of the network for [`LANES`] samples.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
pub(crate) struct Lanes(pub(crate) [f32; LANES]);

impl Lanes {
    pub(crate) const ZERO: Self = Self::splat(0.0);

    #[inline(always)]
    pub(crate) const fn splat(value: f32) -> Self {
        Self([value; LANES])
    }

    /// The gradient behind a ReLU whose output was `self`.
    #[inline(always)]
    pub(crate) fn relu_gradient(&self, behind: &Self) -> Self {
        let mut out = *behind;
        for (d, y) in out.0.iter_mut().zip(&self.0) {
            *d = if *y > 0.0 { *d } else { 0.0 };
        }
        out
    }
}

/// Sum over a group of samples, always in the same order.
pub(crate) fn sum(values: &[f32; GROUP]) -> f32 {
    let [a, b, c, d, e, f, g, h] = *values;
    ((a + e) + (b + f)) + ((c + g) + (d + h))
}
