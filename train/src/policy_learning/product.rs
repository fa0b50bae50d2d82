//! Products of matrices, as matrixmultiply computes them, reached through nalgebra.

use nalgebra::{DMatrixView, DMatrixViewMut, Dyn};

/// Up to this size of any side, the product is our own loop.
///
/// nalgebra 0.35 computes products with a side of up to 5 itself, and then writes outside an output whose
/// rows are not contiguous.
const SMALL_SIDE: usize = 5;

/// A matrix to read: value (i, j) stands at `i·row_stride + j·column_stride`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Matrix<'a> {
    values: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> Matrix<'a> {
    /// Row-major values.
    pub(super) fn new(values: &'a [f32], rows: usize, columns: usize) -> Self {
        Self { values, rows, columns, row_stride: columns, column_stride: 1 }
    }

    /// Its transpose, without a copy.
    pub(super) fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }

    fn view(&self) -> DMatrixView<'a, f32, Dyn, Dyn> {
        DMatrixView::from_slice_with_strides(
            self.values,
            self.rows,
            self.columns,
            self.row_stride,
            self.column_stride,
        )
    }
}

/// `out ← kept·out + a·b`, `out` row-major; with `kept` 0 what stood there is not read.
pub(super) fn multiply(out: &mut [f32], kept: f32, a: Matrix<'_>, b: Matrix<'_>) {
    assert_eq!((a.columns, a.rows * b.columns), (b.rows, out.len()), "matrices that do not fit");
    if a.rows.min(a.columns).min(b.columns) > SMALL_SIDE {
        DMatrixViewMut::from_slice_with_strides_mut(out, a.rows, b.columns, b.columns, 1).gemm(
            1.0,
            &a.view(),
            &b.view(),
            kept,
        );
        return;
    }
    for (i, row) in out.chunks_exact_mut(b.columns).enumerate() {
        for (j, sum) in row.iter_mut().enumerate() {
            let mut value = if kept == 0.0 { 0.0 } else { kept * *sum };
            for k in 0..a.columns {
                value += a.values[i * a.row_stride + k * a.column_stride]
                    * b.values[k * b.row_stride + j * b.column_stride];
            }
            *sum = value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_sim::stream::{stream, uniform};

    #[test]
    fn products_of_every_shape_are_right_and_stay_in_their_place() {
        let mut rng = stream(1, "test/product", &[]);
        let mut draw =
            |count: usize| -> Vec<f32> { (0..count).map(|_| uniform(&mut rng, -1.0, 1.0)).collect() };
        for (m, k, n) in [(11, 6, 3), (1, 9, 17), (11, 17, 1), (7, 3, 9), (11, 9, 17), (130, 70, 33)] {
            let (a, b, start) = (draw(m * k), draw(k * n), draw(m * n));
            let wanted = |i: usize, j: usize, kept: f32| {
                let products = (0..k).map(|l| f64::from(a[i * k + l]) * f64::from(b[l * n + j]));
                products.sum::<f64>() + f64::from(kept * start[i * n + j])
            };
            let transpose = |values: &[f32], rows: usize, columns: usize| -> Vec<f32> {
                (0..values.len()).map(|at| values[at % rows * columns + at / rows]).collect()
            };
            let (a_turned, b_turned) = (transpose(&a, m, k), transpose(&b, k, n));
            for (kept, a, b) in [
                (1.0, Matrix::new(&a, m, k), Matrix::new(&b, k, n)),
                (0.0, Matrix::new(&a_turned, k, m).transposed(), Matrix::new(&b, k, n)),
                (1.0, Matrix::new(&a, m, k), Matrix::new(&b_turned, n, k).transposed()),
            ] {
                let mut out = start.clone();
                out.extend([7.0; 64]);
                let (inside, outside) = out.split_at_mut(m * n);
                multiply(inside, kept, a, b);
                assert!(outside.iter().all(|x| *x == 7.0), "{m}x{k}x{n}: wrote outside");
                for (at, found) in inside.iter().enumerate() {
                    let wanted = wanted(at / n, at % n, kept);
                    assert!((f64::from(*found) - wanted).abs() < 1e-5, "{m}x{k}x{n} at {at}");
                }
            }
        }
    }
}
