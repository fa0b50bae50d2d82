//! A course in words: what happened, what was expected, what the numbers say where they differ.

use vocaloco_core::{decision::Forced, robot::RobotModel};
use vocaloco_sim::{
    course::{CourseRun, Outcome},
    kinematics::{forward_kinematics, legs},
    terrain::{CourseKind, FLAT_M, TREAD_M},
};

use crate::report::{Story, path, told};

/// The deployed skill that is made for these stairs: the paper's `ascend` or `descend`, of whichever kind
/// (`ascend_network`).
pub(super) fn made_for(run: &CourseRun) -> &str {
    let name = match run.kind {
        CourseKind::StairsUp | CourseKind::Mixed | CourseKind::Obstacles => "ascend",
        CourseKind::StairsDown => "descend",
    };
    let verdicts = run.ticks.iter().find_map(|tick| tick.decision.as_ref()).map(|it| it.skills.as_slice());
    let deployed = verdicts.unwrap_or_default().iter().map(|verdict| verdict.name.as_str());
    deployed.into_iter().find(|deployed| deployed.starts_with(name)).unwrap_or(name)
}

/// A robot that came less far than this has not walked up to anything, m. A step that it shuns is in
/// view within the first 0.2 m, and stopping at first sight of it is right.
const CAME_AT_LEAST_M: f64 = 0.3;

/// Names a course in files and links: `stairs_up-0.12`.
pub(super) fn id(run: &CourseRun) -> String {
    format!("{}-{:.2}", run.kind.id(), run.size_m)
}

fn direction(kind: CourseKind) -> &'static str {
    match kind {
        CourseKind::StairsUp => "up",
        CourseKind::StairsDown => "down",
        CourseKind::Mixed => "up and down",
        CourseKind::Obstacles => "over obstacles",
    }
}

/// The story of a run, and a note where it went another way than the paper's.
pub(super) fn tell(
    run: &CourseRun,
    robot: &RobotModel,
    thresholds: &[(String, f32)],
    expected: Outcome,
) -> (Story, String) {
    let as_expected =
        run.outcome == expected && (expected != Outcome::Stopped || walked_up_and_stopped_short(run, robot));
    let direction = direction(run.kind);
    let mut summary = told(run);
    if run.outcome == Outcome::Stopped {
        let foot_m = last_foot_m(run, robot);
        let where_ = if foot_m < FLAT_M { "before" } else { "past" };
        let away_m = (FLAT_M - foot_m).abs();
        summary = format!("{summary} The foremost foot stands {away_m:.2} m {where_} the first step's edge.");
    }
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
        expected: Some(expected.id().to_owned()),
        as_expected,
    };
    (story, note)
}

/// A skill brought it there, none failed, and nothing had touched the first step.
fn walked_up_and_stopped_short(run: &CourseRun, robot: &RobotModel) -> bool {
    let walked_up = !run.skills().is_empty() && run.distance_m >= CAME_AT_LEAST_M;
    let decisions = || run.ticks.iter().filter_map(|tick| tick.decision.as_ref());
    let failed = decisions().any(|decision| decision.forced == Some(Forced::Fault));
    let touched = run.nonfoot_contact || furthest_foot_m(run, robot) >= FLAT_M;
    walked_up && !failed && !touched
}

/// What there is to say when a reached course did not go walk → made for it → walk.
fn note(run: &CourseRun, thresholds: &[(String, f32)]) -> String {
    let made_for = made_for(run);
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

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_core::decision::Decision;
    use vocaloco_sim::course::{CourseTick, Switch};
    use vocaloco_sim::plant::BasePose;

    /// A stop before 40 cm, 0.9 m from where it began, under walk.
    fn stopped() -> CourseRun {
        let tick = CourseTick {
            decision: Some(Decision::default()),
            base: BasePose::from_yaw([1.9, 0.1, 0.55], 0.0),
            joint_position_rad: vec![0.0; 12],
            foot_contact: vec![true; 4],
        };
        CourseRun {
            kind: CourseKind::StairsUp,
            size_m: 0.4,
            steps: 3,
            outcome: Outcome::Stopped,
            duration_s: 4.0,
            distance_m: 0.9,
            cot: None,
            cot_signed: None,
            switches: vec![Switch { t_s: 0.2, from: "stand".into(), to: "walk".into() }],
            nonfoot_contact: false,
            unseen: None,
            ticks: vec![tick],
        }
    }

    fn is_as_expected(run: &CourseRun) -> bool {
        let robots = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        let robot = RobotModel::load(&robots, "anymal_d").expect("the robot");
        tell(run, &robot, &[], Outcome::Stopped).0.as_expected
    }

    #[test]
    fn only_a_robot_that_walked_up_to_the_step_has_stopped_before_it() {
        assert!(is_as_expected(&stopped()));
        assert!(!is_as_expected(&CourseRun { distance_m: 0.1, ..stopped() }), "it never moved");
        assert!(!is_as_expected(&CourseRun { switches: Vec::new(), ..stopped() }), "no skill drove it");
        let mut failed = stopped();
        failed.ticks[0].decision = Some(Decision { forced: Some(Forced::Fault), ..Decision::default() });
        assert!(!is_as_expected(&failed), "a skill failed");
        let mut touching = stopped();
        touching.ticks[0].base = BasePose::from_yaw([2.9, 0.1, 0.55], 0.0);
        assert!(!is_as_expected(&touching), "a foot was past the edge");
    }
}
