//! Whether the fast plant gives the reference's labels: the same rows rolled out on both, viability and
//! cost of transport side by side.

use std::sync::Arc;

use serde::Serialize;
use vocaloco_core::robot::RobotModel;

use crate::{
    collect::CollectError,
    evaluate::{Query, Sample, mean, sample, standard_deviation},
    plant::PlantKind,
    rollout::{Outcome, RolledSkill},
    terrain::TerrainKind,
    transfer::{Agreement, agreement},
};

/// Farther apart in viability than this, the plants do not agree, points.
pub const VIABILITY_POINTS: f64 = 3.0;
/// Farther apart in mean cost of transport than this, the plants do not agree, percent.
pub const COT_PERCENT: f64 = 3.0;

/// Both plants on one terrain of one size.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlantAgreement {
    /// Skill.
    pub skill: String,
    /// Terrain.
    pub terrain: TerrainKind,
    /// Its size, m.
    pub size_m: f32,
    /// Share that reached the horizon on the reference plant.
    pub viable_reference: f64,
    /// The same on the fast plant.
    pub viable_fast: f64,
    /// Viability, fast minus reference.
    #[serde(flatten)]
    pub viability: Agreement,
    /// Cost of transport; `None` where fewer than two rows reached the horizon on both.
    pub cot: Option<CostAgreement>,
    /// Viability within [`VIABILITY_POINTS`], cost within [`COT_PERCENT`].
    pub agrees: bool,
}

/// Cost of transport over the rows that reached the horizon on both plants.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CostAgreement {
    /// Number of rows.
    pub n: usize,
    /// Mean on the reference plant.
    pub reference: f64,
    /// Mean on the fast plant.
    pub fast: f64,
    /// Fast over reference, percent more.
    pub percent: f64,
    /// Lower end of its 95 % interval.
    pub percent_low: f64,
    /// Upper end of its 95 % interval.
    pub percent_high: f64,
}

/// Rolls a skill out on both plants from the rows of a query, whose own plant does not matter; `progress`
/// is called once for each rollout, from any thread.
///
/// A row draws the same terrain, desired pose, perturbations and noise on both; the robot settles on each.
///
/// # Errors
/// As [`sample`].
pub fn plant_agreement(
    robot: &Arc<RobotModel>,
    skill: &RolledSkill,
    query: &Query,
    progress: &(dyn Fn() + Sync),
) -> Result<PlantAgreement, CollectError> {
    let on = |plant| sample(robot, skill, &Query { plant, ..query.clone() }, progress);
    let (reference, fast) = (on(PlantKind::Reference)?, on(PlantKind::Fast)?);
    let reached = |one: &Sample| one.rollout.outcome == Outcome::Reached;
    let viable = |samples: &[Sample]| {
        samples.iter().filter(|one| reached(one)).count() as f64 / samples.len().max(1) as f64
    };
    let pairs = || reference.iter().zip(&fast);
    let viability = agreement(pairs().map(|(reference, fast)| (reached(reference), reached(fast))));
    let both = pairs().filter(|(reference, fast)| reached(reference) && reached(fast));
    let costs = both.filter_map(|(a, b)| a.rollout.cot_positive.zip(b.rollout.cot_positive));
    let cot = cost_agreement(&costs.collect::<Vec<_>>());
    Ok(PlantAgreement {
        skill: skill.name.clone(),
        terrain: query.terrain,
        size_m: query.size_m,
        viable_reference: viable(&reference),
        viable_fast: viable(&fast),
        agrees: viability.points.abs() <= VIABILITY_POINTS
            && cot.is_none_or(|cot| cot.percent.abs() <= COT_PERCENT),
        viability,
        cot,
    })
}

/// How much more the second costs than the first, over pairs.
///
/// ```text
/// r = Σ b / Σ a,   100·(r − 1 ± 1.96·s(b − r·a) / (√n · mean a))
/// ```
///
/// # Source
/// W. G. Cochran, *Sampling Techniques* (1977), ratio estimators, eq. 6.12 for a large population.
fn cost_agreement(pairs: &[(f64, f64)]) -> Option<CostAgreement> {
    let reference = mean(&pairs.iter().map(|pair| pair.0).collect::<Vec<_>>())?;
    let fast = mean(&pairs.iter().map(|pair| pair.1).collect::<Vec<_>>())?;
    let ratio = fast / reference;
    let left: Vec<f64> = pairs.iter().map(|(reference, fast)| fast - ratio * reference).collect();
    let half = 1.959_964 * standard_deviation(&left)? / ((pairs.len() as f64).sqrt() * reference);
    Some(CostAgreement {
        n: pairs.len(),
        reference,
        fast,
        percent: 100.0 * (ratio - 1.0),
        percent_low: 100.0 * (ratio - 1.0 - half),
        percent_high: 100.0 * (ratio - 1.0 + half),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cost_that_is_always_two_percent_higher_is_known_exactly() {
        let found = cost_agreement(&[(0.2, 0.204), (0.5, 0.51), (0.9, 0.918)]).unwrap();
        for percent in [found.percent, found.percent_low, found.percent_high] {
            assert!((percent - 2.0).abs() < 1e-9, "{found:?}");
        }
        assert_eq!((found.n, cost_agreement(&[(0.2, 0.3)])), (3, None));
    }

    #[test]
    fn scatter_widens_the_interval_as_the_ratio_estimator_says() {
        // Means 1 and 1, residuals ±0.1: s = √(4·0.01/3).
        let found = cost_agreement(&[(1.0, 1.1), (1.0, 0.9), (1.0, 1.1), (1.0, 0.9)]).unwrap();
        let half = 100.0 * 1.959_964 * (0.04_f64 / 3.0).sqrt() / 2.0;
        assert!(found.percent.abs() < 1e-9 && (found.percent_high - half).abs() < 1e-9, "{found:?}");
    }
}
