//! One skill on one terrain of one size: what rollouts gave from fresh poses, and what its predictors said
//! of the very fields that those poses see. The paper's figures of data and of predictions, and the
//! oracle, are read off such cells.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use vocaloco_core::robot::RobotModel;

use crate::{
    calibration::{CalibrationError, Predictors},
    course::Worth,
    evaluate::{Query, mean, sample, standard_deviation, wilson},
    rollout::{Outcome, RolledSkill},
    scores,
    terrain::TerrainKind,
};

/// What was collected and predicted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Collected {
    /// Skill.
    pub skill: String,
    /// Terrain.
    pub terrain: TerrainKind,
    /// Its size, m.
    pub size_m: f32,
    /// Predicted viability, and whether the horizon was reached (1 or 0), for every rollout.
    pub viability: Vec<(f32, f32)>,
    /// Predicted and collected cost of transport of the rollouts that reached the horizon.
    pub cot: Vec<(f32, f32)>,
}

/// A mean with its spread and its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Number of values.
    pub n: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation; 0 of a single value.
    pub std: f64,
    /// Lower end of the mean's 95 % interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Rolls a skill out from fresh poses, one rollout each, on the current rayon pool, and asks its
/// predictors about them.
///
/// # Errors
/// No valid pose is found, a field is mostly unknown, or a network gives no usable answer.
pub fn collect(
    robot: &Arc<RobotModel>,
    skill: &RolledSkill,
    predictors: &mut Predictors,
    query: &Query,
    progress: &(dyn Fn() + Sync),
) -> Result<Collected, CalibrationError> {
    let samples = sample(robot, skill, query, progress)?;
    let (mut viability, mut cot) = (Vec::with_capacity(samples.len()), Vec::new());
    for sample in &samples {
        let reached = sample.rollout.outcome == Outcome::Reached;
        viability.push((predictors.viability.predict(&sample.field)?, if reached { 1.0 } else { 0.0 }));
        if let Some(collected) = sample.rollout.cot_positive.filter(|_| reached) {
            cot.push((predictors.cot.predict(&sample.field)?, collected as f32));
        }
    }
    let (terrain, size_m) = (query.terrain, query.size_m);
    Ok(Collected { skill: skill.name.clone(), terrain, size_m, viability, cot })
}

impl Collected {
    /// Number of rollouts.
    pub fn n(&self) -> usize {
        self.viability.len()
    }

    /// Share of rollouts that reached the horizon, with Wilson's interval.
    pub fn viable(&self) -> Spread {
        let n = self.n();
        let reached = self.viability.iter().filter(|(_, reached)| *reached > 0.5).count();
        let share = if n == 0 { 0.0 } else { reached as f64 / n as f64 };
        let [low, high] = wilson(reached, n);
        Spread { n, mean: share, std: (share * (1.0 - share)).sqrt(), low, high }
    }

    /// Predicted viability over the same poses.
    pub fn predicted_viable(&self) -> Option<Spread> {
        spread(self.viability.iter().map(|(predicted, _)| *predicted))
    }

    /// Cost of transport of the rollouts that reached the horizon.
    pub fn cost(&self) -> Option<Spread> {
        spread(self.cot.iter().map(|(_, collected)| *collected))
    }

    /// Predicted cost of transport over the same rollouts.
    pub fn predicted_cost(&self) -> Option<Spread> {
        spread(self.cot.iter().map(|(predicted, _)| *predicted))
    }

    /// What an oracle knows of it.
    pub fn worth(&self) -> Worth {
        Worth { viability: self.viable().mean, cot: self.cost().map(|cost| cost.mean) }
    }
}

/// Expected calibration error and Brier score of the viability of many cells; none of nothing.
pub fn viability_scores<'a>(cells: impl Iterator<Item = &'a Collected>) -> Option<[f64; 2]> {
    let pairs: Vec<(f32, f32)> = cells.flat_map(|cell| cell.viability.iter().copied()).collect();
    (!pairs.is_empty()).then(|| [scores::ece(&pairs), scores::brier(&pairs)])
}

/// Mean absolute error of the cost of transport of many cells; none of nothing.
pub fn cost_error<'a>(cells: impl Iterator<Item = &'a Collected>) -> Option<f64> {
    let pairs: Vec<(f32, f32)> = cells.flat_map(|cell| cell.cot.iter().copied()).collect();
    (!pairs.is_empty()).then(|| scores::mae(&pairs))
}

/// Mean and spread, the interval by the normal distribution: mean ± 1.96·s/√n.
fn spread(values: impl Iterator<Item = f32>) -> Option<Spread> {
    let values: Vec<f64> = values.map(f64::from).collect();
    let centre = mean(&values)?;
    let std = standard_deviation(&values).unwrap_or(0.0);
    let half = 1.959_964 * std / (values.len() as f64).sqrt();
    Some(Spread { n: values.len(), mean: centre, std, low: centre - half, high: centre + half })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell() -> Collected {
        Collected {
            skill: "trot".into(),
            terrain: TerrainKind::StairsUp,
            size_m: 0.1,
            viability: vec![(0.9, 1.0), (0.7, 1.0), (0.2, 0.0), (0.8, 1.0)],
            cot: vec![(0.5, 0.4), (0.6, 0.8), (0.4, 0.6)],
        }
    }

    #[test]
    fn a_cell_knows_shares_of_all_rollouts_and_costs_of_those_that_arrived() {
        let cell = cell();
        let viable = cell.viable();
        assert_eq!((viable.n, viable.mean), (4, 0.75));
        assert!(viable.low < 0.75 && viable.high > 0.75);
        let cost = cell.cost().unwrap();
        assert_eq!(cost.n, 3);
        assert!((cost.mean - 0.6).abs() < 1e-6 && (cost.std - 0.2).abs() < 1e-6, "{cost:?}");
        assert!((cell.predicted_cost().unwrap().mean - 0.5).abs() < 1e-6);
        assert!((cell.worth().viability - 0.75).abs() < 1e-12);
    }

    #[test]
    fn a_cell_without_an_arrival_has_no_cost() {
        let cell = Collected { viability: vec![(0.1, 0.0)], cot: Vec::new(), ..cell() };
        assert_eq!((cell.cost(), cell.worth().cot), (None, None));
    }
}
