//! Eight samples side by side: the unit every loop of the kernel works on.
//!
//! A value of the network is kept for eight samples at once, so that each operation is the same
//! arithmetic on eight neighbours, which the compiler turns into vector instructions of any width
//! without changing a bit of the result.

/// Samples that are computed together.
pub const LANES: usize = 8;

/// One value of the network for [`LANES`] samples.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub(crate) struct Lanes(pub(crate) [f32; LANES]);

impl Lanes {
    pub(crate) const ZERO: Self = Self::splat(0.0);

    #[inline(always)]
    pub(crate) const fn splat(value: f32) -> Self {
        Self([value; LANES])
    }

    /// `self += Σ_k weight[k] · x[k]`, one after the other.
    ///
    /// Each product is fused with its sum, also where the processor cannot, so that all round alike.
    /// The lanes are the innermost *loop*, with the whole sum as its body: in this form the compiler
    /// makes one vector of them.
    #[inline(always)]
    pub(crate) fn add_scaled<const N: usize>(&mut self, weight: &[f32; N], x: &[Lanes; N]) {
        for lane in 0..LANES {
            let mut sum = self.0[lane];
            for k in 0..N {
                sum = weight[k].mul_add(x[k].0[lane], sum);
            }
            self.0[lane] = sum;
        }
    }

    /// `self += Σ_k x[k] · y[k]`, lane by lane.
    #[inline(always)]
    pub(crate) fn add_products<const N: usize>(&mut self, x: &[Lanes; N], y: &[Lanes; N]) {
        for lane in 0..LANES {
            let mut sum = self.0[lane];
            for k in 0..N {
                sum = x[k].0[lane].mul_add(y[k].0[lane], sum);
            }
            self.0[lane] = sum;
        }
    }

    #[inline(always)]
    pub(crate) fn add(&mut self, x: &Self) {
        for (a, x) in self.0.iter_mut().zip(&x.0) {
            *a += x;
        }
    }

    #[inline(always)]
    pub(crate) fn relu(self) -> Self {
        let mut out = self;
        for a in &mut out.0 {
            *a = if *a > 0.0 { *a } else { 0.0 };
        }
        out
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

    /// Sum over the samples, always in the same order.
    #[inline(always)]
    pub(crate) fn sum(&self) -> f32 {
        let [a, b, c, d, e, f, g, h] = self.0;
        ((a + e) + (b + f)) + ((c + g) + (d + h))
    }
}
