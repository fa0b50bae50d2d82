//! The expert in shadow: another skill's plugin that sees the same robot every tick, whoever drives.

use rand_chacha::ChaCha8Rng;
use vocaloco_core::{plugin::PluginInstance, robot::RobotModel};
use vocaloco_plugin_api::{Command, JointTarget, RobotState, TerrainPatch};

use crate::{
    plant::BasePose,
    rollout::RolledSkill,
    sensing::{SensorNoise, Sensors},
    terrain::Terrain,
};

/// An expert in one episode.
pub(super) struct Shadow {
    instance: PluginInstance,
    patch: Option<TerrainPatch>,
    /// Sees terrain alone, with noise of its own.
    eyes: Sensors,
    targets: Vec<JointTarget>,
    /// Tick for which `targets` hold, if the expert gave any.
    acted_at: Option<u32>,
}

impl Shadow {
    /// An expert that starts at `phase` of its cycle; `None` when its plugin fails.
    pub(super) fn new(
        skill: &RolledSkill,
        phase: f32,
        robot: &RobotModel,
        patch_noise_m: f32,
        rng: ChaCha8Rng,
    ) -> Option<Self> {
        let instance = skill.instance(Some(phase), robot).ok()?;
        Some(Self {
            patch: instance.needs().terrain.into_option(),
            instance,
            eyes: Sensors::new(SensorNoise { patch_m: patch_noise_m, ..SensorNoise::NONE }, rng),
            targets: vec![JointTarget::default(); robot.joint_count()],
            acted_at: None,
        })
    }

    /// What the expert would do at this tick; asked again, the same. It is reset when it has not acted
    /// in the tick before, and gives nothing when its plugin fails or its targets are not numbers.
    pub(super) fn targets(
        &mut self,
        tick: u32,
        state: &RobotState<'_>,
        command: &Command,
        terrain: &Terrain,
        base: &BasePose,
    ) -> Option<&[JointTarget]> {
        if self.acted_at != Some(tick) {
            if let Some(patch) = &self.patch {
                self.eyes.look(terrain, patch, base);
            }
            let state = RobotState { terrain_m: self.eyes.readings().terrain_m.as_slice().into(), ..*state };
            let follows = tick > 0 && self.acted_at == Some(tick - 1);
            self.acted_at = None;
            if !follows {
                self.instance.reset(&state).ok()?;
            }
            self.instance.act(&state, command, &mut self.targets).ok()?;
            let finite = self
                .targets
                .iter()
                .all(|target| target.torque_nm(0.0, 1.0).is_finite() && target.position_rad.is_finite());
            self.acted_at = finite.then_some(tick);
        }
        self.latest()
    }

    /// The targets that it gave last, if it gave any.
    pub(super) fn latest(&self) -> Option<&[JointTarget]> {
        self.acted_at.map(|_| self.targets.as_slice())
    }
}
