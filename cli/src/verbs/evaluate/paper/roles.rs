//! Which skill is for the level, for going up, and for going down, by what was measured.

use serde::Serialize;
use vocaloco_sim::terrain::TerrainKind;

use super::findings::Findings;

/// What skills turned out to be good at: no name is known beforehand.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Roles {
    /// Cheapest on flat ground of those that are 90 % viable there.
    pub(super) level: String,
    /// Most viable up stairs, all heights together.
    pub(super) up: String,
    /// The same down stairs.
    pub(super) down: String,
    /// The same on both.
    pub(super) robust: String,
}

impl Findings {
    /// Skills by what they turned out to be good at; none without cells.
    pub(super) fn roles(&self, skills: &[&str]) -> Option<Roles> {
        let sum = |skill: &&str, terrain| -> f64 {
            self.cells_of(skill, terrain).iter().map(|cell| cell.viable().mean).sum()
        };
        let best = |terrain| {
            let by_sum = |a: &&&str, b: &&&str| sum(a, terrain).total_cmp(&sum(b, terrain));
            // Of equals the first in the deployment.
            skills.iter().rev().max_by(by_sum).map(|skill| (*skill).to_owned())
        };
        let cost = |skill: &&str| {
            let cell = self.cell(skill, TerrainKind::Flat, 0.0)?;
            (cell.viable().mean >= 0.9).then(|| cell.cost().map(|cost| cost.mean)).flatten()
        };
        let cheapest = skills
            .iter()
            .filter(|skill| cost(skill).is_some())
            .min_by(|a, b| cost(a).unwrap_or(f64::NAN).total_cmp(&cost(b).unwrap_or(f64::NAN)));
        let both = |skill: &&str| sum(skill, TerrainKind::StairsUp) + sum(skill, TerrainKind::StairsDown);
        let robust = skills.iter().rev().max_by(|a, b| both(a).total_cmp(&both(b)));
        Some(Roles {
            robust: (*robust?).to_owned(),
            level: (*cheapest?).to_owned(),
            up: best(TerrainKind::StairsUp)?,
            down: best(TerrainKind::StairsDown)?,
        })
    }
}
