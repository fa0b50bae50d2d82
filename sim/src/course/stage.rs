//! A course ready to be driven: terrain, plant, and the robot settled on the near flat.

use std::sync::Arc;

use vocaloco_core::robot::RobotModel;

use super::{CourseConfig, CourseError};
use crate::{
    plant::{Plant, PlantKind},
    rollout::{Chance, Perturbations},
    spawn::Spawner,
    stream::stream,
    terrain::Terrain,
};

/// The terrain of a course and the robot standing on it.
pub struct CourseStage {
    /// The course.
    pub terrain: Terrain,
    /// The reference plant, settled.
    pub plant: Plant,
}

impl CourseStage {
    /// Builds the course and settles the robot in the stand, by the stream `course_spawn`.
    ///
    /// # Errors
    /// When no valid pose is found on the near flat.
    pub fn set(robot: &Arc<RobotModel>, config: &CourseConfig) -> Result<Self, CourseError> {
        let mut terrain = Terrain::course(config.kind, config.size_m, config.steps);
        [terrain.spawn_min_m[0], terrain.spawn_max_m[0]] = config.start_m;
        let mut plant = Plant::new(robot, &terrain, PlantKind::Reference);
        let mut rng = stream(config.seed, "course_spawn", &[config.rollout]);
        Spawner::new(robot, config.spawn).settle(&mut plant, &terrain, &mut rng)?;
        if config.varied {
            let chance = Chance::draw(config.seed, config.rollout, &Perturbations::protocol(), config.noise);
            plant.vary(&chance.variation);
        }
        Ok(Self { terrain, plant })
    }
}
