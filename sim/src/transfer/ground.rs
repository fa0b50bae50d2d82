//! The terrain as the second simulator is told it: the very solids that rapier collides with.

use serde::Serialize;

use crate::terrain::{Solid, Terrain};

/// A fixed body; field for field a [`Solid`].
#[derive(Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Ground<'a> {
    /// A box along the world's axes.
    Box { centre_m: [f32; 3], half_extents_m: [f32; 3] },
    /// Heights on a regular grid.
    Grid { origin_m: [f32; 2], spacing_m: f32, rows: usize, columns: usize, heights_m: &'a [f32] },
}

impl<'a> Ground<'a> {
    pub(super) fn of(terrain: &'a Terrain) -> Vec<Self> {
        let ground = |solid: &'a Solid| match solid {
            Solid::Box { centre_m, half_extents_m } => {
                Self::Box { centre_m: *centre_m, half_extents_m: *half_extents_m }
            }
            Solid::Grid { origin_m, spacing_m, rows, columns, heights_m } => Self::Grid {
                origin_m: *origin_m,
                spacing_m: *spacing_m,
                rows: *rows,
                columns: *columns,
                heights_m,
            },
        };
        terrain.solids.iter().map(ground).collect()
    }
}
