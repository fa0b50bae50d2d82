//! The same network in f64, written as plainly as can be: what the kernel is held against.

use super::super::network::{FLAT, HIDDEN, TENSORS};
use super::FieldCells;

type Image = Vec<Vec<Vec<f64>>>;

/// Output before the sigmoid.
pub(crate) fn forward(parameters: &[f64], field: &FieldCells) -> f64 {
    let t = |k: usize| &parameters[TENSORS[k].start..][..TENSORS[k].len()];
    let input: Image =
        vec![field.chunks(11).map(|row| row.iter().map(|h| f64::from(*h)).collect()).collect()];
    let x = conv(t(0), t(1), &input);
    let x = conv(t(2), t(3), &x);
    let x = pool(&x);
    let x = conv(t(4), t(5), &x);
    let x: Vec<f64> = x.into_iter().flatten().flatten().collect();
    assert_eq!(x.len(), FLAT);
    let x: Vec<f64> = linear(t(6), t(7), &x).iter().map(|y| y.max(0.0)).collect();
    let x: Vec<f64> = linear(t(8), t(9), &x).iter().map(|y| y.max(0.0)).collect();
    assert_eq!(x.len(), HIDDEN);
    linear(t(10), t(11), &x)[0]
}

fn conv(weight: &[f64], bias: &[f64], x: &Image) -> Image {
    let (channels, height, width) = (x.len(), x[0].len(), x[0][0].len());
    let mut y = vec![vec![vec![0.0; width]; height]; bias.len()];
    for (o, y) in y.iter_mut().enumerate() {
        for row in 0..height {
            for column in 0..width {
                let mut sum = bias[o];
                for (c, x) in x.iter().enumerate() {
                    for (u, v) in (0..3).flat_map(|u| (0..3).map(move |v| (u, v))) {
                        let cell = (row + u).checked_sub(1).zip((column + v).checked_sub(1));
                        let cell = cell.and_then(|(r, k)| x.get(r)?.get(k));
                        sum += weight[(o * channels + c) * 9 + u * 3 + v] * cell.unwrap_or(&0.0);
                    }
                }
                y[row][column] = sum.max(0.0);
            }
        }
    }
    y
}

fn pool(x: &Image) -> Image {
    let window = |plane: &Vec<Vec<f64>>, row: usize, column: usize| {
        plane[2 * row][2 * column]
            .max(plane[2 * row][2 * column + 1])
            .max(plane[2 * row + 1][2 * column])
            .max(plane[2 * row + 1][2 * column + 1])
    };
    x.iter()
        .map(|plane| {
            (0..plane.len() / 2)
                .map(|row| (0..plane[0].len() / 2).map(|column| window(plane, row, column)).collect())
                .collect()
        })
        .collect()
}

fn linear(weight: &[f64], bias: &[f64], x: &[f64]) -> Vec<f64> {
    weight
        .chunks(x.len())
        .zip(bias)
        .map(|(row, bias)| bias + row.iter().zip(x).map(|(w, x)| w * x).sum::<f64>())
        .collect()
}
