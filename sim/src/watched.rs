//! One rollout tick by tick, seen along its path: what pictures of a gait are made from.

use std::sync::Arc;

use rapier3d::math::Rotation;
use vocaloco_core::robot::RobotModel;

use crate::{
    collect::CollectError,
    evaluate::{Query, Staging},
    plant::{BasePose, Measurement},
    rollout::{Path, RolledSkill, Rollout, Trial},
    terrain::Terrain,
};

/// A rollout and the ground it went over, in the frame of its path: x ahead along the spawn's yaw, y to
/// the left, z up, the spawn above the origin of x and y.
pub struct Watched {
    /// What it gave.
    pub rollout: Rollout,
    /// The plant before every tick; [`Measurement::base`] is in the path's frame.
    pub ticks: Vec<Measurement>,
    terrain: Terrain,
    spawn: BasePose,
}

impl Watched {
    /// Height of the ground, m; NaN outside the map.
    pub fn ground_m(&self, ahead_m: f32, left_m: f32) -> f32 {
        let level = BasePose::from_yaw([0.0; 3], self.spawn.yaw());
        let [x, y, _] = level.vector_in_world([ahead_m, left_m, 0.0]);
        self.terrain.height_m(self.spawn.position_m[0] + x, self.spawn.position_m[1] + y)
    }
}

/// Rolls a skill out from the pose of one row of a query, as [`sample`](crate::evaluate::sample) does.
///
/// # Errors
/// When no valid pose is found.
pub fn watch(
    robot: &Arc<RobotModel>,
    skill: &RolledSkill,
    query: &Query,
    row: u64,
) -> Result<Watched, CollectError> {
    let staging = Staging::new(robot, query);
    let (seed, mut scene) = staging.row(row)?;
    let spawn = scene.spawn.base;
    let path = Path::from(&spawn);
    let mut ticks = Vec::new();
    let trial = Trial { terrain: &scene.terrain, spawn: &scene.spawn, skill, rules: &query.rules };
    scene.plant.restore(&scene.spawn.snapshot);
    let rollout = trial.roll_watched(&mut scene.plant, &staging.chance(seed), &mut |measured| {
        let base = in_path(&path, spawn.yaw(), &measured.base);
        ticks.push(Measurement { base, ..measured.clone() });
    });
    Ok(Watched { rollout, ticks, terrain: scene.terrain, spawn })
}

fn in_path(path: &Path, yaw_rad: f32, base: &BasePose) -> BasePose {
    let [ahead_m, left_m] = path.displacement_m(base);
    let [x, y, z, w] = BasePose::from_yaw([0.0; 3], -yaw_rad).orientation_xyzw;
    let [bx, by, bz, bw] = base.orientation_xyzw;
    let turned = Rotation::from_xyzw(x, y, z, w) * Rotation::from_xyzw(bx, by, bz, bw);
    BasePose {
        position_m: [ahead_m as f32, left_m as f32, base.position_m[2]],
        orientation_xyzw: turned.normalize().to_array(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_base_turned_with_its_path_is_level_and_straight_in_it() {
        let spawn = BasePose::from_yaw([1.0, -2.0, 0.5], 2.0);
        let base = BasePose::from_roll_pitch_yaw([1.0, -1.0, 0.6], 0.1, -0.2, 2.3);
        let seen = in_path(&Path::from(&spawn), 2.0, &base);
        let (sin, cos) = 2.0_f32.sin_cos();
        for (found, wanted) in seen.position_m.iter().zip([sin, cos, 0.6]) {
            assert!((found - wanted).abs() < 1e-5, "{found} for {wanted}");
        }
        let wanted = BasePose::from_roll_pitch_yaw([0.0; 3], 0.1, -0.2, 0.3);
        for (found, wanted) in seen.orientation_xyzw.iter().zip(wanted.orientation_xyzw) {
            assert!((found - wanted).abs() < 1e-5, "{found} for {wanted}");
        }
    }
}
