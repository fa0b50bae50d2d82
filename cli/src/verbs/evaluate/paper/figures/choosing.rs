//! Figures of success, energy, and of what the method's parts do.

use std::collections::BTreeMap;

use vocaloco_sim::{
    course::SuccessRow,
    occlusion::{DROP_M, Occlusion},
    terrain::CourseKind,
};

use super::super::claims::Evidence;
use super::super::findings::{STAIRS, WITHOUT_COST};
use super::{HEIGHT, cm, heights};
use crate::report::{Axis, Figure, Ink, Key, Mark, Marker, Panel, Style};

/// Outcomes from the bottom of a bar up.
fn outcomes(row: &SuccessRow) -> [(Ink, f64); 4] {
    [
        (Ink::Reached, row.reached),
        (Ink::Stopped, row.stopped),
        (Ink::Stuck, row.stuck),
        (Ink::Crashed, row.crashed),
    ]
}

fn outcome_legend() -> Vec<Key> {
    let key = |ink, text: &str| Key::Fill(ink, text.to_owned());
    vec![
        key(Ink::Reached, "reached"),
        key(Ink::Stopped, "stop activated"),
        key(Ink::Stuck, "stuck"),
        key(Ink::Crashed, "crashed"),
    ]
}

/// One bar of shares that add up to 1.
fn stacked(row: &SuccessRow, x: [f64; 2]) -> Vec<Mark> {
    let mut from = 0.0;
    let bar = |(ink, share): (Ink, f64)| {
        let y = [from, from + share];
        from = y[1];
        Mark::Bar { x, y, ink }
    };
    outcomes(row).into_iter().map(bar).collect()
}

fn words(course: CourseKind) -> &'static str {
    match course {
        CourseKind::StairsUp => "stairs up",
        CourseKind::StairsDown => "stairs down",
        CourseKind::Mixed => "up and down",
    }
}

fn shown(selector: &str) -> &str {
    match selector.split_once(':') {
        Some((_, skill)) => skill,
        None if selector == "vocaloco" => "VOCALoco",
        None => selector,
    }
}

/// One figure a staircase, one panel a selector.
pub(super) fn success(evidence: &Evidence<'_>) -> Vec<Figure> {
    let mut selectors: Vec<&str> = Vec::new();
    for row in &evidence.findings.success {
        if !selectors.contains(&row.selector.as_str()) {
            selectors.push(&row.selector);
        }
    }
    let sizes_m = &evidence.plan.sizes_m;
    let apart = sizes_m.windows(2).map(|pair| cm(pair[1]) - cm(pair[0])).fold(5.0, f64::min);
    let figure = |course: CourseKind| {
        let panel = |selector: &&str| Panel {
            title: match *selector {
                name if name == evidence.baseline_name() => format!("{} (baseline, alone)", shown(name)),
                "oracle" => "oracle (knows what was collected)".to_owned(),
                "vocaloco" => "VOCALoco".to_owned(),
                name => format!("{} alone", shown(name)),
            },
            x: heights(sizes_m),
            y: Axis::share("share of rollouts"),
            marks: {
                let bars = evidence.findings.rows(selector, course).into_iter().flat_map(|row| {
                    let middle = cm(row.size_m);
                    let mut marks = stacked(row, [middle - 0.4 * apart, middle + 0.4 * apart]);
                    let whisker = [middle, row.reached, row.reached_low, row.reached_high];
                    let style = Style { ink: Ink::Text, dash: None, marker: Marker::None };
                    marks.push(Mark::Points { points: vec![whisker], style });
                    marks
                });
                bars.collect()
            },
        };
        Figure {
            id: if course == CourseKind::StairsUp { "success_up" } else { "success_down" }.to_owned(),
            title: format!("Success rate, flat → {} → flat", words(course)),
            caption: format!(
                "{} steps a flight. n = {} rollouts a height and selector, seed {}; whiskers: 95 % interval (Wilson) of the share \
                 that reached. The same poses, masses and frictions for every selector.",
                evidence.plan.steps, evidence.plan.rollouts, evidence.plan.seed
            ),
            legend: outcome_legend(),
            panels: selectors.iter().map(panel).collect(),
            across: 3,
        }
    };
    STAIRS.into_iter().map(figure).collect()
}

/// Cost of transport over the course that mixes flat and stairs.
pub(super) fn energy(evidence: &Evidence<'_>) -> Figure {
    let panel = |size_m: &f32| {
        let rows: Vec<&SuccessRow> =
            evidence.findings.mixed.iter().filter(|row| row.size_m == *size_m).collect();
        let names: Vec<String> = (1..=rows.len()).map(|place| place.to_string()).collect();
        let mut marks = Vec::new();
        let mut most = 0.0_f64;
        for (place, row) in rows.iter().enumerate() {
            let x = place as f64;
            match row.cot_mean {
                Some(cot) => {
                    let arrived = (row.reached * row.n as f64).max(1.0);
                    let half = 1.96 * row.cot_std.unwrap_or(0.0) / arrived.sqrt();
                    most = most.max(cot + half);
                    let style = Style { ink: Ink::Text, dash: None, marker: Marker::None };
                    marks.push(Mark::Bar {
                        x: [x - 0.35, x + 0.35],
                        y: [0.0, cot],
                        ink: selector_ink(evidence, row),
                    });
                    marks.push(Mark::Points { points: vec![[x, cot, cot - half, cot + half]], style });
                }
                None => marks.push(Mark::Words { at: [x - 0.3, 0.0], text: "none".to_owned() }),
            }
        }
        Panel {
            title: format!("steps of {} cm", cm(*size_m)),
            x: Axis::names("selector, numbered as above", &names),
            y: Axis::from_zero("CoT (–)", most),
            marks,
        }
    };
    let first = evidence.plan.mixed_sizes_m.first();
    let of_first = evidence.findings.mixed.iter().filter(|row| Some(&row.size_m) == first);
    let legend = of_first.enumerate().map(|(place, row)| {
        let text = match row.selector.as_str() {
            WITHOUT_COST => "VOCALoco without the cost term".to_owned(),
            name => shown(name).to_owned(),
        };
        Key::Fill(selector_ink(evidence, row), format!("{}  {text}", place + 1))
    });
    Figure {
        id: "energy".to_owned(),
        title: "Energy over flat, stairs up, flat, stairs down, flat".to_owned(),
        caption: format!(
            "Mean cost of transport of the rollouts that reached the target, with 95 % intervals; {} steps a flight, 3 m flats. \
             “none”: no rollout reached it. Without the cost term the most viable skill wins. n = {} a selector and height, seed {}. \
             How many arrived is in tables/mixed.csv.",
            evidence.plan.steps, evidence.plan.rollouts, evidence.plan.seed
        ),
        legend: legend.collect(),
        panels: evidence.plan.mixed_sizes_m.iter().map(panel).collect(),
        across: 3,
    }
}

fn selector_ink(evidence: &Evidence<'_>, row: &SuccessRow) -> Ink {
    match row.selector.split_once(':') {
        Some((_, skill)) => Ink::Series(super::predicting::place(evidence, skill)),
        None if row.selector == WITHOUT_COST => Ink::Axis,
        None => Ink::Text,
    }
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
        let marks = windows.iter().enumerate().flat_map(|(at, window)| {
            let at = at as f64;
            stacked(&mean_row(&of(*window)), [at - 0.35, at + 0.35])
        });
        panels.push(Panel {
            title: format!("{}: outcomes", words(course)),
            x: Axis::names("window (ticks of 20 ms)", &names),
            y: Axis::share("share of rollouts"),
            marks: marks.collect(),
        });
    }
    let sizes: Vec<String> = evidence.plan.window_sizes_m.iter().map(|size| cm(*size).to_string()).collect();
    Figure {
        id: "window".to_owned(),
        title: "Ablation: length of the window".to_owned(),
        caption: format!(
            "Means over steps of {} cm; the stop window has the same length. n = {} a window, height and course, seed {}.",
            sizes.join(", "),
            evidence.plan.ablation_rollouts,
            evidence.plan.seed
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
    let sizes: Vec<String> =
        evidence.plan.threshold_sizes_m.iter().map(|size| cm(*size).to_string()).collect();
    Figure {
        id: "threshold".to_owned(),
        title: "Ablation: thresholds".to_owned(),
        caption: format!(
            "One threshold for all skills. Safe: some skill alone reaches 95 % of the course; unsafe: none reaches half. \
             Steps of {} cm, up and down. n = {} a threshold, height and course, seed {}.",
            sizes.join(", "),
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
