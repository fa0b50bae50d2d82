//! Another skill at work: asked in shadow, or walking the robot up to where an episode begins.

use std::sync::Arc;

use super::shadow::Shadow;
use super::{Environment, tick};
use crate::{driver::TICK_S, rollout::RolledSkill};

/// Longest way of another skill up to where an episode begins, ticks.
const LEAD_TICKS: u32 = 250;
/// A base this far below the stand's height over the ground is falling, m.
const SUNK_M: f32 = 0.15;

impl Environment {
    /// Has another skill answer to the present tick; false if there is none or it fails.
    pub(super) fn ask(&mut self, skill: Option<&RolledSkill>) -> bool {
        let ground = Arc::clone(&self.ground);
        if self.shadow.is_none() {
            let Some(skill) = skill else { return false };
            let rng = self.stream("environment/expert");
            let noise_m = ground.config.expert_patch_noise_m;
            self.shadow = Shadow::new(skill, self.episode.phase, &ground.robot, noise_m, rng);
        }
        let Some(shadow) = &mut self.shadow else { return false };
        let base = &self.plant.measure().base;
        let terrain = &ground.stage(self.terrain, self.level, self.episode.variant).terrain;
        let state = self.views.sensed(f64::from(self.tick) * TICK_S);
        let told = tick::for_an_expert(&self.command);
        shadow.targets(self.tick, &state, &told, terrain, base).is_some()
    }

    /// Lets the skill that leads walk the robot, by its own targets and gains, until its base has come to `x_m`;
    /// false if it does not come there on its feet.
    pub(super) fn lead_to(&mut self, x_m: f32) -> bool {
        let ground = Arc::clone(&self.ground);
        let leader = ground.leaders[self.terrain].as_ref();
        let began = self.plant.measure().base;
        self.begin_at(&began);
        self.target = None;
        self.sense();
        for _ in 0..LEAD_TICKS {
            if self.plant.measure().base.position_m[0] >= x_m {
                return true;
            }
            if !self.ask(leader) || self.height_error_m() < -SUNK_M {
                return false;
            }
            let Some(targets) = self.shadow.as_ref().and_then(Shadow::latest) else { return false };
            self.targets.copy_from_slice(targets);
            let (_, touched) = self.advance();
            if touched {
                return false;
            }
            self.tick += 1;
            self.sense();
        }
        false
    }
}
