//! A stop at full speed, on flat ground and half-way up or down stairs: in at least 11 of 12 phases of
//! the gait the robot comes to a stand, upright and without its base touching anything.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use vocaloco_core::heightfield::Field;
use vocaloco_core::registry::{ModelPolicy, load_skill};
use vocaloco_core::robot::RobotModel;
use vocaloco_core::runtime::{CallFault, Predict, Runtime, RuntimeConfig, Skill};
use vocaloco_core::selector::Prediction;
use vocaloco_core::switch::Windows;
use vocaloco_plugin_api::Command;
use vocaloco_sim::course::{CourseConfig, CourseStage, Pilot, SelectorPilot};
use vocaloco_sim::terrain::CourseKind;
use vocaloco_tests::shipped;

/// Viable until told otherwise.
struct Scripted(Arc<AtomicBool>);

impl Predict for Scripted {
    fn predict(&mut self, _: &Field) -> (Prediction, Option<CallFault>) {
        let viability = if self.0.load(Ordering::Relaxed) { 1.0 } else { 0.0 };
        (Prediction::of(viability, 0.5), None)
    }
}

/// How a stop went.
#[derive(Debug)]
struct Stop {
    touched: bool,
    /// Cosine of the base's tilt at the end.
    upright: f32,
    /// At the end, m/s.
    speed_m_per_s: f32,
}

/// Drives `skill` until the base has come to `stop_x_m` and `phase` ticks more, then finds it
/// unviable and lets two seconds go by; then two more after each of `pushes`, changes of the base's
/// velocity in the world, m/s.
fn stop(
    skill: &str,
    course: (CourseKind, f32),
    (stop_x_m, phase): (f32, usize),
    pushes: &[[f32; 3]],
) -> Stop {
    let installation = shipped();
    let robot = Arc::new(RobotModel::load(&installation.robots_folder(), "anymal_d").expect("the robot"));
    let loaded =
        load_skill(&installation, skill, &robot.description, ModelPolicy::Optional).expect("a skill");
    let viable = Arc::new(AtomicBool::new(true));
    let controller = loaded.create(&robot.description).expect("an instance");
    let skill = Skill {
        rule: Skill::rule_of(&loaded),
        needs: *controller.needs(),
        controller: Box::new(controller),
        predictors: Box::new(Scripted(Arc::clone(&viable))),
    };
    let windows = Windows { switch: 1, stop: 1, resume: 1000 };
    let config = RuntimeConfig::of(windows);
    let mut runtime = Runtime::from_skills(config, Arc::clone(&robot), vec![skill]);

    let course = CourseConfig::demo(course.0, course.1, 7);
    let CourseStage { terrain, mut plant } = CourseStage::set(&robot, &course).expect("a settled robot");
    let mut pilot = SelectorPilot::new(&course, &mut plant, &terrain, &mut runtime);
    let command = |pilot: &SelectorPilot<'_>| {
        Command::velocity(0.6, 0.0, (-0.5 * pilot.plant().measure().base.yaw()).clamp(-1.0, 1.0))
    };
    let arrived = (0..1500).any(|_| {
        pilot.tick(&command(&pilot)).expect("a tick");
        pilot.plant().measure().base.position_m[0] >= stop_x_m
    });
    assert!(arrived, "it never came to {stop_x_m} m");
    for _ in 0..phase {
        pilot.tick(&command(&pilot)).expect("a tick");
    }
    viable.store(false, Ordering::Relaxed);
    let mut touched = false;
    for push in std::iter::once(None).chain(pushes.iter().map(Some)) {
        if let Some(&push) = push {
            pilot.push(push);
        }
        for _ in 0..100 {
            let tick = pilot.tick(&command(&pilot)).expect("a tick");
            assert_eq!(tick.active, "stand");
            touched |= tick.base_contact;
        }
    }
    let measured = pilot.plant().measure();
    let speed = measured.base_linear_velocity.iter().map(|v| v * v).sum::<f32>().sqrt();
    Stop { touched, upright: -measured.projected_gravity[2], speed_m_per_s: speed }
}

/// Stops in twelve phases of a gait of about 24 ticks: all of them come to a stand, or all but one.
fn every_phase(skill: &str, course: (CourseKind, f32), stop_x_m: f32, least_upright: f32) {
    let stops: Vec<_> =
        (0..24).step_by(2).map(|phase| (phase, stop(skill, course, (stop_x_m, phase), &[]))).collect();
    let falls: Vec<_> = stops
        .iter()
        .filter(|(_, stop)| stop.touched || stop.upright < least_upright || stop.speed_m_per_s > 0.15)
        .collect();
    assert!(falls.len() <= 1, "{skill} fell in {} of 12: {falls:?}", falls.len());
}

#[test]
fn on_flat_ground() {
    every_phase("walk", (CourseKind::StairsUp, 0.12), 1.6, 0.98);
}

#[test]
fn half_way_up_stairs_of_15_cm() {
    every_phase("ascend_network", (CourseKind::StairsUp, 0.15), 3.3, 0.8);
}

#[test]
fn half_way_down_stairs_of_15_cm() {
    every_phase("descend_network", (CourseKind::StairsDown, 0.15), 3.5, 0.8);
}

/// Pushes of 0.5 m/s towards eight sides, after stops in twelve phases of the gait: those that it does not stand up to,
/// by phase and degrees.
fn pushed_over(
    skill: &str,
    course: (CourseKind, f32),
    stop_x_m: f32,
    least_upright: f32,
) -> Vec<(usize, i32, Stop)> {
    let pushes = [0, 1, 2, 3, 4, 5, 6, 7].map(|side| {
        let (sin, cos) = (side as f32 * std::f32::consts::FRAC_PI_4).sin_cos();
        (45 * side, [0.5 * cos, 0.5 * sin])
    });
    let held = |stop: &Stop| !stop.touched && stop.upright >= least_upright && stop.speed_m_per_s <= 0.15;
    (0..24)
        .step_by(2)
        .flat_map(|phase| pushes.map(|(degrees, [x, y])| (phase, degrees, [x, y, 0.0])))
        .map(|(phase, degrees, push)| (phase, degrees, stop(skill, course, (stop_x_m, phase), &[push])))
        .filter(|(.., stop)| !held(stop))
        .collect()
}

#[test]
fn a_stopped_robot_holds_a_push_of_half_a_metre_per_second_on_flat_ground() {
    let falls = pushed_over("walk", (CourseKind::StairsUp, 0.12), 1.6, 0.97);
    assert!(falls.is_empty(), "{falls:?}");
}

#[test]
fn a_robot_stopped_half_way_down_stairs_holds_it_too() {
    let falls = pushed_over("descend_network", (CourseKind::StairsDown, 0.15), 3.5, 0.8);
    assert!(falls.is_empty(), "{falls:?}");
}

/// There is a phase in which it stands on the edges of steps, and others in which it leans or sways longer.
#[test]
fn a_robot_stopped_half_way_up_stairs_holds_it_in_most_phases() {
    let falls = pushed_over("ascend_network", (CourseKind::StairsUp, 0.15), 3.3, 0.8);
    assert!(falls.len() <= 14, "{} of 96: {falls:?}", falls.len());
}
