//! Which solids lie below a point: buckets of a quarter of a metre, the highest solid first, so that a field
//! of 341 heights costs microseconds on any terrain.

use super::Solid;

const BUCKET_M: f32 = 0.25;

/// For each bucket of the map, the solids that can be the highest somewhere in it.
#[derive(Clone, Debug)]
pub(super) struct HeightLookup {
    min_m: [f32; 2],
    rows: usize,
    columns: usize,
    /// Where each bucket's entries start; one more than buckets.
    starts: Vec<u32>,
    entries: Vec<Entry>,
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    /// The solid's highest point, m.
    top_m: f32,
    over: Over,
}

/// Where in a bucket a solid is.
#[derive(Clone, Copy, Debug)]
enum Over {
    /// A box, everywhere: the height is its top's.
    All,
    /// A box, as far from a centre as half its extents: the height there is its top's.
    Part { centre_m: [f32; 2], half_m: [f32; 2] },
    /// The solid with this number says where and how high.
    Asked(u32),
}

impl HeightLookup {
    pub(super) fn new(solids: &[Solid], min_m: [f32; 2], max_m: [f32; 2]) -> Self {
        let count = |axis: usize| ((max_m[axis] - min_m[axis]) / BUCKET_M) as usize + 1;
        let (rows, columns) = (count(0), count(1));
        let mut entries: Vec<(&Solid, Entry)> =
            (0..).zip(solids).map(|(id, solid)| (solid, Entry::of(id, solid))).collect();
        entries.sort_by(|(_, a), (_, b)| b.top_m.total_cmp(&a.top_m));
        let mut lookup = Self { min_m, rows, columns, starts: vec![0], entries: Vec::new() };
        // A little wider than the bucket, so that rounding in `height_m` can never miss an edge.
        let slack_m = 1e-3;
        for row in 0..rows {
            for column in 0..columns {
                let low = [
                    min_m[0] + row as f32 * BUCKET_M - slack_m,
                    min_m[1] + column as f32 * BUCKET_M - slack_m,
                ];
                let high = low.map(|v| v + BUCKET_M + 2.0 * slack_m);
                for (solid, entry) in &entries {
                    let [from, to] = solid.extent_m();
                    if (0..2).all(|axis| from[axis] <= high[axis] && to[axis] >= low[axis]) {
                        let covers = (0..2).all(|axis| from[axis] <= low[axis] && to[axis] >= high[axis]);
                        if covers && matches!(solid, Solid::Box { .. }) {
                            lookup.entries.push(Entry { over: Over::All, ..*entry });
                            // Whatever comes after is buried below this one.
                            break;
                        }
                        lookup.entries.push(*entry);
                    }
                }
                lookup.starts.push(lookup.entries.len() as u32);
            }
        }
        lookup
    }

    /// Height of the highest solid at a point inside the map, m; NaN where there is none.
    #[expect(clippy::inline_always, reason = "a plugin's patch is a thousand of these a tick")]
    #[inline(always)]
    pub(super) fn height_m(&self, solids: &[Solid], x_m: f32, y_m: f32) -> f32 {
        // By way of a signed number, for which processors have an instruction.
        let index = |from_min_m: f32, count: usize| ((from_min_m / BUCKET_M) as i32 as usize).min(count - 1);
        let row = index(x_m - self.min_m[0], self.rows);
        let column = index(y_m - self.min_m[1], self.columns);
        let bucket = row * self.columns + column;
        let entries = &self.entries[self.starts[bucket] as usize..self.starts[bucket + 1] as usize];
        let mut height_m = f32::NEG_INFINITY;
        for entry in entries {
            if height_m >= entry.top_m {
                break;
            }
            match entry.over {
                Over::All => return entry.top_m,
                Over::Part { centre_m, half_m } => {
                    if (x_m - centre_m[0]).abs() <= half_m[0] && (y_m - centre_m[1]).abs() <= half_m[1] {
                        return entry.top_m;
                    }
                }
                Over::Asked(solid) => height_m = height_m.max(solids[solid as usize].height_m(x_m, y_m)),
            }
        }
        if height_m.is_finite() { height_m } else { f32::NAN }
    }
}

impl Entry {
    /// Of the solid with a number.
    fn of(id: u32, solid: &Solid) -> Self {
        let over = match solid {
            Solid::Box { centre_m: [x, y, _], half_extents_m: [half_x, half_y, _] } => {
                Over::Part { centre_m: [*x, *y], half_m: [*half_x, *half_y] }
            }
            Solid::Grid { .. } => Over::Asked(id),
        };
        Self { top_m: solid.top_m(), over }
    }
}
