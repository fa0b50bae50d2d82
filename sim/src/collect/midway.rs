//! Rows that start midway: where a rollout of the skill's own had the robot, whatever became of it.
//!
//! Halfway over an obstacle is then terrain that predictors know, in states that a stand never is in.

use crate::{
    driver::TICK_S,
    plant::{BasePose, Plant},
    rollout::{Chance, RolloutRules, RunUp, Trial},
    spawn::Spawn,
    terrain::{Terrain, Vantage},
};

/// Number of the repeat whose draws the rollout has that a row starts from: no label's.
const DONOR: u64 = u64::MAX;
/// So far beyond the tile's spawn area a row may start, m: what a rollout from there sees is still known.
const LEEWAY_M: f32 = 0.4;

/// Where a rollout from `trial`'s pose had the robot at one of its ticks.
///
/// The tick is drawn evenly from all that the rollout had, the first one left out and those in which the
/// base had left the tile; `draw` from 0 to 1 picks it. `None` where there is no such tick.
fn tick_of(trial: &Trial<'_>, plant: &mut Plant, chance: &Chance, draw: f32) -> Option<(usize, BasePose)> {
    let mut ticks = Vec::new();
    let mut tick = 0_usize;
    plant.restore(&trial.spawn.snapshot);
    trial.roll_watched(plant, chance, &mut |measured| {
        let [x_m, y_m, _] = measured.base.position_m;
        if tick > 0 && is_on(trial.terrain, [x_m, y_m]) {
            ticks.push((tick, measured.base));
        }
        tick += 1;
    });
    ticks.get(((draw * ticks.len() as f32) as usize).min(ticks.len().checked_sub(1)?)).copied()
}

/// The robot at a tick of a rollout from `trial`'s pose, in full: pose, velocities, joints, contacts. A skill
/// that then takes over is reset there, as after a switch.
///
/// The rollout is made twice, the second time up to the tick alone: that is cheaper than keeping the state
/// of every tick.
pub(super) fn midway(trial: &Trial<'_>, plant: &mut Plant, chance: &Chance, draw: f32) -> Option<Spawn> {
    let (tick, _) = tick_of(trial, plant, chance, draw)?;
    let rules = RolloutRules { time_limit_s: tick as f64 * TICK_S, ..*trial.rules };
    Trial { rules: &rules, ..*trial }.roll_out(plant, chance);
    let measured = plant.measure();
    let mut spawn = Spawn { snapshot: plant.snapshot(), ..seen_from(trial, measured.base) };
    for (target, position_rad) in spawn.targets.iter_mut().zip(&measured.joint_position_rad) {
        target.position_rad = *position_rad;
    }
    Some(spawn)
}

/// The pose at a tick of a rollout that goes on from there, and the way up to it. The skill is not reset: it
/// has its speed, and whatever it remembers. Snapshot and targets are still those of where it set off.
pub(super) fn in_stride(
    trial: &Trial<'_>,
    plant: &mut Plant,
    chance: Chance,
    draw: f32,
) -> Option<(Spawn, RunUp)> {
    let (ticks, base) = tick_of(trial, plant, &chance, draw)?;
    Some((seen_from(trial, base), RunUp { from: trial.spawn.clone(), ticks, chance }))
}

/// The trial's pose with another base, and the field around it.
fn seen_from(trial: &Trial<'_>, base: BasePose) -> Spawn {
    let from = Vantage { position_m: base.position_m, yaw_rad: base.yaw() };
    Spawn { base, heightfield: trial.terrain.heightfield(&from), ..trial.spawn.clone() }
}

/// What the rollout of a row has drawn that the row starts from.
pub(super) fn donor(row_seed: u64, config: &super::CollectConfig) -> Chance {
    Chance::draw(row_seed, DONOR, &config.perturb, config.sensor_noise())
}

fn is_on(terrain: &Terrain, base_m: [f32; 2]) -> bool {
    // Phrased as "is inside", so that NaN is not.
    (0..2).all(|axis| {
        let inside = terrain.spawn_min_m[axis] - LEEWAY_M..=terrain.spawn_max_m[axis] + LEEWAY_M;
        inside.contains(&base_m[axis])
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::TerrainKind;

    #[test]
    fn a_row_starts_no_further_out_than_a_rollout_can_see_from() {
        let gap = Terrain::tile(TerrainKind::Gap, 0.5, 0);
        let [x_m, y_m] = gap.spawn_max_m;
        assert!(is_on(&gap, [x_m + 0.39, y_m]) && !is_on(&gap, [x_m + 0.41, y_m]));
        assert!(!is_on(&gap, [f32::NAN, 0.0]) && !is_on(&gap, [0.5, y_m + 0.41]));
    }
}
