//! `data score`: a model's predictions against the labels of a data set that it was not fitted to.

use std::path::Path;

use anyhow::{Context, anyhow, ensure};
use serde::Serialize;
use vocaloco_core::{
    heightfield::Field,
    predictor::{Predictor, Quantity},
};
use vocaloco_sim::{
    dataset::{self, Dataset, Kind},
    promise::{Promise, Risk, promise},
    scores,
};

use crate::{exit::Exit, output, verbs::Shared};

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    command: String,
    seed: u64,
    version: &'static str,
    model_sha256: String,
    kind: Kind,
    /// Rows for training.
    rows: usize,
    rollouts: u64,
    #[serde(flatten)]
    scores: Scores,
}

#[derive(Serialize)]
#[serde(untagged)]
enum Scores {
    Viability {
        brier: f64,
        /// What a predictor that knows every field's own viability would score.
        brier_best: Option<f64>,
        ece: f64,
        auc: Option<f64>,
        /// What one that knows every field's collected share would score on the very rollouts that make it up.
        auc_most: Option<f64>,
        #[serde(skip_serializing_if = "Vec::is_empty")]
        thresholds: Vec<Promise>,
    },
    Cot {
        mae: f64,
        r2: Option<f64>,
    },
}

/// What thresholds are computed for.
pub(super) struct Risks {
    pub(super) alpha: Vec<f64>,
    pub(super) required_viability: f32,
}

impl Risks {
    fn check(&self, kind: Kind) -> anyhow::Result<()> {
        let shares = self.alpha.iter().map(|alpha| ("alpha", *alpha));
        for (flag, share) in shares.chain([("required-viability", f64::from(self.required_viability))]) {
            ensure!(share > 0.0 && share < 1.0, "--{flag}: found {share}, wanted a share over 0 and under 1");
        }
        ensure!(
            self.alpha.is_empty() || kind == Kind::Viability,
            "--alpha: found a data set of cost, wanted one of viability"
        );
        Ok(())
    }

    fn promises(&self, pairs: &[(f32, f32)]) -> Vec<Promise> {
        let risk = |alpha: &f64| Risk { required_viability: self.required_viability, alpha: *alpha };
        self.alpha.iter().map(|alpha| promise(pairs, risk(alpha))).collect()
    }

    fn words(&self) -> String {
        if self.alpha.is_empty() {
            return String::new();
        }
        let alpha: Vec<String> = self.alpha.iter().map(f64::to_string).collect();
        format!(" --alpha {} --required-viability {}", alpha.join(","), self.required_viability)
    }
}

pub(super) fn run(folder: &Path, model: &Path, risks: &Risks, shared: Shared) -> anyhow::Result<Exit> {
    let report = scored(folder, model, risks)?;
    if shared.json {
        output::json(&report)?;
    } else {
        table(&report)?;
    }
    Ok(Exit::Fine)
}

fn scored(folder: &Path, model: &Path, risks: &Risks) -> anyhow::Result<Report> {
    let data = dataset::read(folder)?;
    let kind = data.meta.kind;
    risks.check(kind)?;
    let quantity = match kind {
        Kind::Viability => Quantity::Viability,
        Kind::Cot => Quantity::Cot,
    };
    let mut predictor = Predictor::load(model, quantity)?;
    let rows: Vec<usize> = (0..data.len()).filter(|row| data.trainable[*row]).collect();
    ensure!(!rows.is_empty(), "{}: found no row for training, wanted 1 or more", folder.display());
    let pairs = rows.iter().map(|row| {
        let field = Field::from_slice(&data.fields[*row])
            .ok_or_else(|| anyhow!("row {}: found a height that is no number", data.rows[*row]))?;
        let predicted = predictor.predict(&field).with_context(|| format!("row {}", data.rows[*row]))?;
        Ok((predicted, data.labels[*row]))
    });
    let pairs = pairs.collect::<anyhow::Result<Vec<(f32, f32)>>>()?;
    Ok(Report {
        command: format!(
            "vocaloco data score {} --model {}{}",
            folder.display(),
            model.display(),
            risks.words()
        ),
        seed: data.meta.config.seed,
        version: env!("CARGO_PKG_VERSION"),
        model_sha256: predictor.sha256().to_owned(),
        kind,
        rows: rows.len(),
        rollouts: rows.iter().map(|row| u64::from(data.rollouts[*row])).sum(),
        scores: match kind {
            Kind::Viability => Scores::Viability {
                brier: scores::brier(&pairs),
                brier_best: brier_best(&data, &rows),
                ece: scores::ece(&pairs),
                auc: scores::auc(&pairs),
                auc_most: auc_most(&data, &rows),
                thresholds: risks.promises(&pairs),
            },
            Kind::Cot => Scores::Cot { mae: scores::mae(&pairs), r2: scores::r2(&pairs) },
        },
    })
}

/// The Brier score that the chance in the rollouts leaves to the best predictor: the mean variance of an
/// outcome, from rows of two rollouts and more.
///
/// ```text
/// mean of l·(1 − l)·n/(n − 1)
/// ```
fn brier_best(data: &Dataset, rows: &[usize]) -> Option<f64> {
    let variances = rows.iter().filter(|row| data.rollouts[**row] > 1).map(|row| {
        let (label, n) = (f64::from(data.labels[*row]), f64::from(data.rollouts[*row]));
        label * (1.0 - label) * n / (n - 1.0)
    });
    let (count, sum) = variances.fold((0_usize, 0.0), |(count, sum), variance| (count + 1, sum + variance));
    (count > 0).then(|| sum / count as f64)
}

/// The area under the curve that the best predictor stays below, from rows of two rollouts and more. A
/// row's share of few rollouts lies further out than its viability, so that it is somewhat too high.
fn auc_most(data: &Dataset, rows: &[usize]) -> Option<f64> {
    let several = rows.iter().filter(|row| data.rollouts[**row] > 1);
    let known: Vec<(f32, f32)> = several.map(|row| (data.labels[*row], data.labels[*row])).collect();
    scores::auc(&known)
}

fn table(report: &Report) -> anyhow::Result<()> {
    let or_dash = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.4}"));
    let scores = match &report.scores {
        Scores::Viability { brier, brier_best, ece, auc, auc_most, .. } => format!(
            "Brier {brier:.4} (best possible {}), ECE {ece:.4}, AUC {} (at most {})",
            or_dash(*brier_best),
            or_dash(*auc),
            or_dash(*auc_most)
        ),
        Scores::Cot { mae, r2 } => format!("MAE {mae:.4}, R² {}", or_dash(*r2)),
    };
    output::line(&format!("{} rows, {} rollouts: {scores}", report.rows, report.rollouts))?;
    if let Scores::Viability { thresholds, .. } = &report.scores {
        for threshold in thresholds {
            output::line(&threshold.to_string())?;
        }
    }
    output::line(&report.command)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_the_slice(kind: &str, alpha: &[f64]) -> anyhow::Result<Report> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let (data, model) =
            (root.join("tests/data/walk").join(kind), root.join(format!("skills/walk/{kind}.onnx")));
        scored(&data, &model, &Risks { alpha: alpha.to_vec(), required_viability: 0.5 })
    }

    #[test]
    fn a_shipped_model_is_scored_below_what_chance_allows() {
        let report = of_the_slice("viability", &[0.1, 0.3]).unwrap();
        let Scores::Viability { brier, brier_best, auc, auc_most, thresholds, .. } = &report.scores else {
            panic!("viability")
        };
        assert!((report.rows, report.rollouts) == (256, 2560), "{} {}", report.rows, report.rollouts);
        assert!(brier_best.unwrap() < *brier && *brier < 0.1, "{brier_best:?} {brier}");
        assert!(auc.unwrap() < auc_most.unwrap() && auc.unwrap() > 0.9, "{auc:?} {auc_most:?}");
        let [strict, loose] = thresholds.as_slice() else { panic!("{thresholds:?}") };
        assert!(loose.threshold.unwrap() <= strict.threshold.unwrap(), "{thresholds:?}");
        for promise in thresholds {
            assert!(promise.upper_bound.unwrap() <= promise.risk.alpha, "{promise:?}");
        }
        let again = "--alpha 0.1,0.3 --required-viability 0.5";
        assert!(report.command.contains(again), "{}", report.command);
    }

    #[test]
    fn a_cost_has_no_thresholds_and_a_share_lies_between_0_and_1() {
        assert!(of_the_slice("cot", &[]).is_ok());
        for (kind, alpha) in [("cot", 0.05), ("viability", 0.0), ("viability", f64::NAN)] {
            let error = of_the_slice(kind, &[alpha]).err().expect("refused").to_string();
            assert!(error.contains("--alpha") && error.contains("wanted"), "{error}");
        }
    }
}
