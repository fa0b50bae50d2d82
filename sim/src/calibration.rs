//! Predicted against collected (docs/method.md): a skill is rolled out once from each of many
//! fresh poses, and its predictors are asked about the very fields that those poses see.

use serde::Serialize;
use thiserror::Error;
use vocaloco_core::predictor::{ModelError, Predictor};

use crate::collect::CollectError;
use crate::collected::Collected;
use crate::dataset::Kind;
use crate::scores;
use crate::terrain::TerrainKind;

/// Share of viable rollouts from which a size's cost of transport counts in the summary.
pub const COT_VIABILITY: f64 = 0.9;

/// Bins of the reliability diagram.
const RELIABILITY_BINS: usize = 10;

/// One size of one terrain.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Skill.
    pub skill: String,
    /// What is compared; cost of transport only where the horizon was reached.
    pub kind: Kind,
    /// Terrain.
    pub terrain: TerrainKind,
    /// Its size, m.
    pub size_m: f32,
    /// Rollouts compared.
    pub n: usize,
    /// Mean over the rollouts; of viability, the share that reached the horizon.
    pub collected_mean: Option<f64>,
    /// Standard deviation over the rollouts.
    pub collected_std: Option<f64>,
    /// Mean prediction.
    pub predicted_mean: Option<f64>,
    /// Standard deviation of the predictions.
    pub predicted_std: Option<f64>,
}

/// All sizes together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Skill.
    pub skill: String,
    /// What is compared.
    pub kind: Kind,
    /// Rollouts compared; cost of transport from sizes of which [`COT_VIABILITY`] are viable.
    pub n: usize,
    /// Of viability: mean squared difference from the outcome.
    pub brier: Option<f64>,
    /// Of viability: expected calibration error, [`scores::ECE_BINS`] bins.
    pub ece: Option<f64>,
    /// Of viability: area under the ROC curve.
    pub auc: Option<f64>,
    /// Of cost of transport: mean absolute error.
    pub mae: Option<f64>,
    /// Of cost of transport: share of the variance explained.
    pub r2: Option<f64>,
    /// Of viability: predicted against collected, by bins of the predicted.
    pub reliability: Vec<scores::Bin>,
}

/// What was predicted and what was collected of one skill, a cell a terrain and size.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Calibration {
    skill: String,
    cells: Vec<Collected>,
}

/// The two networks of a skill.
#[derive(Debug)]
pub struct Predictors {
    /// Viability.
    pub viability: Predictor,
    /// Cost of transport.
    pub cot: Predictor,
}

/// Why nothing could be compared.
#[derive(Debug, Error)]
pub enum CalibrationError {
    /// The rollouts failed.
    #[error(transparent)]
    Collect(#[from] CollectError),
    /// A network failed.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl Calibration {
    /// Of these cells.
    pub fn of(skill: &str, cells: Vec<Collected>) -> Self {
        Self { skill: skill.to_owned(), cells }
    }

    /// A row a kind and size: all of viability, then all of cost of transport.
    pub fn rows(&self) -> Vec<Row> {
        let viability = self.cells.iter().map(|cell| self.row(Kind::Viability, cell, &cell.viability));
        let cot = self.cells.iter().map(|cell| self.row(Kind::Cot, cell, &cell.cot));
        viability.chain(cot).collect()
    }

    /// The scores over all sizes, of viability and of cost of transport.
    pub fn summaries(&self) -> [Summary; 2] {
        let viability: Vec<_> = self.cells.iter().flat_map(|cell| cell.viability.iter().copied()).collect();
        let viable = self.cells.iter().filter(|cell| share(&cell.viability) >= COT_VIABILITY);
        let cot: Vec<_> = viable.flat_map(|cell| cell.cot.iter().copied()).collect();
        let defined =
            |pairs: &[(f32, f32)], score: fn(&[(f32, f32)]) -> f64| (!pairs.is_empty()).then(|| score(pairs));
        let summary = |kind: Kind, n: usize| Summary {
            skill: self.skill.clone(),
            kind,
            n,
            brier: None,
            ece: None,
            auc: None,
            mae: None,
            r2: None,
            reliability: Vec::new(),
        };
        [
            Summary {
                brier: defined(&viability, scores::brier),
                ece: defined(&viability, scores::ece),
                auc: scores::auc(&viability),
                reliability: scores::reliability(&viability, RELIABILITY_BINS),
                ..summary(Kind::Viability, viability.len())
            },
            Summary {
                mae: defined(&cot, scores::mae),
                r2: scores::r2(&cot),
                ..summary(Kind::Cot, cot.len())
            },
        ]
    }

    fn row(&self, kind: Kind, cell: &Collected, pairs: &[(f32, f32)]) -> Row {
        let (predicted_mean, predicted_std) = spread(pairs, |(predicted, _)| predicted);
        let (collected_mean, collected_std) = spread(pairs, |(_, collected)| collected);
        Row {
            skill: self.skill.clone(),
            kind,
            terrain: cell.terrain,
            size_m: cell.size_m,
            n: pairs.len(),
            collected_mean,
            collected_std,
            predicted_mean,
            predicted_std,
        }
    }
}

/// Collected mean; 0 of nothing.
fn share(pairs: &[(f32, f32)]) -> f64 {
    spread(pairs, |(_, collected)| collected).0.unwrap_or(0.0)
}

fn spread(pairs: &[(f32, f32)], part: fn((f32, f32)) -> f32) -> (Option<f64>, Option<f64>) {
    if pairs.is_empty() {
        return (None, None);
    }
    let (mean, deviation) = scores::mean_and_deviation(pairs.iter().map(|pair| f64::from(part(*pair))));
    (Some(mean), Some(deviation))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn calibration() -> Calibration {
        let size = |size_m: f32, viability: &[(f32, f32)], cot: &[(f32, f32)]| Collected {
            skill: "ascend".into(),
            terrain: TerrainKind::StairsUp,
            size_m,
            viability: viability.to_vec(),
            cot: cot.to_vec(),
        };
        let low = size(0.1, &[(0.9, 1.0), (0.8, 1.0)], &[(0.5, 0.4), (0.7, 0.8)]);
        let high = size(0.3, &[(0.2, 0.0), (0.1, 0.0), (0.4, 1.0), (0.3, 0.0)], &[(9.0, 1.0)]);
        Calibration { skill: "ascend".into(), cells: vec![low, high] }
    }

    #[test]
    fn a_row_holds_means_and_spreads_of_both_sides() {
        let rows = calibration().rows();
        assert_eq!(rows.len(), 4);
        let high = &rows[1];
        assert_eq!((high.kind, high.size_m, high.n), (Kind::Viability, 0.3, 4));
        assert!((high.collected_mean.unwrap() - 0.25).abs() < 1e-6);
        assert!((high.predicted_mean.unwrap() - 0.25).abs() < 1e-6);
        assert!((high.collected_std.unwrap() - 0.1875_f64.sqrt()).abs() < 1e-6);
        assert_eq!((rows[2].kind, rows[2].n), (Kind::Cot, 2));
    }

    #[test]
    fn cost_counts_only_where_the_skill_is_viable() {
        let [viability, cot] = calibration().summaries();
        assert_eq!((viability.n, viability.auc), (6, Some(1.0)));
        assert!(viability.brier.is_some() && viability.mae.is_none());
        // The size with one success in four does not count, however wrong its prediction.
        assert_eq!(cot.n, 2);
        assert!((cot.mae.unwrap() - 0.1).abs() < 1e-6, "{cot:?}");
    }

    #[test]
    fn a_size_without_any_success_has_no_cost() {
        let mut calibration = calibration();
        calibration.cells[1].cot.clear();
        let row = &calibration.rows()[3];
        assert_eq!((row.n, row.collected_mean, row.predicted_mean), (0, None, None));
    }
}
