//! `skills/<name>/search.toml`: over what, and for what, a structured controller is optimised.

use std::path::Path;

use anyhow::{Context, ensure};
use serde::{Deserialize, Serialize};
use vocaloco_sim::terrain::TerrainKind;

/// A checked search configuration.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SearchConfig {
    schema: u32,
    /// Candidates to a generation.
    pub(super) population: usize,
    /// Generations in all.
    pub(super) generations: usize,
    /// Episodes to a candidate; every candidate of a generation has the same ones.
    pub(super) episodes: usize,
    /// First step of the search, in units of a parameter's range.
    pub(super) initial_step: f64,
    /// Distance ahead to reach in an episode, m. Longer than the protocol's 1.5 m: a policy tuned
    /// to 1.5 m may be about to fall there.
    pub(super) horizon_m: f64,
    /// Time to reach it in, s.
    pub(super) time_limit_s: f64,
    /// Forward velocity commanded, m/s.
    pub(super) forward_m_per_s: f32,
    /// Share of the episodes with every perturbation on, pushes, latency and motor strength included;
    /// the others have the collection protocol's.
    pub(super) disturbed_share: f32,
    /// Episodes, fresh to the search, that the result is judged by.
    pub(super) final_episodes: usize,
    /// What counts.
    pub(super) objective: Objective,
    /// Over which terrain.
    pub(super) terrain: Vec<Mix>,
    /// Parameters held at their starting value.
    #[serde(default)]
    pub(super) fixed: Vec<String>,
    /// Where the search starts; what is left out starts at the plugin's default.
    #[serde(default)]
    pub(super) start: std::collections::BTreeMap<String, f64>,
}

/// Weights of an episode's cost.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Objective {
    /// A base contact or a time-out, on top of the distance not made.
    pub(super) failure: f64,
    /// Cost of transport, positive work.
    pub(super) cost_of_transport: f64,
    /// Mean speed, start included, short of the commanded one, as a share of it.
    pub(super) slowness: f64,
    /// Mean speed beyond the commanded one, as a share of it: a robot that runs away down stairs.
    pub(super) haste: f64,
    /// Share of time in which thigh, hip or shank touches something.
    pub(super) limb_contact: f64,
    /// Share of joint samples beyond the drive's speed limit.
    pub(super) joint_overspeed: f64,
}

/// One terrain of the mix.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Mix {
    /// Which.
    pub(super) kind: TerrainKind,
    /// Sizes, drawn evenly, m.
    pub(super) size_m: [f32; 2],
    /// Share of the episodes.
    pub(super) share: f64,
}

impl SearchConfig {
    /// Reads and checks the file.
    pub(super) fn read(path: &Path) -> anyhow::Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| {
            format!("{}: cannot be read; a skill to be optimised needs one", path.display())
        })?;
        let config: Self =
            toml::from_str(&text).with_context(|| format!("{}: does not parse", path.display()))?;
        config.check().with_context(|| path.display().to_string())?;
        Ok(config)
    }

    /// Refuses numbers outside their ranges.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        ensure!(self.schema == 1, "schema: found {}, wanted 1", self.schema);
        for (field, found) in [
            ("population", self.population),
            ("generations", self.generations),
            ("episodes", self.episodes),
            ("final_episodes", self.final_episodes),
        ] {
            ensure!((1..=100_000).contains(&found), "{field}: found {found}, wanted 1 to 100000");
        }
        ensure!(self.population >= 4, "population: found {}, wanted at least 4", self.population);
        for (field, found, low, high) in [
            ("initial_step", self.initial_step, 0.001, 1.0),
            ("horizon_m", self.horizon_m, 0.5, 3.0),
            ("time_limit_s", self.time_limit_s, 1.0, 30.0),
            ("disturbed_share", f64::from(self.disturbed_share), 0.0, 1.0),
            ("forward_m_per_s", f64::from(self.forward_m_per_s), 0.1, 1.5),
        ] {
            ensure!((low..=high).contains(&found), "{field}: found {found}, wanted {low} to {high}");
        }
        ensure!(!self.terrain.is_empty(), "terrain: found none, wanted at least one [[terrain]]");
        for mix in &self.terrain {
            ensure!(
                mix.share > 0.0 && mix.size_m[0] <= mix.size_m[1],
                "terrain {}: found share {} and size_m {:?}, wanted a positive share and sizes in order",
                mix.kind,
                mix.share,
                mix.size_m
            );
        }
        Ok(())
    }

    /// The terrain at `draw` 0 to 1 of the mix.
    pub(super) fn terrain_at(&self, draw: f64) -> &Mix {
        let total: f64 = self.terrain.iter().map(|mix| mix.share).sum();
        let mut left = draw * total;
        for mix in &self.terrain {
            left -= mix.share;
            if left < 0.0 {
                return mix;
            }
        }
        &self.terrain[self.terrain.len() - 1]
    }
}
