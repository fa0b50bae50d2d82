//! Figures of the ablations: what the parts of the method do.

use std::collections::BTreeMap;

use vocaloco_sim::{
    course::SuccessRow,
    occlusion::{DROP_M, Occlusion},
    terrain::CourseKind,
};

use super::super::claims::Evidence;
use super::super::findings::STAIRS;
use super::choosing::{outcome_legend, stacked, words};
use super::{HEIGHT, cm, heights};
use crate::report::{Axis, Figure, Ink, Key, Mark, Marker, Panel, Style};

/// A bar of outcomes for each variant.
fn outcomes(course: CourseKind, x: Axis, rows: impl Iterator<Item = SuccessRow>) -> Panel {
    let marks = rows.enumerate().flat_map(|(at, row)| stacked(&row, [at as f64 - 0.35, at as f64 + 0.35]));
    Panel {
        title: format!("{}: outcomes", words(course)),
        x,
        y: Axis::share("share of rollouts"),
        marks: marks.collect(),
    }
}

/// Sizes in words, for a caption.
fn sizes(sizes_m: &[f32]) -> String {
    let sizes: Vec<String> = sizes_m.iter().map(|size| cm(*size).to_string()).collect();
    sizes.join(", ")
}

/// Switches and outcomes by window.
pub(super) fn window(evidence: &Evidence<'_>) -> Figure {
    let windows = &evidence.plan.windows;
    let names: Vec<String> = windows.iter().map(ToString::to_string).collect();
    let mut panels = Vec::new();
    for course in STAIRS {
        let of = |window: usize| -> Vec<&SuccessRow> {
            let rows = evidence.findings.windows.iter();
            rows.filter(|(of, row)| *of == window && row.course == course).map(|(_, row)| row).collect()
        };
        let mean = |window: usize, value: fn(&SuccessRow) -> f64| {
            let rows = of(window);
            rows.iter().map(|row| value(row)).sum::<f64>() / rows.len().max(1) as f64
        };
        let switches: Vec<[f64; 2]> = windows
            .iter()
            .enumerate()
            .map(|(at, window)| [at as f64, mean(*window, |row| row.switches_mean)])
            .collect();
        let most = switches.iter().map(|point| point[1]).fold(1.0, f64::max);
        panels.push(Panel {
            title: format!("{}: changes of the active skill", words(course)),
            x: Axis::names("window (ticks of 20 ms)", &names),
            y: Axis::from_zero("changes a run", most),
            marks: vec![Mark::Line { points: switches, style: Style::series(0) }],
        });
        let bars = windows.iter().map(|window| mean_row(&of(*window)));
        panels.push(outcomes(course, Axis::names("window (ticks of 20 ms)", &names), bars));
    }
    Figure {
        id: "window".to_owned(),
        title: "Ablation: length of the window".to_owned(),
        caption: format!(
            "Means over steps of {} cm; the stop window has the same length. n = {} a window, height and course, seed {}.",
            sizes(&evidence.plan.window_sizes_m),
            evidence.plan.ablation_rollouts,
            evidence.plan.seed
        ),
        legend: outcome_legend(),
        panels,
        across: 2,
    }
}

/// Outcomes by the horizon over which viability and cost are collected.
pub(super) fn horizon(evidence: &Evidence<'_>) -> Figure {
    let plan = evidence.plan;
    let names: Vec<String> = plan.horizons_m.iter().map(ToString::to_string).collect();
    let mut panels = Vec::new();
    for course in STAIRS {
        let bar = |horizon_m: &f32| {
            let rows = evidence.findings.horizons.iter();
            let rows: Vec<&SuccessRow> = rows
                .filter(|(of, row)| of == horizon_m && row.course == course)
                .map(|(_, row)| row)
                .collect();
            mean_row(&rows)
        };
        let bars = plan.horizons_m.iter().map(bar);
        panels.push(outcomes(course, Axis::names("horizon (m)", &names), bars));
    }
    Figure {
        id: "horizon".to_owned(),
        title: "Ablation: horizon".to_owned(),
        caption: format!(
            "The oracle, fed with viability and cost collected over each horizon (time limit in proportion, n = {} a skill, terrain \
             and height): no predictor is trained for it, so what differs is the horizon alone. Means over steps of {} cm. n = {} a \
             horizon, height and course, seed {}.",
            plan.horizon_samples,
            sizes(&plan.horizon_sizes_m),
            plan.ablation_rollouts,
            plan.seed
        ),
        legend: outcome_legend(),
        panels,
        across: 2,
    }
}

/// The shares of several rows, each row counting as much.
fn mean_row(rows: &[&SuccessRow]) -> SuccessRow {
    let mean = |share: fn(&SuccessRow) -> f64| {
        rows.iter().map(|row| share(row)).sum::<f64>() / rows.len().max(1) as f64
    };
    let shares =
        (mean(|row| row.reached), mean(|row| row.stopped), mean(|row| row.stuck), mean(|row| row.crashed));
    let mut row = rows.first().map_or_else(SuccessRow::default, |row| (*row).clone());
    (row.reached, row.stopped, row.stuck, row.crashed) = shares;
    row
}

/// Stops on safe terrain against crashes on unsafe terrain.
pub(super) fn threshold(evidence: &Evidence<'_>) -> Figure {
    let curve = evidence.threshold_curve();
    let names: Vec<String> = curve.iter().map(|point| point.threshold.to_string()).collect();
    let series = |value: fn(&super::super::claims::ThresholdPoint) -> f64, ink, dash, marker| Mark::Line {
        points: curve.iter().enumerate().map(|(at, point)| [at as f64, value(point)]).collect(),
        style: Style { ink, dash: Some(dash), marker },
    };
    let style = |ink, dash, marker| Style { ink, dash: Some(dash), marker };
    Figure {
        id: "threshold".to_owned(),
        title: "Ablation: thresholds".to_owned(),
        caption: format!(
            "One threshold for all skills. Safe: some skill alone reaches 95 % of the course; unsafe: none reaches half. \
             Steps of {} cm, up and down. n = {} a threshold, height and course, seed {}.",
            sizes(&evidence.plan.threshold_sizes_m),
            evidence.plan.ablation_rollouts,
            evidence.plan.seed
        ),
        legend: vec![
            Key::Series(style(Ink::Reached, 0, Marker::Circle), "reached, safe terrain".to_owned()),
            Key::Series(style(Ink::Text, 1, Marker::Square), "stopped, safe terrain".to_owned()),
            Key::Series(style(Ink::Crashed, 2, Marker::Triangle), "crashed, unsafe terrain".to_owned()),
        ],
        panels: vec![Panel {
            title: String::new(),
            x: Axis::names("viability threshold (probability)", &names),
            y: Axis::share("share of rollouts"),
            marks: vec![
                series(|point| point.reached, Ink::Reached, 0, Marker::Circle),
                series(|point| point.false_stops, Ink::Text, 1, Marker::Square),
                series(|point| point.crashes, Ink::Crashed, 2, Marker::Triangle),
            ],
        }],
        across: 1,
    }
}

/// What cameras and filling do.
pub(super) fn fill(evidence: &Evidence<'_>) -> Figure {
    let sizes_m = &evidence.plan.camera_sizes_m;
    let sights = [Occlusion::None, Occlusion::Camera, Occlusion::CameraUnfilled];
    let mut panels = Vec::new();
    for course in STAIRS {
        let mut marks = Vec::new();
        for (group, size_m) in sizes_m.iter().enumerate() {
            for (place, sight) in sights.into_iter().enumerate() {
                let at = group as f64 * 3.6 + place as f64;
                let wanted = |row: &&SuccessRow| {
                    row.occlusion == sight && row.course == course && row.size_m == *size_m
                };
                if let Some(row) = evidence.findings.sights.iter().find(wanted) {
                    marks.extend(stacked(row, [at - 0.42, at + 0.42]));
                }
            }
        }
        // Three bars a height with a gap after them, so ticks stand under the middle one.
        let ticks = sizes_m
            .iter()
            .enumerate()
            .map(|(place, size_m)| (place as f64 * 3.6 + 1.0, format!("{}", cm(*size_m))))
            .collect();
        let high = sizes_m.len() as f64 * 3.6 - 1.0;
        panels.push(Panel {
            title: format!("{}: outcomes", words(course)),
            x: Axis { label: HEIGHT.to_owned(), low: -0.8, high, ticks },
            y: Axis::share("share of rollouts"),
            marks,
        });
    }
    let mut hidden: BTreeMap<CourseKind, Vec<[f64; 2]>> = BTreeMap::new();
    for row in evidence.findings.sights.iter().filter(|row| row.occlusion == Occlusion::Camera) {
        if let Some(unseen) = row.unseen {
            let share = unseen.drop_ticks as f64 / unseen.ticks.max(1) as f64;
            hidden.entry(row.course).or_default().push([cm(row.size_m), share]);
        }
    }
    let styles = [Style::series(3), Style { dash: Some(1), ..Style::series(4) }];
    let lines =
        hidden.values().zip(styles).map(|(points, style)| Mark::Line { points: points.clone(), style });
    panels.push(Panel {
        title: format!("ticks in which filling hides ≥ {:.0} cm", DROP_M * 100.0),
        x: heights(sizes_m),
        y: Axis::share("share of ticks"),
        marks: lines.collect(),
    });
    let mut legend = outcome_legend();
    let keys = hidden
        .keys()
        .zip(styles)
        .map(|(course, style)| Key::Series(style, format!("hidden, {}", words(*course))));
    legend.extend(keys);
    Figure {
        id: "fill".to_owned(),
        title: "Ablation: filling what the cameras do not see".to_owned(),
        caption: format!(
            "Three bars a height, from the left: everything seen; cameras, the rest filled from behind; cameras, the rest read as \
             level ground. Four depth cameras 30° down, rays over the terrain, a map that remembers. n = {} a bar, seed {}.",
            evidence.plan.ablation_rollouts, evidence.plan.seed
        ),
        legend,
        panels,
        across: 3,
    }
}
