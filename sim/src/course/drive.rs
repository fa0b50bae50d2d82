//! The loop over a course: command, tick, look how it ends.

use super::{
    CourseConfig, CourseError, CourseRun, CourseTick, FORWARD_M_PER_S, Outcome, Pilot, REACHED_WITHIN_M,
    STOPPED_AFTER_S, Switch, TARGET_ON_FLAT_M,
};
use crate::{
    angle::wrapped_rad,
    driver::TICK_S,
    plant::{GRAVITY_M_PER_S2, Measurement},
    terrain::{FLAT_M, TREAD_M},
};
use vocaloco_plugin_api::Command;

/// Distances below this say nothing about the cost of transport, m.
const SHORTEST_M: f64 = 0.1;

/// Drives a course to its end with a pilot whose plant stands settled on the near flat.
///
/// The command is (0.6, 0, clip(0.5·heading error, ±1)), as `legged_gym` steers.
///
/// # Errors
/// When the pilot cannot go on.
pub fn drive(config: &CourseConfig, pilot: &mut dyn Pilot) -> Result<CourseRun, CourseError> {
    let target_x_m = FLAT_M + config.steps as f32 * TREAD_M + TARGET_ON_FLAT_M;
    let length_m = 2.0 * f64::from(FLAT_M) + config.steps as f64 * f64::from(TREAD_M);
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
        run.follow(&tick.active);
        if let Some(mut before) = before {
            before.decision = tick.decision;
            run.ticks.push(before);
        }
        run.nonfoot_contact |= tick.nonfoot_contact;
        run.count += 1;
        outcome = if tick.base_contact {
            Some(Outcome::Crashed)
        } else if reached(pilot.plant().measure(), target_x_m) {
            Some(Outcome::Reached)
        } else if run.standing >= stopped_ticks {
            Some(Outcome::Stopped)
        } else {
            None
        };
        if outcome.is_some() {
            break;
        }
    }
    let outcome = outcome.unwrap_or(if run.standing > 0 { Outcome::Stopped } else { Outcome::Stuck });

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
    count: usize,
    nonfoot_contact: bool,
}

impl Progress {
    fn follow(&mut self, active: &str) {
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
        self.standing = if active == "stand" { self.standing + 1 } else { 0 };
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

/// The target is a line across the far flat: the robot is steered to a heading, not to a point.
fn reached(measured: &Measurement, target_x_m: f32) -> bool {
    (measured.base.position_m[0] - target_x_m).abs() <= REACHED_WITHIN_M
}
