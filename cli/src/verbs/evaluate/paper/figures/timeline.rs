//! Predictions and the active skill over time, on the demo's staircases and over obstacles.

use vocaloco_sim::terrain::{CourseKind, OBSTACLES_RISE_M};

use super::super::claims::Evidence;
use super::super::findings::{Moment, Recorded};
use super::predicting::{place, skills_legend};
use crate::report::{Axis, Figure, Ink, Key, Mark, Panel, Style};

/// Predictions are drawn as means over this many ticks.
const TICKS: usize = 10;

/// Both staircases, one above the other.
pub(super) fn timeline(evidence: &Evidence<'_>) -> Figure {
    let plan = evidence.plan;
    let method = evidence.findings.runs.iter().filter(|run| run.selector == "vocaloco");
    let demo = method.filter(|run| run.size_m == plan.demo_size_m && run.course != CourseKind::Obstacles);
    Figure {
        id: "timeline".to_owned(),
        title: "Deployment: the demo's staircases over time".to_owned(),
        caption: format!(
            "{} steps of {:.0} cm at 0.6 m/s. {LINES} Seed {}.",
            plan.demo_steps,
            plan.demo_size_m * 100.0,
            plan.seed
        ),
        legend: legend(evidence, evidence.skills),
        panels: demo.flat_map(|run| panels(evidence, run, evidence.skills)).collect(),
        across: 2,
    }
}

/// The course of obstacles, with the skills added for it.
pub(super) fn obstacles(evidence: &Evidence<'_>) -> Option<Figure> {
    let (_, skills) = evidence.added?;
    let run = evidence.findings.runs.iter().find(|run| run.course == CourseKind::Obstacles)?;
    Some(Figure {
        id: "obstacles".to_owned(),
        title: "New skills: the course of obstacles over time".to_owned(),
        caption: format!(
            "{steps} steps of {rise:.0} cm up, {steps} down, a wall of {size:.0} cm and a gap of {size:.0} cm, 3 m of flat between each. \
             {LINES} Seed {seed}.",
            steps = evidence.plan.demo_steps,
            rise = OBSTACLES_RISE_M * 100.0,
            size = run.size_m * 100.0,
            seed = evidence.plan.seed
        ),
        legend: legend(evidence, skills),
        panels: panels(evidence, run, skills),
        across: 1,
    })
}

const LINES: &str = "Lines: predictions, means over 0.2 s. The strip at the bottom of the panels of viability is the skill that \
                     drives. Above, under “Watch it”, the same runs can be followed tick by tick.";

fn legend(evidence: &Evidence<'_>, skills: &[&str]) -> Vec<Key> {
    let mut legend = skills_legend(evidence, skills);
    legend.push(Key::Fill(Ink::Axis, "standing".to_owned()));
    legend
}

/// Viability with the skill that drives, and cost.
fn panels(evidence: &Evidence<'_>, run: &Recorded, skills: &[&str]) -> Vec<Panel> {
    let course = run.course.id().replace('_', " ");
    let end_s = run.ticks.last().map_or(1.0, |moment| moment.t_s);
    let time = || Axis::over("time (s)", 0.0, end_s.max(1.0), if end_s > 16.0 { 4.0 } else { 2.0 });
    let most = costs(run).fold(0.3, f64::max);
    let viability = lines(evidence, (run, skills), |(viability, _)| viability);
    vec![
        Panel {
            title: format!("{course}: predicted viability, active skill"),
            x: time(),
            y: Axis::share("viability"),
            marks: viability.into_iter().chain(band(evidence, run, skills)).collect(),
        },
        Panel {
            title: format!("{course}: predicted cost of transport"),
            x: time(),
            y: Axis::from_zero("CoT (–)", most),
            marks: lines(evidence, (run, skills), |(_, cot)| cot),
        },
    ]
}

fn lines(
    evidence: &Evidence<'_>,
    (run, skills): (&Recorded, &[&str]),
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
    skills.iter().enumerate().map(line).collect()
}

fn costs(run: &Recorded) -> impl Iterator<Item = f64> {
    run.ticks.iter().flat_map(|moment| moment.predictions.iter().filter_map(|(_, cot)| cot.map(f64::from)))
}

/// Who drives, as a strip along the time axis.
fn band(evidence: &Evidence<'_>, run: &Recorded, skills: &[&str]) -> Vec<Mark> {
    let mut marks = Vec::new();
    for moments in run.ticks.chunk_by(|a, b| a.active == b.active) {
        let (Some(first), Some(last)) = (moments.first(), moments.last()) else { continue };
        let known = skills.iter().any(|skill| *skill == first.active);
        let ink = if known { Ink::Series(place(evidence, &first.active)) } else { Ink::Axis };
        marks.push(Mark::Bar { x: [first.t_s, last.t_s + 0.02], y: [0.0, 0.06], ink });
    }
    marks
}
