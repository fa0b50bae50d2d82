//! Vectors of numbers, as wide as this processor has them.
//!
//! What runs on them is written once, for any width. Every operation is one of IEEE 754 on each lane, so
//! that the width changes no bit; which width it is, is asked while the program runs.

#![allow(
    clippy::inline_always,
    reason = "vector instructions are only made inside the function that asks for them"
)]
#![cfg_attr(
    target_arch = "x86_64",
    allow(unsafe_code, reason = "instructions that not every processor has, run where they were found")
)]

#[cfg(target_arch = "x86_64")]
mod x86;

/// A processor's vectors. A value of the type is proof that this processor has them.
pub trait Simd: Copy {
    /// Numbers side by side.
    type Lanes: Copy;
    /// How many.
    const WIDTH: usize;

    /// The same number in every lane.
    fn splat(self, x: f32) -> Self::Lanes;
    /// The first numbers of a slice that has enough of them.
    fn load(self, from: &[f32]) -> Self::Lanes;
    /// The first whole numbers of a slice that has enough of them.
    fn load_i16(self, from: &[i16]) -> Self::Lanes;
    /// To the front of a slice that has room.
    fn store(self, lanes: Self::Lanes, to: &mut [f32]);
    /// a + b.
    fn add(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    /// a·b.
    fn mul(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    /// a·b + c, rounded once.
    fn mul_add(self, a: Self::Lanes, b: Self::Lanes, c: Self::Lanes) -> Self::Lanes;
    /// `a` where it is the greater, otherwise `b`, also where one of them is NaN.
    fn max(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    /// `a` where it is the less, otherwise `b`, also where one of them is NaN.
    fn min(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    /// A bit for each lane that is not zero; a NaN is not.
    fn nonzero(self, lanes: Self::Lanes) -> u64;
}

/// What runs on vectors of any width.
pub trait Job {
    /// What comes of it.
    type Answer;

    /// To be inlined always, and so all that it calls.
    fn run<S: Simd>(self, simd: S) -> Self::Answer;
}

/// Runs a job on the widest vectors that this processor has.
pub fn on_widest<J: Job>(job: J) -> J::Answer {
    #[cfg(target_arch = "x86_64")]
    return x86::on_widest(job);
    #[cfg(not(target_arch = "x86_64"))]
    job.run(Anywhere)
}

/// Whether this processor has an operation that multiplies and adds at once; without, each is a call.
pub fn has_fused() -> bool {
    #[cfg(target_arch = "x86_64")]
    return x86::Avx2::found().is_some();
    #[cfg(not(target_arch = "x86_64"))]
    cfg!(target_arch = "aarch64")
}

/// The answers of a job on all vectors that this processor has, by their names: the same bits.
pub fn on_each<J: Job>(job: impl Fn() -> J) -> Vec<(&'static str, J::Answer)> {
    #[cfg(target_arch = "x86_64")]
    let found = x86::on_each(&job);
    #[cfg(not(target_arch = "x86_64"))]
    let found = Vec::new();
    found.into_iter().chain([("arrays", job().run(Anywhere))]).collect()
}

/// Arrays, of which the compiler makes what vectors it can.
#[derive(Clone, Copy, Debug)]
pub struct Anywhere;

impl Simd for Anywhere {
    type Lanes = [f32; 8];
    const WIDTH: usize = 8;

    #[inline(always)]
    fn splat(self, x: f32) -> [f32; 8] {
        [x; 8]
    }

    #[inline(always)]
    fn load(self, from: &[f32]) -> [f32; 8] {
        std::array::from_fn(|lane| from[lane])
    }

    #[inline(always)]
    fn load_i16(self, from: &[i16]) -> [f32; 8] {
        std::array::from_fn(|lane| f32::from(from[lane]))
    }

    #[inline(always)]
    fn store(self, lanes: [f32; 8], to: &mut [f32]) {
        to[..8].copy_from_slice(&lanes);
    }

    #[inline(always)]
    fn add(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|lane| a[lane] + b[lane])
    }

    #[inline(always)]
    fn mul(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|lane| a[lane] * b[lane])
    }

    #[inline(always)]
    fn mul_add(self, a: [f32; 8], b: [f32; 8], c: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|lane| a[lane].mul_add(b[lane], c[lane]))
    }

    #[inline(always)]
    fn max(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|lane| if a[lane] > b[lane] { a[lane] } else { b[lane] })
    }

    #[inline(always)]
    fn min(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|lane| if a[lane] < b[lane] { a[lane] } else { b[lane] })
    }

    #[inline(always)]
    fn nonzero(self, lanes: [f32; 8]) -> u64 {
        (0..8).fold(0, |bits, lane| bits | u64::from(lanes[lane] != 0.0) << lane)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bits of every operation, lane by lane, on numbers of which some are special.
    struct EveryOperation;

    impl Job for EveryOperation {
        type Answer = Vec<u32>;

        #[inline(always)]
        fn run<S: Simd>(self, simd: S) -> Vec<u32> {
            const SPECIAL: [f32; 8] = [0.0, -0.0, f32::NAN, f32::INFINITY, -1.5, 0.1, 1e-40, 3e38];
            let all = |shift: usize| -> [f32; 64] {
                std::array::from_fn(|at| SPECIAL[if shift == 0 { at % 8 } else { at / 8 }])
            };
            let (left, right, whole) =
                (all(0), all(1), std::array::from_fn::<i16, 64, _>(|at| (at as i16 - 32).wrapping_mul(1021)));
            let mut out = [[0.0; 64]; 7];
            let mut bits = 0;
            for at in (0..64).step_by(S::WIDTH) {
                let (a, b) = (simd.load(&left[at..]), simd.load(&right[at..]));
                let w = simd.load_i16(&whole[at..]);
                let answers = [
                    w,
                    simd.add(a, b),
                    simd.mul(a, b),
                    simd.mul_add(a, w, simd.splat(0.3)),
                    simd.max(a, b),
                    simd.min(a, b),
                    simd.splat(-0.0),
                ];
                for (out, answer) in out.iter_mut().zip(answers) {
                    simd.store(answer, &mut out[at..]);
                }
                bits |= simd.nonzero(b) << at;
            }
            // One NaN is like another.
            let number = |x: &f32| if x.is_nan() { f32::NAN.to_bits() } else { x.to_bits() };
            let mut found: Vec<u32> = out.as_flattened().iter().map(number).collect();
            found.extend([bits as u32, (bits >> 32) as u32]);
            found
        }
    }

    #[test]
    fn every_width_gives_the_same_bits() {
        let wanted = EveryOperation.run(Anywhere);
        let first_other = |found: Vec<u32>| {
            assert_eq!(found.len(), wanted.len());
            found.iter().zip(&wanted).position(|(found, wanted)| found != wanted)
        };
        assert_eq!(first_other(on_widest(EveryOperation)), None);
        for (name, found) in on_each(|| EveryOperation) {
            assert_eq!(first_other(found), None, "{name}");
        }
        let [bits, _] = wanted[wanted.len() - 2..] else { panic!("no bits") };
        assert_eq!(bits, 0xffff_0000, "neither zero counts, and a NaN does");
    }
}
