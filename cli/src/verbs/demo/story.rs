//! A course in words: what happened, what was expected, what the numbers say where they differ.

use vocaloco_core::robot::RobotModel;
use vocaloco_sim::{
    course::{CourseRun, Outcome},
    kinematics::{forward_kinematics, legs},
    terrain::{CourseKind, FLAT_M, TREAD_M},
};

use crate::report::{Story, path};

/// The skill that the paper uses on these stairs.
pub(super) fn made_for(kind: CourseKind) -> &'static str {
    match kind {
        CourseKind::StairsUp => "ascend",
        CourseKind::StairsDown => "descend",
    }
}

/// Names a course in files and links: `stairs_up-0.12`.
pub(super) fn id(run: &CourseRun) -> String {
    format!("{}-{:.2}", run.kind.id(), run.size_m)
}

/// The story of a run, and a note where it went another way than the paper's.
pub(super) fn tell(
    run: &CourseRun,
    robot: &RobotModel,
    thresholds: &[(String, f32)],
    expected: Outcome,
) -> (Story, String) {
    let touched = run.nonfoot_contact || furthest_foot_m(run, robot) >= FLAT_M;
    let stopped_short = run.outcome == Outcome::Stopped && !touched;
    let as_expected = run.outcome == expected && (expected != Outcome::Stopped || stopped_short);
    let direction = if run.kind == CourseKind::StairsUp { "up" } else { "down" };
    let mut summary = match run.outcome {
        Outcome::Reached => format!("Reached the far flat in {:.1} s", run.duration_s),
        Outcome::Crashed => format!("The base touched the ground after {:.1} s", run.duration_s),
        Outcome::Stuck => format!("Stuck: time was up after {:.1} s", run.duration_s),
        Outcome::Stopped => format!(
            "Stopped, with the foremost foot {:.2} m {} the first step's edge",
            (FLAT_M - last_foot_m(run, robot)).abs(),
            if last_foot_m(run, robot) < FLAT_M { "before" } else { "past" },
        ),
    };
    if let Some(cot) = run.cot {
        summary = format!("{summary}; cost of transport {cot:.2}");
    }
    let actives: Vec<String> =
        run.switches.iter().map(|switch| format!("{} from {:.2} s", switch.to, switch.t_s)).collect();
    if !actives.is_empty() {
        summary = format!("{summary}. Active: {}", actives.join(", "));
    }
    summary.push('.');
    let note = match expected {
        Outcome::Reached => note(run, thresholds),
        _ => String::new(),
    };
    if !note.is_empty() {
        summary = format!("{summary} {}.", capitalised(&note));
    }
    let story = Story {
        id: id(run),
        title: format!("{} steps of {:.0} cm {direction}", run.steps, run.size_m * 100.0),
        summary,
        expected: expected.id().to_owned(),
        as_expected,
    };
    (story, note)
}

/// What there is to say when a reached course did not go walk → made for it → walk.
fn note(run: &CourseRun, thresholds: &[(String, f32)]) -> String {
    let made_for = made_for(run.kind);
    let paper = format!("walk → {made_for} → walk");
    if run.outcome != Outcome::Reached || path(run) == paper {
        return String::new();
    }
    if run.skills().contains(&made_for) {
        return format!("the paper has {paper}");
    }
    let means: Vec<String> = ["walk", made_for]
        .iter()
        .filter_map(|name| {
            let (viability, cot) = on_the_stairs(run, name)?;
            let (_, threshold) = thresholds.iter().find(|(known, _)| known == name)?;
            Some(format!("{name} viability {viability:.3} (threshold {threshold}), CoT {cot:.3}"))
        })
        .collect();
    format!("the paper has {paper}; here, means with the stairs in reach: {}", means.join("; "))
}

/// Mean predicted viability and cost of transport of a skill from 1 m before the stairs to their end.
fn on_the_stairs(run: &CourseRun, skill: &str) -> Option<(f32, f32)> {
    let stairs_m = FLAT_M - 1.0..=FLAT_M + run.steps as f32 * TREAD_M;
    let predictions: Vec<(f32, f32)> = run
        .ticks
        .iter()
        .filter(|tick| stairs_m.contains(&tick.base.position_m[0]))
        .filter_map(|tick| tick.decision.as_ref()?.skills.iter().find(|verdict| verdict.name == skill))
        .filter_map(|verdict| verdict.viability.zip(verdict.cot))
        .collect();
    let n = predictions.len() as f32;
    let sum = predictions.iter().fold((0.0, 0.0), |sum, p| (sum.0 + p.0, sum.1 + p.1));
    (n > 0.0).then(|| (sum.0 / n, sum.1 / n))
}

/// The foremost point of any foot over the whole run, m along the course.
fn furthest_foot_m(run: &CourseRun, robot: &RobotModel) -> f32 {
    (0..run.ticks.len()).map(|tick| foremost_foot_m(run, robot, tick)).fold(f32::NEG_INFINITY, f32::max)
}

fn last_foot_m(run: &CourseRun, robot: &RobotModel) -> f32 {
    run.ticks.len().checked_sub(1).map_or(f32::NAN, |tick| foremost_foot_m(run, robot, tick))
}

fn foremost_foot_m(run: &CourseRun, robot: &RobotModel, tick: usize) -> f32 {
    let tick = &run.ticks[tick];
    let links = forward_kinematics(&robot.description, &tick.base, &tick.joint_position_rad);
    let lines = legs(&robot.description, &links);
    lines
        .iter()
        .zip(&robot.description.feet)
        .filter_map(|(leg, foot)| leg.last().map(|centre| centre[0] + foot.radius_m as f32))
        .fold(f32::NEG_INFINITY, f32::max)
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
