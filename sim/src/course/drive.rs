//! The loop over a course: command, tick, look how it ends.

use super::{
    CourseConfig, CourseError, CourseRun, CourseTick, FORWARD_M_PER_S, Outcome, Pilot, REACHED_WITHIN_M,
    STOPPED_AFTER_S, Switch, TARGET_ON_FLAT_M,
};
use crate::{
    angle::wrapped_rad,
    driver::TICK_S,
    plant::{GRAVITY_M_PER_S2, Measurement},
    terrain::COURSE_WIDTH_M,
};
use vocaloco_core::decision::{Decision, Forced};
use vocaloco_plugin_api::Command;

/// Distances below this say nothing about the cost of transport, m.
const SHORTEST_M: f64 = 0.1;
/// Height of the base above the far flat at which a robot is on it, and on its feet, m.
const ON_ITS_FEET_M: std::ops::RangeInclusive<f32> = 0.3..=0.9;

/// Drives a course to its end with a pilot whose plant stands settled on the near flat.
///
/// The command is (0.6, 0, clip(0.5·heading error, ±1)), as `legged_gym` steers. A base that leaves
/// the map has crashed. Standing because a skill was taken out of service is no stop: the selector did
/// not choose it, so a run that ends in it is stuck.
///
/// # Errors
/// When the pilot cannot go on.
pub fn drive(config: &CourseConfig, pilot: &mut dyn Pilot) -> Result<CourseRun, CourseError> {
    let bounds = Bounds::of(config);
    let length_m = f64::from(config.course().length_m());
    let time_limit_s = 3.0 * length_m / f64::from(FORWARD_M_PER_S);
    let last_tick = (time_limit_s / TICK_S).round() as usize;
    let stopped_ticks = (STOPPED_AFTER_S / TICK_S).round() as usize;

    let start_x_m = pilot.plant().measure().base.position_m[0];
    pilot.reset_work();
    let mut run = Progress::default();
    let mut outcome = None;
    for _ in 0..last_tick {
        let measured = pilot.plant().measure();
        let before = config.recorded.then(|| CourseTick::of(measured));
        let tick = pilot.tick(&steering(measured))?;
        run.follow(&tick.active, tick.decision.as_ref());
        if let Some(mut before) = before {
            before.decision = tick.decision;
            run.ticks.push(before);
        }
        run.nonfoot_contact |= tick.nonfoot_contact;
        run.count += 1;
        let base_m = pilot.plant().measure().base.position_m;
        outcome = if tick.base_contact || bounds.left_by(base_m) {
            Some(Outcome::Crashed)
        } else if bounds.reached_by(base_m) {
            Some(Outcome::Reached)
        } else if run.standing >= stopped_ticks {
            Some(run.stood())
        } else {
            None
        };
        if outcome.is_some() {
            break;
        }
    }
    let outcome = outcome.unwrap_or_else(|| run.stood());

    let plant = pilot.plant();
    let distance_m = f64::from(plant.measure().base.position_m[0] - start_x_m);
    let weight_n = f64::from(plant.total_mass_kg()) * f64::from(GRAVITY_M_PER_S2);
    let per_weight = |work_j: f64| (distance_m >= SHORTEST_M).then(|| work_j / (weight_n * distance_m));
    Ok(CourseRun {
        kind: config.kind,
        size_m: config.size_m,
        steps: config.steps,
        outcome,
        duration_s: run.count as f64 * TICK_S,
        distance_m,
        cot: per_weight(plant.positive_work_j()),
        cot_signed: per_weight(plant.signed_work_j()),
        switches: run.switches,
        nonfoot_contact: run.nonfoot_contact,
        unseen: pilot.unseen(),
        ticks: run.ticks,
    })
}

/// What the loop keeps from tick to tick.
#[derive(Default)]
struct Progress {
    ticks: Vec<CourseTick>,
    switches: Vec<Switch>,
    active: Option<String>,
    /// Ticks for which the robot has been standing without a break.
    standing: usize,
    /// It has been standing because of a fault.
    faulted: bool,
    count: usize,
    nonfoot_contact: bool,
}

impl Progress {
    fn follow(&mut self, active: &str, decision: Option<&Decision>) {
        let before = self.active.as_deref().unwrap_or("stand");
        if before != active {
            self.switches.push(Switch {
                t_s: self.count as f64 * TICK_S,
                from: before.to_owned(),
                to: active.to_owned(),
            });
        }
        if self.active.as_deref() != Some(active) {
            self.active = Some(active.to_owned());
        }
        if active == "stand" {
            self.standing += 1;
            self.faulted |= decision.is_some_and(is_faulted);
        } else {
            self.standing = 0;
            self.faulted = false;
        }
    }

    /// What the standing at the end comes to, when the run ends now.
    fn stood(&self) -> Outcome {
        if self.standing > 0 && !self.faulted { Outcome::Stopped } else { Outcome::Stuck }
    }
}

impl CourseTick {
    fn of(measured: &Measurement) -> Self {
        Self {
            decision: None,
            base: measured.base,
            joint_position_rad: measured.joint_position_rad.clone(),
            foot_contact: measured.foot_contact.clone(),
        }
    }
}

fn steering(measured: &Measurement) -> Command {
    let error_rad = wrapped_rad(-measured.base.yaw());
    Command::velocity(FORWARD_M_PER_S, 0.0, (0.5 * error_rad).clamp(-1.0, 1.0))
}

/// The active skill failed, or none is left in service.
fn is_faulted(decision: &Decision) -> bool {
    let none_left = decision.skills.iter().all(|skill| skill.reason.is_out_of_service());
    decision.forced == Some(Forced::Fault) || none_left
}

/// Where a course ends.
#[expect(clippy::struct_field_names, reason = "all of them are metres, and names end in their unit")]
struct Bounds {
    length_m: f32,
    target_x_m: f32,
    far_flat_m: f32,
}

impl Bounds {
    fn of(config: &CourseConfig) -> Self {
        let course = config.course();
        Self {
            length_m: course.length_m(),
            target_x_m: course.far_flat_from_m() + TARGET_ON_FLAT_M,
            far_flat_m: course.far_flat_m(),
        }
    }

    fn left_by(&self, [x_m, y_m, _]: [f32; 3]) -> bool {
        !((0.0..=self.length_m).contains(&x_m) && y_m.abs() <= 0.5 * COURSE_WIDTH_M)
    }

    /// The target is a line across the far flat: the robot is steered to a heading, not to a point.
    fn reached_by(&self, base_m: [f32; 3]) -> bool {
        let [x_m, _, z_m] = base_m;
        !self.left_by(base_m)
            && (x_m - self.target_x_m).abs() <= REACHED_WITHIN_M
            && ON_ITS_FEET_M.contains(&(z_m - self.far_flat_m))
    }
}
