//! A row's own piece of world: terrain, plant and settled robot, from the row's seed alone, the same
//! for every skill.

use std::sync::Arc;

use vocaloco_core::robot::RobotModel;

use crate::{
    plant::{Plant, PlantKind},
    spawn::{NoValidPose, Spawn, Spawner},
    stream::{derived_seed, stream},
    terrain::{Terrain, TerrainKind},
};

/// Terrains tried before a row is given up; one is nearly always enough.
const TERRAINS: u64 = 10;

/// Terrain, plant and the robot standing on it.
pub struct Scene {
    /// The tile.
    pub terrain: Terrain,
    /// The plant, standing as `spawn` says.
    pub plant: Plant,
    /// The settled pose.
    pub spawn: Spawn,
}

impl Scene {
    /// Builds the tile, draws poses until one is valid, and leaves the robot standing there.
    ///
    /// # Errors
    /// When none of a hundred poses on each of ten tiles was valid.
    pub fn stage(
        robot: &Arc<RobotModel>,
        spawner: &Spawner,
        (kind, size_m): (TerrainKind, f32),
        row_seed: u64,
        plant: PlantKind,
    ) -> Result<Self, NoValidPose> {
        let mut result = Self::attempt(robot, spawner, (kind, size_m), row_seed, 0, plant);
        for attempt in 1..TERRAINS {
            if result.is_ok() {
                break;
            }
            result = Self::attempt(robot, spawner, (kind, size_m), row_seed, attempt, plant);
        }
        result
    }

    fn attempt(
        robot: &Arc<RobotModel>,
        spawner: &Spawner,
        (kind, size_m): (TerrainKind, f32),
        row_seed: u64,
        attempt: u64,
        plant: PlantKind,
    ) -> Result<Self, NoValidPose> {
        let terrain = Terrain::tile(kind, size_m, derived_seed(row_seed, "tile", &[attempt]));
        let mut plant = Plant::new(robot, &terrain, plant);
        let spawn = spawner.settle(&mut plant, &terrain, &mut stream(row_seed, "pose", &[attempt]))?;
        Ok(Self { terrain, plant, spawn })
    }
}

/// The seed of a row, from which everything in it is drawn.
pub fn row_seed(seed: u64, row: u64) -> u64 {
    derived_seed(seed, "row", &[row])
}
