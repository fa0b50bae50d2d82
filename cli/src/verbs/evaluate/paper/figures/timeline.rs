//! Predictions and the active skill over time, on the demo's staircases.

use super::super::claims::Evidence;
use super::super::findings::{Moment, Recorded};
use super::predicting::{place, skills_legend};
use crate::report::{Axis, Figure, Ink, Key, Mark, Panel, Style};

/// Predictions are drawn as means over this many ticks.
const TICKS: usize = 10;

/// Both staircases, one above the other.
pub(super) fn timeline(evidence: &Evidence<'_>) -> Figure {
    let mut panels = Vec::new();
    let demo = evidence
        .findings
        .runs
        .iter()
        .filter(|run| run.selector == "vocaloco" && run.size_m == evidence.plan.demo_size_m);
    for run in demo {
        let course = run.course.id().replace('_', " ");
        let end_s = run.ticks.last().map_or(1.0, |moment| moment.t_s);
        let time = || Axis::over("time (s)", 0.0, end_s.max(1.0), if end_s > 16.0 { 4.0 } else { 2.0 });
        let most = costs(run).fold(0.3, f64::max);
        panels.push(Panel {
            title: format!("{course}: predicted viability, active skill"),
            x: time(),
            y: Axis::share("viability"),
            marks: lines(evidence, run, |(viability, _)| viability)
                .into_iter()
                .chain(band(evidence, run))
                .collect(),
        });
        panels.push(Panel {
            title: format!("{course}: predicted cost of transport"),
            x: time(),
            y: Axis::from_zero("CoT (–)", most),
            marks: lines(evidence, run, |(_, cot)| cot),
        });
    }
    let mut legend = skills_legend(evidence);
    legend.push(Key::Fill(Ink::Axis, "standing".to_owned()));
    Figure {
        id: "timeline".to_owned(),
        title: "Deployment: the demo's staircases over time".to_owned(),
        caption: format!(
            "{} steps of {:.0} cm at 0.6 m/s. Lines: predictions, means over 0.2 s. The strip at the bottom of the left panels is the \
             skill that drives. Below, the same runs can be watched tick by tick. Seed {}.",
            evidence.plan.demo_steps,
            evidence.plan.demo_size_m * 100.0,
            evidence.plan.seed
        ),
        legend,
        panels,
        across: 2,
    }
}

fn lines(
    evidence: &Evidence<'_>,
    run: &Recorded,
    of: impl Fn((Option<f32>, Option<f32>)) -> Option<f32> + Copy,
) -> Vec<Mark> {
    let line = |(index, skill): (usize, &&str)| {
        let point = |moments: &[Moment]| {
            let values: Vec<f64> = moments
                .iter()
                .filter_map(|moment| moment.predictions.get(index).copied().and_then(of).map(f64::from))
                .collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            [moments[moments.len() / 2].t_s, mean]
        };
        let place = place(evidence, skill);
        Mark::Line {
            points: run.ticks.chunks(TICKS).map(point).collect(),
            style: Style::series(place).line(),
        }
    };
    evidence.skills.iter().enumerate().map(line).collect()
}

fn costs(run: &Recorded) -> impl Iterator<Item = f64> {
    run.ticks.iter().flat_map(|moment| moment.predictions.iter().filter_map(|(_, cot)| cot.map(f64::from)))
}

/// Who drives, as a strip along the time axis.
fn band(evidence: &Evidence<'_>, run: &Recorded) -> Vec<Mark> {
    let mut marks = Vec::new();
    for moments in run.ticks.chunk_by(|a, b| a.active == b.active) {
        let (Some(first), Some(last)) = (moments.first(), moments.last()) else { continue };
        let known = evidence.skills.iter().any(|skill| *skill == first.active);
        let ink = if known { Ink::Series(place(evidence, &first.active)) } else { Ink::Axis };
        marks.push(Mark::Bar { x: [first.t_s, last.t_s + 0.02], y: [0.0, 0.06], ink });
    }
    marks
}
