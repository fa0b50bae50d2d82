//! The spawn of docs/method.md: a random pose aligned with the ground, one second of settling in
//! the common stand, and the checks that make a pose valid. Knows no skill: the pose depends on the
//! stream alone.

mod leg;
mod stance;

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stance::Stance;
use thiserror::Error;
use vocaloco_core::{heightfield::Heightfield, robot::RobotModel};
use vocaloco_plugin_api::JointTarget;

use crate::{
    angle::wrapped_rad,
    plant::{BasePose, Plant, STEP_S, Snapshot, Variation},
    stream::uniform,
    terrain::{Terrain, Vantage},
};

/// What is drawn and what counts as valid. The default is that of docs/method.md.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpawnRules {
    /// Half-width of the yaw about the terrain's direction, on directed terrain.
    pub yaw_rad: f32,
    /// Share of poses on directed terrain that get any yaw.
    pub any_yaw_share: f32,
    /// On directed terrain only positions this far before the obstacle, least and most, m; none for the
    /// whole of the terrain's spawn area.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start_before_m: Option<[f32; 2]>,
    /// How long the robot stands before it is looked at.
    pub settle_s: f64,
    /// How far the settled base may be from the desired position.
    pub position_tolerance_m: f32,
    /// How far the settled yaw may be from the desired one.
    pub yaw_tolerance_rad: f32,
}

impl Default for SpawnRules {
    fn default() -> Self {
        Self {
            yaw_rad: 0.3,
            any_yaw_share: 0.2,
            start_before_m: None,
            settle_s: 1.0,
            position_tolerance_m: 0.1,
            yaw_tolerance_rad: 0.1,
        }
    }
}

/// Poses drawn on one terrain before it is given up.
const ATTEMPTS: u32 = 100;

/// A valid pose: the robot stands still in the common stand.
#[derive(Clone)]
pub struct Spawn {
    /// The settled base.
    pub base: BasePose,
    /// The plant at that moment; every rollout of the pose starts from it.
    pub snapshot: Snapshot,
    /// What holds every joint where it stands.
    pub targets: Vec<JointTarget>,
    /// The true field around the settled base.
    pub heightfield: Heightfield,
    /// Poses drawn until one was valid, this one included.
    pub attempts: u32,
}

/// No valid pose was found.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("terrain {kind} of size {size_m} m: none of {ATTEMPTS} spawn poses was valid")]
pub struct NoValidPose {
    kind: String,
    size_m: String,
}

/// Draws spawn poses for one robot.
#[derive(Clone, Debug)]
pub struct Spawner {
    stance: Stance,
    /// Stiffness and damping of the stand.
    hold: JointTarget,
    rules: SpawnRules,
}

impl Spawner {
    /// A spawner for a robot.
    pub fn new(robot: &RobotModel, rules: SpawnRules) -> Self {
        let hold = JointTarget {
            position_rad: 0.0,
            stiffness_nm_per_rad: robot.stand.stiffness_nm_per_rad,
            damping_nms_per_rad: robot.stand.damping_nms_per_rad,
            feed_forward_nm: 0.0,
        };
        Self { stance: Stance::new(&robot.description), hold, rules }
    }

    /// Draws poses until one is valid.
    ///
    /// Position: uniform over the terrain's spawn area, or [`SpawnRules::start_before_m`] of it. Yaw: the terrain's direction ±
    /// [`SpawnRules::yaw_rad`], or any. Roll and pitch: along the ground; feet on it, below where the
    /// level stand has them, joints held there at the stand's gains. Valid after
    /// [`SpawnRules::settle_s`] in the stand: base near the desired position, yaw near the desired
    /// one, no base contact at any moment.
    ///
    /// # Errors
    /// When a hundred poses in a row were not valid.
    pub fn settle(
        &self,
        plant: &mut Plant,
        terrain: &Terrain,
        rng: &mut ChaCha8Rng,
    ) -> Result<Spawn, NoValidPose> {
        plant.vary(&Variation::default());
        for attempt in 1..=ATTEMPTS {
            let Some((base, targets)) = self.attempt(plant, terrain, rng) else { continue };
            let from = Vantage { position_m: base.position_m, yaw_rad: base.yaw() };
            return Ok(Spawn {
                base,
                snapshot: plant.snapshot(),
                targets,
                heightfield: terrain.heightfield(&from),
                attempts: attempt,
            });
        }
        Err(NoValidPose { kind: terrain.kind.clone(), size_m: terrain.size_m.to_string() })
    }

    fn attempt(
        &self,
        plant: &mut Plant,
        terrain: &Terrain,
        rng: &mut ChaCha8Rng,
    ) -> Option<(BasePose, Vec<JointTarget>)> {
        let [from_m, to_m] = self.along_m(terrain);
        let x_m = uniform(rng, from_m, to_m);
        let y_m = uniform(rng, terrain.spawn_min_m[1], terrain.spawn_max_m[1]);
        let yaw_rad = self.draw_yaw_rad(terrain, rng);
        let placed = self.stance.on(terrain, x_m.into(), y_m.into(), yaw_rad.into())?;
        plant.place(&placed.base, &placed.joint_position_rad);
        let targets: Vec<JointTarget> = placed
            .joint_position_rad
            .iter()
            .map(|position_rad| JointTarget { position_rad: *position_rad, ..self.hold })
            .collect();
        let steps = (self.rules.settle_s / f64::from(STEP_S)).round() as usize;
        for _ in 0..steps {
            plant.step(&targets);
            if plant.measure().base_contact {
                return None;
            }
        }
        let settled = plant.measure().base;
        let moved_m = distance_m(settled.position_m, placed.base.position_m);
        let turned_rad = wrapped_rad(settled.yaw() - yaw_rad).abs();
        // Phrased as "is inside", so that a pose of NaN is not valid.
        let valid = moved_m <= self.rules.position_tolerance_m && turned_rad <= self.rules.yaw_tolerance_rad;
        valid.then_some((settled, targets))
    }

    /// Where along x poses are drawn.
    fn along_m(&self, terrain: &Terrain) -> [f32; 2] {
        match (self.rules.start_before_m, terrain.obstacle_x_m) {
            (Some([least_m, most_m]), Some(obstacle_m)) => [obstacle_m - most_m, obstacle_m - least_m],
            _ => [terrain.spawn_min_m[0], terrain.spawn_max_m[0]],
        }
    }

    fn draw_yaw_rad(&self, terrain: &Terrain, rng: &mut ChaCha8Rng) -> f32 {
        // Both draws always happen, so that a pose's position does not depend on its yaw's kind.
        let any = uniform(rng, 0.0, 1.0) < self.rules.any_yaw_share;
        let unit = uniform(rng, -1.0, 1.0);
        match terrain.heading_rad {
            Some(heading_rad) if !any => heading_rad + unit * self.rules.yaw_rad,
            _ => unit * std::f32::consts::PI,
        }
    }
}

fn distance_m(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f32>().sqrt()
}

#[cfg(test)]
mod tests;
