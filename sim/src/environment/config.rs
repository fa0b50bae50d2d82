//! The `[environment]` table of a skill's `training.toml`.

use std::{collections::BTreeMap, ops::RangeInclusive};

use serde::{Deserialize, Serialize};
use thiserror::Error;
use vocaloco_plugin_api::contract::Contract;

use super::reward::RewardConfig;
use super::target::TargetRules;
use crate::{plant::PlantKind, sensing::SensorNoise, spawn::SpawnRules, terrain::TerrainKind};

/// Where and how a policy is trained. What is left out has the value it has in docs/method.md.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EnvironmentConfig {
    /// Which plant.
    pub plant: PlantKind,
    /// Longest episode, s.
    pub episode_s: f32,
    /// Levels of difficulty of each terrain.
    pub levels: u32,
    /// Tiles to a level, sizes spread over it.
    pub variants: u32,
    /// Settled poses to a tile.
    pub poses: u32,
    /// A fresh run starts each environment on a level from 0 to this one.
    pub initial_level: u32,
    /// Half-width of the noise on the expert's terrain patch, m.
    pub expert_patch_noise_m: f32,
    /// Ticks by which targets reach the drives late, least and most; drawn for each episode.
    pub latency_ticks: [u32; 2],
    /// Terrains and their shares of the environments.
    pub terrain: Vec<TerrainShare>,
    /// Skill whose plugin says what to do on a terrain, for imitation.
    pub experts: BTreeMap<TerrainKind, String>,
    /// Parameters of all structured experts that take other values here than in their own files: what a
    /// network without memory cannot see, such as a cycle that hurries, is switched off.
    pub expert_parameters: BTreeMap<String, f64>,
    /// Poses.
    pub spawn: SpawnRules,
    /// How episodes start in motion.
    pub start: StartRules,
    /// What is commanded.
    pub command: CommandRules,
    /// Where to go instead, for a policy that takes position targets; by default as its manifest says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<TargetRules>,
    /// An episode goes on through contacts of the base that are no longer than this, s, and counts as no
    /// success; none ends with the first contact.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_contact_s: Option<f32>,
    /// A base this far below where its episode began has fallen, m; none lets it stand in a hole.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fall_m: Option<f32>,
    /// Friction, mass and motor strength, drawn for each episode.
    pub variation: VariationRules,
    /// Pushes on the way.
    pub push: PushRules,
    /// Noise on what the policy measures.
    pub noise: SensorNoise,
    /// When the level moves.
    pub curriculum: CurriculumRules,
    /// What is rewarded.
    pub reward: RewardConfig,
    /// Observation, action and gains; by default those of the skill's manifest, and without one those of
    /// docs/method.md, for the robot.
    pub contract: Option<Contract>,
}

/// One terrain of the mix.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TerrainShare {
    /// Which.
    pub kind: TerrainKind,
    /// Relative to the sum of all shares.
    pub share: f32,
    /// Size at the easiest and at the hardest, m.
    pub size_m: [f32; 2],
    /// Length of a wall's top along the way, least and most, m; by default the collection's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_m: Option<[f32; 2]>,
    /// Starts only this far before the obstacle, least and most, m; by default as `spawn` says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_before_m: Option<[f32; 2]>,
    /// Another skill walks the robot up to the obstacle before an episode begins; none begins from the stand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub led: Option<LedRules>,
}

/// Episodes that begin in the midst of another skill's stride, as when it hands over.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LedRules {
    /// The skill that leads, a structured one with `expert_parameters`.
    pub by: String,
    /// It hands over this far before the obstacle, least and most, m; beyond its edge below 0.
    pub to_m: [f32; 2],
}

impl TerrainShare {
    /// A terrain as deep as the collection's, begun from the stand.
    pub fn new(kind: TerrainKind, share: f32, size_m: [f32; 2]) -> Self {
        Self { kind, share, size_m, depth_m: None, start_before_m: None, led: None }
    }
}

/// Episodes that start in motion instead of from the stand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StartRules {
    /// Share of the episodes.
    pub moving_share: f32,
    /// Forward velocity of the base, least and most, m/s.
    pub forward_m_per_s: [f32; 2],
}

/// The velocity command, drawn for each episode and steered as in collection.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CommandRules {
    /// Forward velocity, least and most, m/s.
    pub forward_m_per_s: [f32; 2],
    /// The protocol's forward velocity, m/s, ...
    pub protocol_m_per_s: f32,
    /// ... which this share of the episodes commands.
    pub protocol_share: f32,
    /// Commanded yaw rate per heading error, 1/s, clipped to ± 1 rad/s.
    pub steering_per_s: f32,
}

/// Ranges of what differs between episodes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VariationRules {
    /// Coulomb friction, least and most.
    pub friction: [f32; 2],
    /// Mass added to the base, least and most, kg.
    pub base_mass_offset_kg: [f32; 2],
    /// Factor on the drives' torque, least and most.
    pub motor_strength: [f32; 2],
}

/// Sudden velocities of the base, in any horizontal direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PushRules {
    /// Least and most, m/s.
    pub speed_m_per_s: [f32; 2],
    /// Time to the next one, least and most, s.
    pub every_s: [f32; 2],
}

/// When an environment moves to another level; distances as shares of the commanded one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CurriculumRules {
    /// A level up from here, if the episode did not end in a fall.
    pub up_share: f32,
    /// A level down below this.
    pub down_share: f32,
}

impl Default for EnvironmentConfig {
    fn default() -> Self {
        Self {
            plant: PlantKind::Fast,
            episode_s: 9.0,
            levels: 10,
            variants: 4,
            poses: 6,
            initial_level: 4,
            expert_patch_noise_m: 0.02,
            latency_ticks: [0, 1],
            terrain: vec![
                TerrainShare::new(TerrainKind::Flat, 0.6, [0.0, 0.0]),
                TerrainShare::new(TerrainKind::Discrete, 0.2, [0.0, 0.15]),
                TerrainShare::new(TerrainKind::Rough, 0.2, [0.0, 0.1]),
            ],
            experts: BTreeMap::new(),
            expert_parameters: BTreeMap::new(),
            spawn: SpawnRules { any_yaw_share: 0.0, ..SpawnRules::default() },
            start: StartRules::default(),
            command: CommandRules::default(),
            target: None,
            base_contact_s: None,
            fall_m: None,
            variation: VariationRules::default(),
            push: PushRules::default(),
            noise: SensorNoise { patch_m: 0.1, ..SensorNoise::default() },
            curriculum: CurriculumRules::default(),
            reward: RewardConfig::default(),
            contract: None,
        }
    }
}

impl Default for StartRules {
    fn default() -> Self {
        Self { moving_share: 0.3, forward_m_per_s: [0.0, 0.8] }
    }
}

impl Default for CommandRules {
    fn default() -> Self {
        Self { forward_m_per_s: [0.4, 0.7], protocol_m_per_s: 0.6, protocol_share: 0.5, steering_per_s: 0.5 }
    }
}

impl Default for VariationRules {
    fn default() -> Self {
        Self { friction: [0.5, 1.25], base_mass_offset_kg: [-5.0, 5.0], motor_strength: [0.9, 1.1] }
    }
}

impl Default for PushRules {
    fn default() -> Self {
        Self { speed_m_per_s: [0.0, 0.75], every_s: [2.0, 6.0] }
    }
}

impl Default for CurriculumRules {
    fn default() -> Self {
        Self { up_share: 0.8, down_share: 0.5 }
    }
}

/// A field of the `[environment]` table that makes no sense.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("environment.{field}: found {found}, wanted {wanted}")]
pub struct ConfigError {
    /// The field, such as `terrain[1].size_m`.
    pub field: String,
    /// What stands there.
    pub found: String,
    /// What would be right.
    pub wanted: String,
}

impl ConfigError {
    pub(super) fn new(field: impl Into<String>, found: impl Into<String>, wanted: impl Into<String>) -> Self {
        Self { field: field.into(), found: found.into(), wanted: wanted.into() }
    }
}

impl EnvironmentConfig {
    /// The skills that it names, with the fields that name them: experts, and those that lead.
    pub fn skills(&self) -> impl Iterator<Item = (String, &str)> {
        let experts = self.experts.iter().map(|(kind, name)| (format!("experts.{kind}"), name.as_str()));
        let leads = self.terrain.iter().enumerate().filter_map(|(index, terrain)| {
            terrain.led.as_ref().map(|led| (format!("terrain[{index}].led.by"), led.by.as_str()))
        });
        experts.chain(leads)
    }

    /// Refuses numbers outside their ranges.
    ///
    /// # Errors
    /// The first field that is wrong.
    pub fn check(&self) -> Result<(), ConfigError> {
        for (field, count, most) in
            [("levels", self.levels, 100), ("variants", self.variants, 1000), ("poses", self.poses, 1000)]
        {
            inside(field, count as f32, 1.0..=most as f32)?;
        }
        inside("initial_level", self.initial_level as f32, 0.0..=(self.levels - 1) as f32)?;
        inside("episode_s", self.episode_s, 1.0..=60.0)?;
        inside("expert_patch_noise_m", self.expert_patch_noise_m, 0.0..=1.0)?;
        inside("start.moving_share", self.start.moving_share, 0.0..=1.0)?;
        inside("command.protocol_m_per_s", self.command.protocol_m_per_s, 0.1..=1.5)?;
        inside("command.protocol_share", self.command.protocol_share, 0.0..=1.0)?;
        inside("command.steering_per_s", self.command.steering_per_s, 0.0..=5.0)?;
        inside("curriculum.up_share", self.curriculum.up_share, self.curriculum.down_share..=1.0)?;
        inside("curriculum.down_share", self.curriculum.down_share, 0.0..=1.0)?;
        let ticks = self.latency_ticks.map(|ticks| ticks as f32);
        for (field, range, limits) in [
            ("latency_ticks", ticks, 0.0..=5.0),
            ("start.forward_m_per_s", self.start.forward_m_per_s, 0.0..=1.5),
            ("command.forward_m_per_s", self.command.forward_m_per_s, 0.1..=1.5),
            ("variation.friction", self.variation.friction, 0.05..=3.0),
            ("variation.base_mass_offset_kg", self.variation.base_mass_offset_kg, -10.0..=20.0),
            ("variation.motor_strength", self.variation.motor_strength, 0.5..=1.5),
            ("push.speed_m_per_s", self.push.speed_m_per_s, 0.0..=3.0),
            ("push.every_s", self.push.every_s, 0.1..=1e4),
        ] {
            ordered(field, range, limits)?;
        }
        inside("base_contact_s", self.base_contact_s.unwrap_or(0.0), 0.0..=5.0)?;
        inside("fall_m", self.fall_m.unwrap_or(1.0), 0.1..=10.0)?;
        ordered("spawn.start_before_m", self.spawn.start_before_m.unwrap_or_default(), 0.0..=3.0)?;
        self.target.as_ref().map_or(Ok(()), TargetRules::check)?;
        if self.terrain.is_empty() {
            return Err(ConfigError::new("terrain", "none", "at least one [[environment.terrain]]"));
        }
        for (index, terrain) in self.terrain.iter().enumerate() {
            inside(format!("terrain[{index}].share"), terrain.share, 1e-6..=1e6)?;
            ordered(format!("terrain[{index}].size_m"), terrain.size_m, 0.0..=1.0)?;
            let field = format!("terrain[{index}].depth_m");
            match terrain.depth_m {
                Some(_) if terrain.kind != TerrainKind::Wall => {
                    return Err(ConfigError::new(field, "a depth", format!("none of {}", terrain.kind)));
                }
                Some(depth_m) => ordered(field, depth_m, 0.5..=10.0)?,
                None => {}
            }
            for (name, is_set) in
                [("start_before_m", terrain.start_before_m.is_some()), ("led", terrain.led.is_some())]
            {
                if is_set && !terrain.kind.is_directed() {
                    let wanted = format!("none: {} has no obstacle to start before", terrain.kind);
                    return Err(ConfigError::new(format!("terrain[{index}].{name}"), "a distance", wanted));
                }
            }
            let (start_before_m, led_to_m) =
                (terrain.start_before_m, terrain.led.as_ref().map(|led| led.to_m));
            for (field, range, least) in
                [("start_before_m", start_before_m, 0.0), ("led.to_m", led_to_m, -3.0)]
            {
                ordered(format!("terrain[{index}].{field}"), range.unwrap_or_default(), least..=3.0)?;
            }
        }
        self.reward.check()
    }

    /// The terrain of an environment: shares are met as closely by the first few environments as by all.
    ///
    /// ```text
    /// u = frac((index + ½)/φ),   φ the golden ratio; the first terrain whose cumulated share exceeds u
    /// ```
    pub(super) fn terrain_of(&self, index: u32) -> usize {
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        let total: f64 = self.terrain.iter().map(|terrain| f64::from(terrain.share)).sum();
        let position = (f64::from(index) + 0.5) * GOLDEN;
        let mut left = (position - position.floor()) * total;
        for (entry, terrain) in self.terrain.iter().enumerate() {
            left -= f64::from(terrain.share);
            if left < 0.0 {
                return entry;
            }
        }
        self.terrain.len() - 1
    }
}

/// Phrased as "is inside", so that NaN is refused.
pub(super) fn inside(
    field: impl Into<String>,
    value: f32,
    limits: RangeInclusive<f32>,
) -> Result<(), ConfigError> {
    if limits.contains(&value) {
        return Ok(());
    }
    Err(ConfigError::new(field, value.to_string(), format!("{} to {}", limits.start(), limits.end())))
}

pub(super) fn ordered(
    field: impl Into<String>,
    [low, high]: [f32; 2],
    limits: RangeInclusive<f32>,
) -> Result<(), ConfigError> {
    if limits.contains(&low) && limits.contains(&high) && low <= high {
        return Ok(());
    }
    let wanted = format!("[least, most] within {} to {}", limits.start(), limits.end());
    Err(ConfigError::new(field, format!("[{low}, {high}]"), wanted))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_table_is_the_default_and_survives_writing() {
        let empty: EnvironmentConfig = toml::from_str("").unwrap();
        assert_eq!(empty, EnvironmentConfig::default());
        assert_eq!(empty.check(), Ok(()));
        let written = toml::to_string(&empty).unwrap();
        assert_eq!(toml::from_str::<EnvironmentConfig>(&written).unwrap(), empty);
    }

    #[test]
    fn what_is_not_known_or_out_of_range_is_refused_by_name() {
        assert!(
            toml::from_str::<EnvironmentConfig>("levles = 3").unwrap_err().to_string().contains("levles")
        );
        let refused =
            |text: &str| toml::from_str::<EnvironmentConfig>(text).unwrap().check().unwrap_err().field;
        assert_eq!(refused("episode_s = nan"), "episode_s");
        assert_eq!(refused("levels = 3\ninitial_level = 3"), "initial_level");
        assert_eq!(refused("variation = { friction = [1.0, 0.5] }"), "variation.friction");
        assert_eq!(refused("terrain = []"), "terrain");
        assert_eq!(refused("base_contact_s = nan"), "base_contact_s");
        assert_eq!(refused("target = { distance_m = [2.0, 1.0], time_s = [4.0, 8.0] }"), "target.distance_m");
        assert_eq!(refused("reward = { target = { half_m = 0.0 } }"), "reward.target.half_m");
        let flat = "terrain = [{ kind = \"flat\", share = 1, size_m = [0.0, 0.0], depth_m = [1.5, 2.0] }]";
        assert_eq!(refused(flat), "terrain[0].depth_m");
        let terrain = "terrain = [{ kind = \"flat\", share = 1, size_m = [0.0, 0.0] }, { kind = \"rough\", share = 0.0, size_m = [0.0, 0.1] }]";
        assert_eq!(refused(terrain), "terrain[1].share");
    }

    #[test]
    fn shares_are_met_by_few_environments_and_by_many() {
        let config = EnvironmentConfig::default();
        for count in [20_u32, 512] {
            for (entry, terrain) in config.terrain.iter().enumerate() {
                let found = (0..count).filter(|index| config.terrain_of(*index) == entry).count();
                let wanted = terrain.share * count as f32;
                assert!((found as f32 - wanted).abs() <= 2.0, "{}: {found} of {count}", terrain.kind);
            }
        }
    }
}
