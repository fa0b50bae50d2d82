//! Where the danger is: how much each cell of a field takes from, or gives to, a skill's viability.
//!
//! The ground is raised from level to the field as it is, and every cell is credited with what viability
//! changes by on its account: the credits add up to the whole change.

use crate::heightfield::{CELLS, Field};

/// Points at which viability is looked at between level ground and the field.
const POINTS: usize = 32;
/// Parts of equal change, with a gradient taken in the middle of each.
const PARTS: usize = 4;
/// Difference over which a gradient is taken, m.
const STEP_M: f32 = 0.02;
/// Less change than this along the whole way is none.
const NO_CHANGE: f32 = 1e-5;

/// What each cell does to a viability.
#[derive(Clone, Debug, PartialEq)]
pub struct Danger {
    /// Viability on level ground.
    pub level: f32,
    /// Viability on the field.
    pub here: f32,
    /// By cell, row-major: what it adds to viability; below 0 it is dangerous.
    pub credit: Vec<f32>,
}

impl Danger {
    /// What the credits add up to: [`here`](Self::here) − [`level`](Self::level).
    pub fn total(&self) -> f32 {
        self.credit.iter().sum()
    }

    /// The cell that takes most, and how much it takes.
    pub fn worst(&self) -> Option<(usize, f32)> {
        let worst = self.credit.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1))?;
        Some((worst.0, *worst.1))
    }
}

/// Credits every cell with its part of the change from level ground to the field.
///
/// ```text
/// credit_c = Σ_p ΔV_p · s_pc / Σ_c s_pc,   s_pc = h_c · ∂V/∂h_c (α_p·h),   Σ_c credit_c = V(h) − V(0)
/// ```
///
/// The way from level ground (α = 0) to the field (α = 1) is cut into parts p in which viability changes by
/// equal amounts, `ΔV_p`; `α_p` is the middle of a part. A single cell that is hidden or levelled says little
/// about stairs, which span the field; and where viability has saturated at 0 its gradient vanishes. A path
/// from level ground has neither trouble.
///
/// # Errors
/// What `predict` reports.
///
/// # Source
/// Integrated gradients: M. Sundararajan, A. Taly, Q. Yan, ICML 2017, eq. 1, with level ground as baseline;
/// the parts of equal change, and that each adds up exactly, are our own.
pub fn danger<E>(field: &Field, mut predict: impl FnMut(&Field) -> Result<f32, E>) -> Result<Danger, E> {
    let heights = *field.as_slice();
    let mut value =
        |cells: &[f32; CELLS]| Field::from_slice(cells).map_or(Ok(f32::NAN), |field| predict(&field));
    let mut along = Vec::with_capacity(POINTS + 1);
    for point in 0..=POINTS {
        let share = point as f32 / POINTS as f32;
        along.push(value(&heights.map(|height| share * height))?);
    }
    let mut credit = vec![0.0; CELLS];
    for part in parts(&along) {
        let mut cells = heights.map(|height| part.middle * height);
        let before = value(&cells)?;
        let mut shares = vec![0.0; CELLS];
        for (cell, share) in shares.iter_mut().enumerate() {
            // A level cell stays level, whatever its gradient.
            if heights[cell] != 0.0 {
                let height = cells[cell];
                cells[cell] = height + STEP_M;
                *share = heights[cell] * (value(&cells)? - before);
                cells[cell] = height;
            }
        }
        let total: f32 = shares.iter().sum();
        // A gradient against the change it is of would turn every credit around.
        if total * part.change > 0.0 {
            for (credit, share) in credit.iter_mut().zip(shares) {
                *credit += part.change * share / total;
            }
        }
    }
    Ok(Danger { level: along[0], here: along[POINTS], credit })
}

/// A part of the way from level ground to the field.
struct Part {
    /// Where its middle lies, 0 to 1.
    middle: f32,
    /// By how much viability changes in it.
    change: f32,
}

/// Cuts the way into parts of equal total variation of the values along it.
fn parts(along: &[f32]) -> Vec<Part> {
    let mut travelled = vec![0.0];
    for pair in along.windows(2) {
        travelled.push(travelled.last().unwrap_or(&0.0) + (pair[1] - pair[0]).abs());
    }
    let whole = travelled.last().copied().unwrap_or(0.0);
    // Phrased as "is inside", so that NaN gives no parts.
    if !(NO_CHANGE..=f32::MAX).contains(&whole) {
        return Vec::new();
    }
    // Place and value where this much has been travelled.
    let at = |distance: f32| {
        let after = travelled.iter().position(|so_far| *so_far >= distance).unwrap_or(along.len() - 1).max(1);
        let (from, to) = (travelled[after - 1], travelled[after]);
        let within = if to > from { ((distance - from) / (to - from)).clamp(0.0, 1.0) } else { 1.0 };
        let place = ((after - 1) as f32 + within) / (along.len() - 1) as f32;
        (place, along[after - 1] + within * (along[after] - along[after - 1]))
    };
    let part = |index: usize| {
        let distance = |steps: f32| whole * (index as f32 + steps) / PARTS as f32;
        let change = at(distance(1.0)).1 - at(distance(0.0)).1;
        Part { middle: at(distance(0.5)).0, change }
    };
    (0..PARTS).map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::heightfield::COLUMNS;
    use std::convert::Infallible;

    /// A step of 0.3 m from row 20 on, and a bump on the left that nobody minds.
    fn stairs() -> Field {
        let mut cells = [0.0; CELLS];
        for (cell, height) in cells.iter_mut().enumerate() {
            *height = if cell / COLUMNS >= 20 { 0.3 } else { 0.0 };
        }
        cells[3 * COLUMNS + 1] = 0.2;
        Field::from_slice(&cells).unwrap()
    }

    /// Viability by row 20 alone: its left half counts twice.
    fn viability(field: &Field) -> f32 {
        let row = &field.cells_m()[20];
        let load: f32 = row.iter().enumerate().map(|(column, h)| if column < 5 { 2.0 * h } else { *h }).sum();
        1.0 / (1.0 + (2.0 * load - 4.0).exp())
    }

    fn credited(field: &Field) -> Danger {
        danger(field, |field| Ok::<_, Infallible>(viability(field))).unwrap()
    }

    #[test]
    fn the_cells_that_matter_are_credited_and_the_credits_add_up_to_the_change() {
        let danger = credited(&stairs());
        let change = danger.here - danger.level;
        assert!(change < -0.9, "{danger:?}");
        assert!((danger.total() - change).abs() < 1e-4, "{} for {change}", danger.total());
        let credit = |row: usize, column: usize| danger.credit[row * COLUMNS + column];
        assert!((credit(20, 1) / credit(20, 8) - 2.0).abs() < 0.02, "the left half counts twice");
        assert!(credit(3, 1).abs() < 1e-4 && credit(25, 5).abs() < 1e-4, "nobody minds");
        assert_eq!(danger.worst().unwrap().0 / COLUMNS, 20);
    }

    #[test]
    fn the_way_is_cut_where_viability_changes() {
        let mut along = vec![1.0; POINTS + 1];
        for (index, value) in along.iter_mut().enumerate() {
            *value = if index <= 16 { 1.0 } else { 1.0 - 0.25 * (index.min(20) - 16) as f32 };
        }
        let parts = parts(&along);
        assert_eq!(parts.len(), PARTS);
        for part in parts {
            assert!((0.5..=0.625).contains(&part.middle), "{} lies where nothing changes", part.middle);
            assert!((part.change + 0.25).abs() < 1e-5);
        }
    }

    #[test]
    fn on_level_ground_nothing_is_dangerous() {
        let level = Field::from_slice(&[0.0; CELLS]).unwrap();
        let danger = credited(&level);
        assert!(danger.credit.iter().all(|credit| *credit == 0.0));
        assert_eq!(danger.level, danger.here);
    }

    #[test]
    fn a_predictor_that_fails_is_reported() {
        assert_eq!(danger(&stairs(), |_| Err("no answer")), Err("no answer"));
    }
}
