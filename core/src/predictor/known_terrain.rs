//! Whether a field is like those that a predictor was fitted to. Beyond them its answer means nothing,
//! however sure it sounds.
//!
//! Three measures of distance, none of which the fields' own noise moves much; a file carries them in
//! its metadata, so that a predictor and what it knows cannot be exchanged.

#![allow(
    clippy::inline_always,
    reason = "vector instructions are only made inside the function that asks for them"
)]

use std::fmt::Write;

use super::guard::Fault;
use crate::heightfield::{CELLS, COLUMNS, Field, ROWS};
use crate::simd::{self, Job, Simd};

/// Directions in which the fitted fields differ most.
pub const COMPONENTS: usize = 16;
/// Rows and columns over which what the components leave is averaged: 0.3 m along, 0.7 m across, so
/// that a step or an edge is seen and a cell's noise is not.
const WINDOW: [usize; 2] = [3, 7];
/// Key of the metadata, and how its value begins: the method and its version.
pub const KEY: &str = "known_terrain";
const VERSION: &str = "components-1:";
/// Numbers in the text: mean, components, variances, limits.
const VALUES: usize = CELLS + COMPONENTS * CELLS + COMPONENTS + 3;

/// The cells, filled up to whole vectors with zeros.
const LANES: usize = 16;
const BLOCKS: usize = CELLS.div_ceil(LANES);
type Cells = [[f32; LANES]; BLOCKS];

/// The fields that a predictor was fitted to, in brief.
///
/// With `h` the field less its own mean, `d = h − mean`, components `vᵢ` (orthonormal) of variance `λᵢ`
/// and `zᵢ = vᵢ·d`:
///
/// ```text
/// among the components    Σ zᵢ²/λᵢ
/// beside them             |r|²,  r = d − Σ zᵢ·vᵢ
/// in one place            max over windows of 3 × 7 cells |mean r|
/// strangeness = the largest of the three, each as a share of its limit
/// ```
///
/// Up to 1 a field is known. Its own mean is taken off because centring gives every cell the noise of
/// one.
///
/// # Source
/// The first two are Hotelling's T² and the residual Q of process monitoring (Jackson, Mudholkar,
/// *Control procedures for residuals associated with principal component analysis*, Technometrics 21,
/// 1979); the third is our own.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownTerrain {
    mean_m: Cells,
    components: Vec<Cells>,
    variance_m2: [f32; COMPONENTS],
    limits: [f32; 3],
}

impl KnownTerrain {
    /// From its parts.
    ///
    /// | argument | meaning | unit | shape |
    /// |---|---|---|---|
    /// | `mean` | mean of the fields, each less its own mean | m | `[31·11]` |
    /// | `components` | orthonormal directions, of mean 0 | | `[16][31·11]` |
    /// | `variance` | of the fields along each | m² | `[16]` |
    /// | `limits` | of the three measures, where strangeness is 1 | 1, m², m | |
    pub fn new(
        mean: &[f32; CELLS],
        components: &[[f32; CELLS]],
        variance: [f32; COMPONENTS],
        limits: [f32; 3],
    ) -> Self {
        Self {
            mean_m: padded(mean),
            components: components.iter().map(padded).collect(),
            variance_m2: variance,
            limits,
        }
    }

    /// The same with other limits.
    #[must_use]
    pub fn with_limits(self, limits: [f32; 3]) -> Self {
        Self { limits, ..self }
    }

    /// The largest of the three measures, each as a share of its limit: a field up to 1 is known.
    pub fn strangeness(&self, field: &Field) -> f32 {
        let measures = self.measures(field.as_slice());
        let shares = measures.iter().zip(&self.limits).map(|(measure, limit)| measure / limit);
        // Not `max`, which would hide a NaN.
        shares.fold(0.0, |largest, share| if share <= largest { largest } else { share })
    }

    /// The three measures of a field: among the components, beside them, and in one place.
    pub fn measures(&self, field: &[f32; CELLS]) -> [f32; 3] {
        simd::on_widest(Measures(self, field))
    }

    #[inline(always)]
    fn measure<S: Simd>(&self, simd: S, field: &[f32; CELLS]) -> [f32; 3] {
        let mut left = padded(field);
        let mean = sum(&left) / CELLS as f32;
        for (left, known) in left.as_flattened_mut().iter_mut().zip(self.mean_m.as_flattened()) {
            *left -= known + mean;
        }
        left.as_flattened_mut()[CELLS..].fill(0.0);
        let mut among = 0.0;
        let deviation = left;
        for (component, variance) in self.components.iter().zip(&self.variance_m2) {
            let along = dot(simd, component, &deviation);
            among += along * along / variance;
            for (left, component) in left.as_flattened_mut().iter_mut().zip(component.as_flattened()) {
                *left -= along * component;
            }
        }
        [among, dot(simd, &left, &left), in_one_place(left.as_flattened())]
    }

    /// As text for a file's metadata: every number's bits in hexadecimal.
    pub fn to_text(&self) -> String {
        let mut text = String::with_capacity(VERSION.len() + 8 * VALUES);
        text.push_str(VERSION);
        let planes = std::iter::once(&self.mean_m).chain(&self.components);
        let cells = planes.flat_map(|plane| &plane.as_flattened()[..CELLS]);
        for value in cells.chain(&self.variance_m2).chain(&self.limits) {
            // Writing to a `String` does not fail.
            let _ = write!(text, "{:08x}", value.to_bits());
        }
        text
    }

    /// Reads [`to_text`](Self::to_text)'s text back.
    ///
    /// # Errors
    /// Another method or length, or a number that makes no sense in its place.
    pub(super) fn from_text(text: &str) -> Result<Self, Fault> {
        let fault = |found: &str, wanted: &str| Fault::new(format!("metadata.{KEY}"), found, wanted);
        let Some(digits) = text.strip_prefix(VERSION) else {
            return Err(fault(text, &format!("{VERSION} and {VALUES} numbers")));
        };
        let (numbers, rest) = digits.as_bytes().as_chunks::<8>();
        if numbers.len() != VALUES || !rest.is_empty() {
            return Err(fault(&format!("{} digits", digits.len()), &format!("{}", 8 * VALUES)));
        }
        let mut values = Vec::with_capacity(VALUES);
        for number in numbers {
            let bits =
                std::str::from_utf8(number).ok().and_then(|digits| u32::from_str_radix(digits, 16).ok());
            let value = bits.map(f32::from_bits).filter(|value| value.abs() <= 1e6);
            values.push(value.ok_or_else(|| fault("a number beyond ±1e6, or none", "finite numbers"))?);
        }
        let (planes, rest) = values.split_at(CELLS * (1 + COMPONENTS));
        let (variance, limits) = rest.split_at(COMPONENTS);
        if !rest.iter().all(|value| *value >= 1e-9) {
            return Err(fault("a variance or limit below 1e-9", "positive ones"));
        }
        let mut planes = planes.as_chunks::<CELLS>().0.iter().map(padded);
        match (planes.next(), variance.try_into(), limits.try_into()) {
            (Some(mean_m), Ok(variance_m2), Ok(limits)) => {
                Ok(Self { mean_m, components: planes.collect(), variance_m2, limits })
            }
            _ => Err(fault("too few numbers", "all of them")),
        }
    }
}

/// What is known, and the field that is measured against it. No product is fused with its sum.
struct Measures<'a>(&'a KnownTerrain, &'a [f32; CELLS]);

impl Job for Measures<'_> {
    type Answer = [f32; 3];

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> [f32; 3] {
        self.0.measure(simd, self.1)
    }
}

#[inline(always)]
fn padded(cells: &[f32; CELLS]) -> Cells {
    let mut padded = [[0.0; LANES]; BLOCKS];
    padded.as_flattened_mut()[..CELLS].copy_from_slice(cells);
    padded
}

/// Sixteen sums side by side, then added in order.
#[inline(always)]
fn sum(cells: &Cells) -> f32 {
    let mut sums = [0.0; LANES];
    for block in cells {
        for (sum, cell) in sums.iter_mut().zip(block) {
            *sum += cell;
        }
    }
    sums.iter().sum()
}

/// The same of the products a·b.
#[inline(always)]
fn dot<S: Simd>(simd: S, a: &Cells, b: &Cells) -> f32 {
    let mut sums = [0.0; LANES];
    for at in (0..LANES).step_by(S::WIDTH) {
        let mut sum = simd.splat(0.0);
        for (a, b) in a.iter().zip(b) {
            sum = simd.add(sum, simd.mul(simd.load(&a[at..]), simd.load(&b[at..])));
        }
        simd.store(sum, &mut sums[at..]);
    }
    sums.iter().sum()
}

/// The largest |mean| over all windows.
#[inline(always)]
fn in_one_place(cells: &[f32]) -> f32 {
    const HIGH: usize = WINDOW[0];
    const WIDE: usize = WINDOW[1];
    // Of every first cell, also of windows that would reach beyond the last column.
    let mut along = [0.0; (ROWS - HIGH + 1) * COLUMNS];
    for row in 0..HIGH {
        for (along, cell) in along.iter_mut().zip(&cells[row * COLUMNS..]) {
            *along += cell;
        }
    }
    let mut totals = [0.0; (ROWS - HIGH + 1) * COLUMNS];
    for column in 0..WIDE {
        for (total, along) in totals.iter_mut().zip(&along[column..]) {
            *total += along;
        }
    }
    let mut largest = [0.0_f32; COLUMNS - WIDE + 1];
    for totals in totals.as_chunks::<COLUMNS>().0 {
        for (largest, total) in largest.iter_mut().zip(totals) {
            *largest = if total.abs() <= *largest { *largest } else { total.abs() };
        }
    }
    let largest = largest.into_iter().fold(0.0, |largest, here| if here <= largest { largest } else { here });
    largest / (HIGH * WIDE) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Knows slopes along x of about 0.1 a metre, and nothing else but noise.
    fn slopes() -> KnownTerrain {
        let mut components = vec![[0.0; CELLS]; COMPONENTS];
        // Cosines of the rows: orthogonal to each other and to a constant.
        for (index, component) in components.iter_mut().enumerate() {
            for (cell, value) in component.iter_mut().enumerate() {
                let phase = (cell / COLUMNS) as f32 + 0.5;
                *value = (std::f32::consts::PI * (index + 1) as f32 * phase / ROWS as f32).cos();
            }
            let length = component.iter().map(|value| value * value).sum::<f32>().sqrt();
            for value in component.iter_mut() {
                *value /= length;
            }
        }
        let mut variance = [0.005; COMPONENTS];
        variance[0] = 10.0;
        KnownTerrain::new(&[0.0; CELLS], &components, variance, [30.0, 2.0, 0.08])
    }

    fn field(height: impl Fn(usize, usize) -> f32) -> Field {
        let cells: Vec<f32> = (0..CELLS).map(|cell| height(cell / COLUMNS, cell % COLUMNS)).collect();
        Field::from_slice(&cells).unwrap()
    }

    #[test]
    fn a_slope_is_known_and_a_wall_across_it_is_not() {
        let known = slopes();
        let slope = |i: usize| 0.01 * i as f32;
        assert!(known.strangeness(&field(|i, _| slope(i))) < 0.5);
        let walled = field(|i, j| slope(i) + if i == 20 && j > 2 { 0.9 } else { 0.0 });
        assert!(known.strangeness(&walled) > 1.0);
    }

    #[test]
    fn a_level_shift_changes_nothing() {
        let known = slopes();
        let at =
            |level: f32| known.measures(field(|i, j| level + 0.02 * i as f32 - 0.01 * j as f32).as_slice());
        for (here, there) in at(0.0).iter().zip(at(0.1)) {
            assert!((here - there).abs() < 1e-4 * (1.0 + here.abs()), "{here} and {there}");
        }
    }

    #[test]
    fn each_measure_sees_what_the_others_do_not() {
        let known = slopes();
        let [among, ..] = known.measures(field(|i, _| 0.3 * i as f32).as_slice());
        assert!(among > 30.0, "a slope of a kind that is known, far too steep: {among}");
        let rough = field(|i, j| if (i + j) % 2 == 0 { 0.3 } else { -0.3 });
        let [among, beside, place] = known.measures(rough.as_slice());
        assert!(among < 30.0 && beside > 2.0 && place < 0.08, "a chequerboard: {among} {beside} {place}");
        let edge = field(|_, j| if j > 5 { 0.06 } else { -0.06 });
        let [among, beside, place] = known.measures(edge.as_slice());
        assert!(
            among < 30.0 && beside < 2.0 && place > 0.03,
            "a kerb along the way: {among} {beside} {place}"
        );
    }

    #[test]
    fn the_text_reads_back_bit_for_bit_and_any_other_is_refused() {
        let known = slopes();
        let text = known.to_text();
        assert_eq!(KnownTerrain::from_text(&text), Ok(known));
        let spoiled = [
            String::new(),
            text.replace("components-1", "components-2"),
            text[..text.len() - 1].to_owned(),
            format!("{text}00000000"),
            text.replacen("00000000", "7fc00000", 1),
            text.replacen("00000000", "7f7fffff", 1),
            text.replacen("00000000", "0000000g", 1),
            format!("{}00000000", &text[..text.len() - 8]),
        ];
        for (index, text) in spoiled.iter().enumerate() {
            assert_eq!(
                KnownTerrain::from_text(text).unwrap_err().field,
                "metadata.known_terrain",
                "spoiled text {index}"
            );
        }
    }
}
