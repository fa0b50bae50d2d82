//! The terrain as the predictors see it: 31 × 11 heights around the base, raw and prepared.
//!
//! Knows nobody: not where heights come from, not what a network does with them. One function,
//! [`Heightfield::prepare`], serves collection and run time alike, so that the two cannot differ.

use thiserror::Error;

/// Rows, back to front: x = −1 + 0.1·i metres.
pub const ROWS: usize = 31;
/// Columns, left to right: y = 0.5 − 0.1·j metres.
pub const COLUMNS: usize = 11;
/// Number of cells.
pub const CELLS: usize = ROWS * COLUMNS;
/// Row and column of the centre of the field, at x = 0.5 m, whose height is subtracted.
pub const CENTRE: [usize; 2] = [15, 5];
/// Spacing of the points in both directions, m.
pub const SPACING_M: f64 = 0.1;
/// Heights are clipped to this far above and below the centre, m.
pub const CLIP_M: f32 = 1.0;
/// More unknown cells than this are an error: 40 % of the field.
pub const MAX_UNKNOWN: usize = CELLS * 2 / 5;

/// One value a cell, in metres, added before centring.
pub type Noise = [[f32; COLUMNS]; ROWS];

/// Heights as measured, in metres over any common level; a non-finite cell is unknown.
///
/// `cells_m[i][j]` is the height at x = −1 + 0.1·i (back to front), y = 0.5 − 0.1·j (left to
/// right), in the yaw-aligned base frame; the base stands over `cells_m[10][5]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Heightfield {
    /// The heights, `[row][column]`.
    pub cells_m: [[f32; COLUMNS]; ROWS],
}

/// What the networks see: filled, clipped, centred, and finite in every cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    cells_m: [[f32; COLUMNS]; ROWS],
}

/// Why a heightfield cannot be used. Each means: stop.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum HeightfieldError {
    /// Too little of the terrain is known to fill the rest.
    #[error("heightfield: {unknown} of {CELLS} cells unknown, at most {MAX_UNKNOWN} wanted")]
    Unknown {
        /// Number of unknown cells.
        unknown: usize,
    },
    /// A column holds no height at all.
    #[error("heightfield: column {column} has no known cell, at least one wanted")]
    EmptyColumn {
        /// The column, 0 at the left.
        column: usize,
    },
    /// The noise to be added is not a number.
    #[error("heightfield: noise[{row}][{column}] is {found}, a finite number of metres wanted")]
    Noise {
        /// Row of the cell.
        row: usize,
        /// Column of the cell.
        column: usize,
        /// The value.
        found: f32,
    },
}

impl Heightfield {
    /// A field with no known cell.
    pub const fn unknown() -> Self {
        Self { cells_m: [[f32::NAN; COLUMNS]; ROWS] }
    }

    /// Where cell `[row][column]` lies: x and y in metres, yaw-aligned base frame.
    pub fn point(row: usize, column: usize) -> [f32; 2] {
        [((row as f64 - 10.0) * SPACING_M) as f32, ((5.0 - column as f64) * SPACING_M) as f32]
    }

    /// Number of unknown cells.
    pub fn unknown_cells(&self) -> usize {
        self.cells_m.iter().flatten().filter(|height| !height.is_finite()).count()
    }

    /// The field as the networks see it: fill, clip to ±1 m around the centre, add `noise`, centre.
    ///
    /// ```text
    /// h′ = clip(fill(H) − fill(H)[15][5], ±1) + n − n[15][5]
    /// ```
    ///
    /// Along each column from back to front an unknown cell takes the last known value behind it;
    /// leading unknown cells take the first known value ahead. The value subtracted is the centre's
    /// with its noise, so the result is 0 there and within ±(1 + 2·max|n|) elsewhere. A hole is a
    /// finite height, clipped at −1 m; only what was not seen is filled.
    ///
    /// # Errors
    /// When more than 40 % of the cells are unknown, a column has no known cell, or noise is not
    /// finite.
    ///
    /// # Source
    /// Wu et al. (2025), selection step 1; leading cells, limits and clipping are our own.
    pub fn prepare(&self, noise: Option<&Noise>) -> Result<Field, HeightfieldError> {
        let Self { mut cells_m } = self.filled()?;
        let centre_m = cells_m[CENTRE[0]][CENTRE[1]];
        for height in cells_m.iter_mut().flatten() {
            *height = (*height - centre_m).clamp(-CLIP_M, CLIP_M);
        }
        if let Some(noise) = noise {
            add(&mut cells_m, noise)?;
        }
        Ok(Field { cells_m })
    }

    /// The first step of [`prepare`](Self::prepare) alone: every unknown cell takes the last known value
    /// behind it, leading ones the first ahead.
    ///
    /// # Errors
    /// When more than 40 % of the cells are unknown or a column has no known cell.
    pub fn filled(&self) -> Result<Self, HeightfieldError> {
        let unknown = self.unknown_cells();
        if unknown > MAX_UNKNOWN {
            return Err(HeightfieldError::Unknown { unknown });
        }
        let mut cells_m = self.cells_m;
        for column in 0..COLUMNS {
            fill(&mut cells_m, column)?;
        }
        Ok(Self { cells_m })
    }
}

fn fill(cells_m: &mut [[f32; COLUMNS]; ROWS], column: usize) -> Result<(), HeightfieldError> {
    let first = cells_m.iter().map(|row| row[column]).find(|height| height.is_finite());
    let mut last = first.ok_or(HeightfieldError::EmptyColumn { column })?;
    for row in cells_m.iter_mut() {
        if row[column].is_finite() {
            last = row[column];
        } else {
            row[column] = last;
        }
    }
    Ok(())
}

fn add(cells_m: &mut [[f32; COLUMNS]; ROWS], noise: &Noise) -> Result<(), HeightfieldError> {
    let centre_m = noise[CENTRE[0]][CENTRE[1]];
    for (row, (heights, noises)) in cells_m.iter_mut().zip(noise).enumerate() {
        for (column, (height, &found)) in heights.iter_mut().zip(noises).enumerate() {
            if !found.is_finite() {
                return Err(HeightfieldError::Noise { row, column, found });
            }
            // Bounded far beyond any sensible noise, so that no difference can overflow.
            *height += found.clamp(-1e6, 1e6) - centre_m.clamp(-1e6, 1e6);
        }
    }
    Ok(())
}

impl Field {
    /// All cells, row-major: rows back to front, columns left to right.
    pub fn as_slice(&self) -> &[f32; CELLS] {
        // `as_flattened` of an array reference gives a slice of exactly this length.
        self.cells_m.as_flattened().try_into().unwrap_or(&[0.0; CELLS])
    }

    /// The cells, `[row][column]`, metres relative to the centre.
    pub const fn cells_m(&self) -> &[[f32; COLUMNS]; ROWS] {
        &self.cells_m
    }

    /// A prepared field from its recorded cells, row-major; `None` when a value is not finite or
    /// their number is not [`CELLS`].
    pub fn from_slice(cells: &[f32]) -> Option<Self> {
        if cells.len() != CELLS || !cells.iter().all(|cell| cell.is_finite()) {
            return None;
        }
        let (rows, _) = cells.as_chunks::<COLUMNS>();
        Some(Self { cells_m: rows.try_into().ok()? })
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "these values are exact by construction")]
mod tests {
    use super::*;

    /// Higher to the front and to the left, by different amounts: no mirroring leaves it the same.
    fn tilted() -> Heightfield {
        let mut field = Heightfield::unknown();
        for (i, row) in field.cells_m.iter_mut().enumerate() {
            for (j, height) in row.iter_mut().enumerate() {
                let [x, y] = Heightfield::point(i, j);
                *height = 0.3 * x + 0.1 * y - 0.55;
            }
        }
        field
    }

    fn at(field: &Field, i: usize, j: usize) -> f32 {
        field.as_slice()[i * COLUMNS + j]
    }

    #[test]
    fn rows_run_forward_and_columns_to_the_right() {
        assert_eq!(Heightfield::point(0, 0), [-1.0, 0.5]);
        assert_eq!(Heightfield::point(30, 10), [2.0, -0.5]);
        assert_eq!(Heightfield::point(10, 5), [0.0, 0.0]);
        let field = tilted().prepare(None).unwrap();
        assert!((at(&field, 30, 5) - 0.45).abs() < 1e-6, "2 m ahead, 1.5 m beyond the centre");
        assert!((at(&field, 0, 5) + 0.45).abs() < 1e-6, "1 m behind");
        assert!((at(&field, 15, 0) - 0.05).abs() < 1e-6, "left is higher");
        assert!((at(&field, 15, 10) + 0.05).abs() < 1e-6, "right is lower");
    }

    #[test]
    fn the_centre_half_a_metre_ahead_becomes_zero() {
        let field = tilted().prepare(None).unwrap();
        assert_eq!(at(&field, 15, 5), 0.0);
        assert!((at(&field, 10, 5) + 0.15).abs() < 1e-6, "the base's own cell is not the centre");
    }

    #[test]
    fn an_unknown_cell_takes_the_last_known_one_behind_it() {
        let mut raw = tilted();
        for i in 20..24 {
            raw.cells_m[i][2] = f32::NAN;
        }
        let (filled, whole) = (raw.prepare(None).unwrap(), tilted().prepare(None).unwrap());
        for i in 20..24 {
            assert_eq!(at(&filled, i, 2), at(&whole, 19, 2), "row {i}");
        }
        assert_eq!(at(&filled, 24, 2), at(&whole, 24, 2));
        assert_eq!(at(&filled, 20, 8), at(&whole, 20, 8), "the mirrored column is untouched");
    }

    #[test]
    fn leading_unknown_cells_take_the_first_known_one_ahead() {
        let mut raw = tilted();
        for i in 0..4 {
            raw.cells_m[i][9] = f32::NAN;
        }
        let (filled, whole) = (raw.prepare(None).unwrap(), tilted().prepare(None).unwrap());
        for i in 0..4 {
            assert_eq!(at(&filled, i, 9), at(&whole, 4, 9), "row {i}");
        }
    }

    #[test]
    fn a_column_without_a_value_is_refused() {
        let mut raw = tilted();
        for row in &mut raw.cells_m {
            row[7] = f32::NAN;
        }
        assert_eq!(raw.prepare(None), Err(HeightfieldError::EmptyColumn { column: 7 }));
        assert_eq!(Heightfield::unknown().prepare(None), Err(HeightfieldError::Unknown { unknown: CELLS }));
    }

    #[test]
    fn more_than_forty_percent_unknown_is_refused() {
        let mut raw = tilted();
        let unknown = |raw: &mut Heightfield, n: usize| {
            for cell in raw.cells_m.as_flattened_mut().iter_mut().skip(COLUMNS).take(n) {
                *cell = f32::NAN;
            }
        };
        unknown(&mut raw, 136);
        assert!(raw.prepare(None).is_ok(), "136 of 341 is 39.9 %");
        unknown(&mut raw, 137);
        assert_eq!(raw.prepare(None), Err(HeightfieldError::Unknown { unknown: 137 }));
    }

    #[test]
    fn an_infinite_height_is_unknown_and_never_gets_out() {
        let mut raw = tilted();
        raw.cells_m[20][3] = f32::INFINITY;
        raw.cells_m[0][5] = f32::NEG_INFINITY;
        raw.cells_m[15][5] = f32::NAN;
        raw.cells_m[4][4] = f32::MAX;
        raw.cells_m[5][4] = f32::MIN;
        let field = raw.prepare(None).unwrap();
        assert!(field.as_slice().iter().all(|h| h.is_finite() && h.abs() <= 1.0));
        assert_eq!(at(&field, 14, 5), 0.0, "the centre took the value behind it");
    }

    #[test]
    fn a_hole_is_a_drop_of_one_metre_and_is_not_filled() {
        let mut raw = tilted();
        for i in 22..26 {
            raw.cells_m[i] = [-30.0; COLUMNS];
        }
        let field = raw.prepare(None).unwrap();
        for i in 22..26 {
            assert_eq!(at(&field, i, 5), -1.0, "row {i}");
        }
        assert!(at(&field, 26, 5) > 0.0);
    }

    #[test]
    fn clipping_comes_after_the_fill_and_is_around_the_centre() {
        let mut raw = tilted();
        raw.cells_m[20][1] = 7.0;
        raw.cells_m[21][1] = f32::NAN;
        for row in &mut raw.cells_m {
            for height in row {
                *height += 400.0;
            }
        }
        let field = raw.prepare(None).unwrap();
        assert_eq!((at(&field, 20, 1), at(&field, 21, 1)), (1.0, 1.0));
    }

    #[test]
    fn noise_comes_after_the_clip_and_moves_the_centre_too() {
        let mut noise = [[0.0; COLUMNS]; ROWS];
        noise[15][5] = 0.04;
        noise[22][6] = -0.08;
        let mut raw = tilted();
        raw.cells_m[22][6] = -9.0;
        let field = raw.prepare(Some(&noise)).unwrap();
        assert_eq!(at(&field, 15, 5), 0.0);
        assert!((at(&field, 22, 6) + 1.12).abs() < 1e-6, "−1 clipped, −0.08 of its own, −0.04 of the centre");
        assert!((at(&field, 30, 5) - 0.41).abs() < 1e-6);
    }

    #[test]
    fn nan_noise_is_refused() {
        let mut noise = [[0.0; COLUMNS]; ROWS];
        noise[3][1] = f32::NAN;
        let error = tilted().prepare(Some(&noise)).unwrap_err();
        assert!(matches!(error, HeightfieldError::Noise { row: 3, column: 1, .. }), "{error}");
    }

    #[test]
    fn a_recorded_field_comes_back_the_same_and_a_nan_does_not() {
        let field = tilted().prepare(None).unwrap();
        assert_eq!(Field::from_slice(field.as_slice()), Some(field.clone()));
        let mut cells = *field.as_slice();
        cells[17] = f32::NAN;
        assert_eq!(Field::from_slice(&cells), None);
        assert_eq!(Field::from_slice(&cells[..340]), None);
    }
}
