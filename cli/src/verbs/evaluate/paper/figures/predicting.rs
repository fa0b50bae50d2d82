//! Figures of data and of predictions.

use vocaloco_sim::{
    collected::{Collected, Spread},
    terrain::TerrainKind,
};

use super::super::claims::Evidence;
use super::{cm, heights};
use crate::report::{Axis, Figure, Key, Mark, Panel, Style};

const STAIRS: [TerrainKind; 2] = [TerrainKind::StairsUp, TerrainKind::StairsDown];
/// Costs are compared where a skill is at least this viable.
const VIABLE: f64 = 0.9;

/// Viability and cost against step height, of the skill that is best at it.
pub(super) fn difficulty(evidence: &Evidence<'_>) -> Figure {
    let mut panels = Vec::new();
    for (skill, terrain) in
        [(&evidence.roles.down, TerrainKind::StairsDown), (&evidence.roles.up, TerrainKind::StairsUp)]
    {
        let cells = evidence.findings.cells_of(skill, terrain);
        let style = Style::series(place(evidence, skill));
        let way = words(terrain);
        panels.push(Panel {
            title: format!("{skill}, {way}"),
            x: heights(&evidence.plan.sizes_m),
            y: Axis::share("share that gets ahead"),
            marks: vec![
                Mark::Line { points: line(&cells, |cell| Some(cell.viable())), style: style.line() },
                Mark::Points { points: points(&cells, |cell| Some(cell.viable())), style: style.points() },
            ],
        });
        let costs = points(&cells, Collected::cost);
        panels.push(Panel {
            title: format!("{skill}, {way}"),
            x: heights(&evidence.plan.sizes_m),
            y: Axis::from_zero("CoT (–)", highest(&costs)),
            marks: vec![
                Mark::Line { points: line(&cells, Collected::cost), style: style.line() },
                Mark::Points { points: costs, style: style.points() },
            ],
        });
    }
    Figure {
        id: "difficulty".to_owned(),
        title: "Data by difficulty".to_owned(),
        caption: format!(
            "The best skill down and up stairs: share of rollouts that get 1.5 m ahead within 4 s without a base collision, \
             and mean cost of transport of those. Bars: 95 % intervals. {}",
            conditions(evidence)
        ),
        legend: Vec::new(),
        panels,
        across: 2,
    }
}

/// Predicted against collected viability.
pub(super) fn viability(evidence: &Evidence<'_>) -> Figure {
    let mut panels = Vec::new();
    for terrain in STAIRS {
        for skill in evidence.skills {
            let cells = evidence.findings.cells_of(skill, terrain);
            let style = Style::series(place(evidence, skill));
            panels.push(Panel {
                title: format!("{skill}, {}", words(terrain)),
                x: heights(&evidence.plan.sizes_m),
                y: Axis::share("viability"),
                marks: vec![
                    Mark::Band { points: band(&cells, Collected::predicted_viable), ink: style.ink },
                    Mark::Line {
                        points: line(&cells, Collected::predicted_viable),
                        style: Style { dash: Some(1), ..style.line() },
                    },
                    Mark::Points {
                        points: points(&cells, |cell| Some(cell.viable())),
                        style: style.points(),
                    },
                ],
            });
        }
    }
    Figure {
        id: "viability".to_owned(),
        title: "Predicted against collected viability".to_owned(),
        caption: format!(
            "Marks: share of rollouts that got ahead, with 95 % intervals. Dashed: mean prediction on the fields that the \
             very same poses see; shaded: one standard deviation. {}",
            conditions(evidence)
        ),
        legend: skills_legend(evidence, evidence.skills),
        panels,
        across: 3,
    }
}

/// Predicted against collected cost of transport.
pub(super) fn cost(evidence: &Evidence<'_>) -> Figure {
    let mut panels = Vec::new();
    for terrain in STAIRS {
        let (mut marks, mut most) = (Vec::new(), 0.0_f64);
        for skill in evidence.skills {
            let cells = evidence.findings.cells_of(skill, terrain);
            let viable: Vec<&Collected> =
                cells.into_iter().filter(|cell| cell.viable().mean >= VIABLE).collect();
            let style = Style::series(place(evidence, skill));
            let collected = points(&viable, Collected::cost);
            most = most.max(highest(&collected));
            marks.extend([
                Mark::Band { points: band(&viable, Collected::predicted_cost), ink: style.ink },
                Mark::Line {
                    points: line(&viable, Collected::predicted_cost),
                    style: Style { dash: Some(1), ..style.line() },
                },
                Mark::Points { points: collected, style: style.points() },
            ]);
        }
        panels.push(Panel {
            title: words(terrain).to_owned(),
            x: heights(&evidence.plan.sizes_m),
            y: Axis::from_zero("CoT (–)", most),
            marks,
        });
    }
    Figure {
        id: "cost".to_owned(),
        title: "Predicted against collected cost of transport".to_owned(),
        caption: format!(
            "Where a skill is at least 90 % viable. Marks: mean of the rollouts that got ahead, with 95 % intervals; dashed: \
             mean prediction on the same fields; shaded: one standard deviation. {}",
            conditions(evidence)
        ),
        legend: skills_legend(evidence, evidence.skills),
        panels,
        across: 2,
    }
}

fn conditions(evidence: &Evidence<'_>) -> String {
    format!(
        "n = {} fresh poses a skill and height, seed {}, reference plant, field noise ±10 cm.",
        evidence.plan.samples, evidence.plan.seed
    )
}

pub(super) fn skills_legend(evidence: &Evidence<'_>, skills: &[&str]) -> Vec<Key> {
    let key = |skill: &&str| Key::Series(Style::series(place(evidence, skill)).points(), (*skill).to_owned());
    skills.iter().map(key).collect()
}

/// The colour's place of a skill: that of the page's palette.
pub(super) fn place(evidence: &Evidence<'_>, skill: &str) -> usize {
    evidence.palette.iter().position(|known| known == skill).unwrap_or(evidence.palette.len())
}

fn words(terrain: TerrainKind) -> &'static str {
    match terrain {
        TerrainKind::StairsUp => "stairs up",
        TerrainKind::StairsDown => "stairs down",
        _ => terrain.id(),
    }
}

fn line(cells: &[&Collected], of: impl Fn(&Collected) -> Option<Spread>) -> Vec<[f64; 2]> {
    let point = |cell: &&Collected| [cm(cell.size_m), of(cell).map_or(f64::NAN, |spread| spread.mean)];
    cells.iter().map(point).collect()
}

fn points(cells: &[&Collected], of: impl Fn(&Collected) -> Option<Spread>) -> Vec<[f64; 4]> {
    let point = |cell: &&Collected| {
        let spread = of(cell)?;
        Some([cm(cell.size_m), spread.mean, spread.low, spread.high])
    };
    cells.iter().filter_map(point).collect()
}

fn band(cells: &[&Collected], of: impl Fn(&Collected) -> Option<Spread>) -> Vec<[f64; 3]> {
    let point = |cell: &&Collected| {
        let spread = of(cell)?;
        Some([cm(cell.size_m), (spread.mean - spread.std).max(0.0), spread.mean + spread.std])
    };
    cells.iter().filter_map(point).collect()
}

fn highest(points: &[[f64; 4]]) -> f64 {
    points.iter().map(|[_, mean, _, high]| mean + 0.5 * (high - mean)).fold(0.0, f64::max)
}
