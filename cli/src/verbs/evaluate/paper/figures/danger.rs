//! Where the danger is: what each cell of the field does to each skill's viability, at the tick in which
//! the robot changed its mind.

use vocaloco_core::heightfield::{CELLS, Heightfield};

use super::super::claims::Evidence;
use super::super::findings::DangerMap;
use crate::report::{Axis, Figure, Ink, Key, Mark, Panel};

/// Fainter cells than this are left out.
const FAINTEST: f32 = 0.03;

/// A map for each skill of every run that was decided about.
pub(super) fn maps(evidence: &Evidence<'_>) -> Vec<Figure> {
    let runs = evidence.findings.runs.iter().filter(|run| run.danger.is_some());
    let figure = |(index, run): (usize, &super::super::findings::Recorded)| {
        let danger = run.danger.as_ref()?;
        let course = format!("{} of {:.0} cm", run.course.id().replace('_', " "), run.size_m * 100.0);
        Some(Figure {
            id: format!("danger_{index}"),
            title: format!("Where the danger is: {course}, tick {} ({:.2} s)", danger.tick, danger.t_s),
            caption: "Seen from above, the robot's base at 0 and ahead to the right. How much each cell takes from (orange) or gives to \
                      (blue) the predicted viability on the way from level ground to this field; the strongest cell of all skills is \
                      full colour. Integrated gradients; the cells add up to the whole change. The same for any tick: \
                      vocaloco explain FILE --tick T --danger."
                .to_owned(),
            legend: vec![
                Key::Fill(Ink::Crashed, "takes viability away".to_owned()),
                Key::Fill(Ink::Reached, "gives viability".to_owned()),
            ],
            panels: panels(danger),
            across: 3,
        })
    };
    runs.enumerate().filter_map(figure).collect()
}

fn panels(danger: &DangerMap) -> Vec<Panel> {
    let all = || danger.skills.iter().flat_map(|skill| skill.credit.iter());
    let most = all().map(|credit| credit.abs()).fold(1e-6, f32::max);
    let panel = |skill: &super::super::findings::DangerOf| {
        let cell = |index: usize| {
            let credit = skill.credit.get(index).copied().unwrap_or(0.0);
            let strength = credit.abs() / most;
            let columns = CELLS / 31;
            let [x_m, y_m] = Heightfield::point(index / columns, index % columns).map(f64::from);
            let ink = if credit < 0.0 { Ink::Crashed } else { Ink::Reached };
            (strength >= FAINTEST).then(|| Mark::Tint {
                x: [x_m - 0.05, x_m + 0.05],
                y: [y_m - 0.05, y_m + 0.05],
                ink,
                strength: f64::from(strength.sqrt()),
            })
        };
        let body = Mark::Outline { x: [-0.45, 0.45], y: [-0.16, 0.16] };
        Panel {
            title: format!("{}: {:.2} level, {:.2} here", skill.name, skill.level, skill.here),
            x: Axis::over("ahead (m)", -1.05, 2.05, 1.0).with_ticks(&[-1.0, 0.0, 1.0, 2.0]),
            y: Axis::over("left (m)", -0.55, 0.55, 0.5).with_ticks(&[-0.5, 0.0, 0.5]),
            marks: (0..CELLS).filter_map(cell).chain([body]).collect(),
        }
    };
    danger.skills.iter().map(panel).collect()
}
