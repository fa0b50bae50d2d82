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
    solid: u32,
    /// Its highest point, m.
    top_m: f32,
    /// It is flat and reaches over the whole bucket: its height is `top_m` everywhere in it.
    fills: bool,
}

impl HeightLookup {
    pub(super) fn new(solids: &[Solid], min_m: [f32; 2], max_m: [f32; 2]) -> Self {
        let count = |axis: usize| ((max_m[axis] - min_m[axis]) / BUCKET_M) as usize + 1;
        let (rows, columns) = (count(0), count(1));
        let mut entries: Vec<Entry> = (0..)
            .zip(solids)
            .map(|(id, solid)| Entry { solid: id, top_m: solid.top_m(), fills: false })
            .collect();
        entries.sort_by(|a, b| b.top_m.total_cmp(&a.top_m));
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
                for entry in &entries {
                    let solid = &solids[entry.solid as usize];
                    let [from, to] = solid.extent_m();
                    if (0..2).all(|axis| from[axis] <= high[axis] && to[axis] >= low[axis]) {
                        let covers = (0..2).all(|axis| from[axis] <= low[axis] && to[axis] >= high[axis]);
                        let fills = covers && matches!(solid, Solid::Box { .. });
                        lookup.entries.push(Entry { fills, ..*entry });
                        // Whatever comes after is buried below this one.
                        if fills {
                            break;
                        }
                    }
                }
                lookup.starts.push(lookup.entries.len() as u32);
            }
        }
        lookup
    }

    /// Height of the highest solid at a point inside the map, m; NaN where there is none.
    pub(super) fn height_m(&self, solids: &[Solid], x_m: f32, y_m: f32) -> f32 {
        let row = (((x_m - self.min_m[0]) / BUCKET_M) as usize).min(self.rows - 1);
        let column = (((y_m - self.min_m[1]) / BUCKET_M) as usize).min(self.columns - 1);
        let bucket = row * self.columns + column;
        let entries = &self.entries[self.starts[bucket] as usize..self.starts[bucket + 1] as usize];
        let mut height_m = f32::NEG_INFINITY;
        for entry in entries {
            if height_m >= entry.top_m {
                break;
            }
            if entry.fills {
                return entry.top_m;
            }
            height_m = height_m.max(solids[entry.solid as usize].height_m(x_m, y_m));
        }
        if height_m.is_finite() { height_m } else { f32::NAN }
    }
}
