//! What CARD.md says of one model: where it came from, what it scores, what it is not good for.

use vocaloco_sim::scores;

use super::super::data::DataSet;
use super::super::fit::Fitted;
use super::super::sgd::Head;
use super::{Args, Report};
use crate::card;

/// The section of one model, without its heading.
pub(super) fn section(args: &Args, set: &DataSet, head: Head, fitted: &Fitted, report: &Report) -> String {
    let number = |value: Option<f64>| value.map_or("not defined".to_owned(), |value| format!("{value:.4}"));
    let mut rows = vec![
        ("file", format!("sha256 `{}`", report.sha256)),
        ("made by", format!("`{}`", args.command(report.kind))),
        ("data", format!("{} rows trained on or held out, sha256 `{}`", report.n, report.data_sha256)),
        ("collected by", set.collected_by.clone()),
        ("left out", set.left_out_because(head)),
        ("terrain, sizes in m (slopes: rise per metre)", set.terrain_ranges()),
        ("held out", format!("{} rows, chosen by row number, never trained on", report.held_out)),
        ("best epoch", format!("{} of {}", report.best_epoch, args.epochs)),
        ("training loss (MSE)", format!("{:.5}", fitted.best.training)),
        ("held-out loss (MSE)", format!("{:.5}", fitted.best.validation)),
    ];
    let (histogram, limits) = match head {
        Head::Sigmoid => {
            rows.push(("Brier score, single rollouts", number(report.brier)));
            rows.push((
                "of which label noise",
                number(Some(scores::brier(&fitted.held_out) - fitted.best.validation)),
            ));
            rows.push(("expected calibration error, 15 bins", number(report.ece)));
            rows.push(("AUC", number(report.auc)));
            (card::viability_histogram(set.labels()), VIABILITY_LIMITS)
        }
        Head::Linear => {
            rows.push(("mean absolute error", number(report.mae)));
            let labels: Vec<f32> = set.labels().collect();
            let mean = labels.iter().map(|l| f64::from(*l)).sum::<f64>() / labels.len() as f64;
            rows.push(("as a share of the mean", number(report.mae.map(|mae| mae / mean))));
            rows.push(("R²", number(report.r2)));
            (card::cost_histogram(&labels), COT_LIMITS)
        }
    };
    format!("{}\nLabels:\n\n{histogram}\nKnown limits:\n{EPOCH_LIMIT}{limits}", card::facts(&rows))
}

const EPOCH_LIMIT: &str = "\
- The epoch was chosen on the held-out rows, by their loss, so the scores above flatter.
";

const VIABILITY_LIMITS: &str = "\
- Scores are of rows held out of the same data set; `evaluate calibration` measures on fresh terrain.
- It knows the terrain kinds and sizes above and nothing else; no check yet tells it that a field is
  unlike all of them.
- It expects the field's ±10 cm noise, which hides steps of a few centimetres.
- The label is of one command, 0.6 m/s straight ahead, over 1.5 m in 4 s.
";

const COT_LIMITS: &str = "\
- Fitted to rollouts that reached the horizon: where the skill fails it says nothing, and is not asked.
- Its answer is not bounded; one that is not positive is refused at run time.
- It is the positive work of one rollout of 0.6 m/s over 1.5 m, the first 0.5 s left out.
";
