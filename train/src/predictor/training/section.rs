//! What CARD.md says of one model: where it came from, what it scores, what it is not good for.

use std::fmt::Write;

use super::super::data::DataSet;
use super::super::fit::Fitted;
use super::super::known::Flags;
use super::super::sgd::Head;
use super::{Args, Report};
use crate::card;
use vocaloco_sim::promise::Promise;

/// The section of one model, without its heading.
pub(super) fn section(
    args: &Args,
    (set, other): (&DataSet, Option<&DataSet>),
    head: Head,
    fitted: &Fitted,
    report: &Report,
) -> String {
    let number = |value: Option<f64>| value.map_or("not defined".to_owned(), |value| format!("{value:.4}"));
    let mut rows = vec![
        ("file", format!("sha256 `{}`", report.sha256)),
        ("made by", format!("`{}`", args.command(report.kind))),
        ("data", format!("{} rows trained on or held out, sha256 `{}`", report.n, report.data_sha256)),
        ("collected by", set.collected_by.clone()),
        ("left out", set.left_out_because(head)),
        ("terrain, sizes in m (slopes: rise per metre)", set.terrain_ranges()),
        (
            "held out",
            format!("{} rows, by row number, never trained on; their loss chose the epoch", report.held_out),
        ),
        (
            "kept back",
            format!(
                "{} rows, by row number, without any part in the fit: the scores are theirs",
                report.kept_back
            ),
        ),
        ("best epoch", format!("{} of {}", report.best_epoch, args.epochs)),
        ("training loss (MSE)", format!("{:.5}", fitted.best.training)),
        ("held-out loss (MSE)", format!("{:.5}", fitted.best.validation)),
        ("kept-back loss (MSE)", format!("{:.5}", report.kept_back_mse)),
    ];
    let mut thresholds = String::new();
    let (histogram, limits) = match head {
        Head::Sigmoid => {
            rows.push(("Brier score, single rollouts", number(report.brier)));
            let noise = report.brier.map(|brier| brier - report.kept_back_mse).filter(|_| set.repeats > 1);
            rows.push((
                "of which label noise",
                noise
                    .map_or_else(|| "not known of one rollout a row".to_owned(), |noise| number(Some(noise))),
            ));
            rows.push(("expected calibration error, 15 bins", number(report.ece)));
            rows.push(("AUC", number(report.auc)));
            if let Some(Flags { n, flagged }) = report.flags {
                rows.push(("kept-back rows flagged as terrain never seen", format!("{flagged} of {n}")));
            }
            thresholds = promises(&report.promises, other);
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
    format!("{}\n{thresholds}Labels:\n\n{histogram}\nKnown limits:\n{limits}", card::facts(&rows))
}

/// The thresholds that promise something, and what exactly they promise.
fn promises(promises: &[Promise], other: Option<&DataSet>) -> String {
    let Some(first) = promises.first() else { return String::new() };
    let rows = other.map_or("the rows kept back".to_owned(), |other| {
        format!(
            "a data set of its own, {} rows, sha256 `{}`, {}",
            other.samples.len(),
            other.sha256,
            other.collected_by
        )
    });
    let mut text = format!(
        "Thresholds with a promise: of terrain on which fewer than {:.0} % of the rollouts succeed, drawn as \
         its rows, at most the share α is predicted at or above the threshold, with 95 % \
         confidence for each α (fixed-sequence testing, exact binomial bound; computed from {rows}):\n\n\
         | α | threshold | unsafe rows | let through | upper bound | other terrain refused |\n\
         |---|---|---|---|---|---|\n",
        100.0 * first.risk.required_viability
    );
    let share = |share: Option<f64>| share.map_or("–".to_owned(), |share| format!("{share:.4}"));
    for one in promises {
        let threshold = one.threshold.map_or("none: too few unsafe rows".to_owned(), |t| format!("{t:.3}"));
        let _ = writeln!(
            text,
            "| {} | {threshold} | {} | {} | {} | {} |",
            one.risk.alpha,
            one.unsafe_rows,
            one.let_through,
            share(one.upper_bound),
            share(one.safe_refused)
        );
    }
    text.push('\n');
    text
}

const VIABILITY_LIMITS: &str = "\
- Scores are of rows kept out of the same data set; `evaluate calibration` measures on fresh terrain.
- It knows the terrain kinds and sizes above and nothing else. The check in the file flags a field unlike
  all of them, but not every one: `evaluate novelty` says what it finds.
- It expects the field's ±10 cm noise, which hides steps of a few centimetres.
- The label is of one command straight ahead, over the horizon and in the time of the configuration above.
";

const COT_LIMITS: &str = "\
- Fitted to rollouts that reached the horizon: where the skill fails it says nothing, and is not asked.
- Its answer is not bounded; one that is not positive is refused at run time.
- It is the positive work of one rollout over the horizon of the configuration above, the first 0.5 s left out.
";
