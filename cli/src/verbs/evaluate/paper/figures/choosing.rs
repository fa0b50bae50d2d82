//! Figures of success and energy: who chooses, and what comes of it.

use vocaloco_sim::{course::SuccessRow, terrain::CourseKind};

use super::super::claims::Evidence;
use super::super::findings::{PROMISED, STAIRS, WITHOUT_COST};
use super::{cm, heights};
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

pub(super) fn outcome_legend() -> Vec<Key> {
    let key = |ink, text: &str| Key::Fill(ink, text.to_owned());
    vec![
        key(Ink::Reached, "reached"),
        key(Ink::Stopped, "stop activated"),
        key(Ink::Stuck, "stuck"),
        key(Ink::Crashed, "crashed"),
    ]
}

/// One bar of shares that add up to 1.
pub(super) fn stacked(row: &SuccessRow, x: [f64; 2]) -> Vec<Mark> {
    let mut from = 0.0;
    let bar = |(ink, share): (Ink, f64)| {
        let y = [from, from + share];
        from = y[1];
        Mark::Bar { x, y, ink }
    };
    outcomes(row).into_iter().map(bar).collect()
}

pub(super) fn words(course: CourseKind) -> &'static str {
    match course {
        CourseKind::StairsUp => "stairs up",
        CourseKind::StairsDown => "stairs down",
        CourseKind::Mixed => "up and down",
        CourseKind::Obstacles => "obstacles",
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
                PROMISED => format!("VOCALoco, α = 0.01, n = {}", evidence.plan.promised_rollouts),
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
