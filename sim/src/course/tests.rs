use std::{path::Path, sync::Arc};

use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::{Command, JointTarget};

use super::*;
use crate::{
    plant::{BasePose, Plant, PlantKind},
    terrain::Terrain,
};

/// Carries the robot through the air at a constant speed, or drops it.
struct Carrier {
    plant: Plant,
    robot: Arc<RobotModel>,
    speed_m_per_s: f32,
    dropped: bool,
    active: fn(usize) -> &'static str,
    ticks: usize,
    commands: Vec<Command>,
}

impl Pilot for Carrier {
    fn plant(&self) -> &Plant {
        &self.plant
    }

    fn reset_work(&mut self) {
        self.plant.reset_work();
    }

    fn tick(&mut self, command: &Command) -> Result<PilotTick, CourseError> {
        self.commands.push(*command);
        let mut base_contact = false;
        if self.dropped {
            for _ in 0..4 {
                self.plant.step(&vec![JointTarget::default(); self.robot.joint_count()]);
                base_contact |= self.plant.measure().base_contact;
            }
        } else if self.speed_m_per_s > 0.0 {
            let mut base = self.plant.measure().base;
            base.position_m[0] += self.speed_m_per_s * 0.02;
            self.plant.place(&base, &self.robot.stand_position_rad());
        }
        let active = (self.active)(self.ticks).to_owned();
        self.ticks += 1;
        Ok(PilotTick { decision: None, active, base_contact, nonfoot_contact: base_contact })
    }
}

fn carrier(config: &CourseConfig, yaw_rad: f32) -> Carrier {
    let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
    let robot = Arc::new(RobotModel::load(&robots, "anymal_d").unwrap());
    let terrain = Terrain::course(config.kind, config.size_m, config.steps);
    let mut plant = Plant::new(&robot, &terrain, PlantKind::Reference);
    let height_m = robot.description.stand_height_m as f32;
    plant.place(&BasePose::from_yaw([1.0, 0.1, height_m], yaw_rad), &robot.stand_position_rad());
    Carrier {
        plant,
        robot,
        speed_m_per_s: 0.0,
        dropped: false,
        active: |_| "walk",
        ticks: 0,
        commands: Vec::new(),
    }
}

fn config() -> CourseConfig {
    CourseConfig::demo(CourseKind::StairsUp, 0.12, 1)
}

#[test]
fn half_a_metre_before_the_target_is_reached() {
    let mut carrier = Carrier { speed_m_per_s: 0.6, ..carrier(&config(), 0.0) };
    let run = drive(&config(), &mut carrier).unwrap();
    assert_eq!(run.outcome, Outcome::Reached);
    // Flat 3 m, three treads, 2 m of the far flat, less half a metre; from x = 1 m.
    let wanted_m = 3.0 + 0.93 + 2.0 - 0.5 - 1.0;
    assert!((run.distance_m - wanted_m).abs() < 0.02, "{} for {wanted_m}", run.distance_m);
    assert!((run.duration_s - wanted_m / 0.6).abs() < 0.05, "{} s", run.duration_s);
    assert_eq!(run.ticks.len(), (run.duration_s / 0.02).round() as usize);
}

#[test]
fn a_base_contact_is_a_crash_at_once() {
    let mut carrier = Carrier { dropped: true, ..carrier(&config(), 0.0) };
    let run = drive(&config(), &mut carrier).unwrap();
    assert_eq!(run.outcome, Outcome::Crashed);
    assert!(run.duration_s < 1.5, "{} s", run.duration_s);
    assert!(run.cot.is_none(), "a fall on the spot has no cost of transport");
}

#[test]
fn standing_for_two_seconds_without_a_break_is_a_stop() {
    let mut carrier =
        Carrier { active: |tick| if tick == 60 { "walk" } else { "stand" }, ..carrier(&config(), 0.0) };
    let run = drive(&config(), &mut carrier).unwrap();
    assert_eq!(run.outcome, Outcome::Stopped);
    assert!((run.duration_s - (61.0 * 0.02 + 2.0)).abs() < 1e-9, "{} s", run.duration_s);
    let switches: Vec<_> = run.switches.iter().map(|s| (s.from.as_str(), s.to.as_str())).collect();
    assert_eq!(switches, [("stand", "walk"), ("walk", "stand")]);
    assert!((run.switches[0].t_s - 1.2).abs() < 1e-9);
}

#[test]
fn going_nowhere_under_a_skill_is_stuck_after_three_times_the_length() {
    let config = CourseConfig { recorded: false, ..config() };
    let mut carrier = carrier(&config, 0.0);
    let run = drive(&config, &mut carrier).unwrap();
    assert_eq!(run.outcome, Outcome::Stuck);
    assert!((run.duration_s - 3.0 * 6.93 / 0.6).abs() < 0.02, "{} s", run.duration_s);
    assert!(run.ticks.is_empty(), "it was not asked to keep ticks");
}

#[test]
fn skills_are_named_in_the_order_of_use_without_standing() {
    let mut carrier = Carrier {
        speed_m_per_s: 0.6,
        active: |tick| match tick {
            0..10 | 150..160 => "stand",
            100..150 | 160..180 => "ascend",
            _ => "walk",
        },
        ..carrier(&config(), 0.0)
    };
    let run = drive(&config(), &mut carrier).unwrap();
    assert_eq!(run.skills(), ["walk", "ascend", "walk"]);
    assert_eq!(run.switches.len(), 5);
}

#[test]
fn the_command_steers_to_the_heading_and_never_sideways() {
    let mut carrier = Carrier { speed_m_per_s: 0.6, ..carrier(&config(), 0.4) };
    drive(&config(), &mut carrier).unwrap();
    for command in &carrier.commands {
        assert!((command.velocity[0] - 0.6).abs() < 1e-6 && command.velocity[1] == 0.0);
        assert!((command.velocity[2] + 0.2).abs() < 1e-3, "half of the error of 0.4 rad, to the right");
    }
}
