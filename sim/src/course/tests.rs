use std::{path::Path, sync::Arc};

use vocaloco_core::{
    decision::{Decision, Forced, SkillVerdict},
    robot::RobotModel,
    selector::Reason,
};
use vocaloco_plugin_api::{Command, JointTarget};

use super::*;
use crate::{
    plant::{BasePose, Plant, PlantKind},
    terrain::Terrain,
};

/// Up three steps of 12 cm by the time that it comes to the target.
const CLIMBING: [f32; 3] = [0.6, 0.0, 0.05];

/// Carries the robot through the air at a constant velocity, or drops it.
struct Carrier {
    plant: Plant,
    robot: Arc<RobotModel>,
    velocity_m_per_s: [f32; 3],
    dropped: bool,
    active: fn(usize) -> &'static str,
    decision: fn(usize) -> Option<Decision>,
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
        } else if self.velocity_m_per_s != [0.0; 3] {
            let mut base = self.plant.measure().base;
            for (position, velocity) in base.position_m.iter_mut().zip(self.velocity_m_per_s) {
                *position += velocity * 0.02;
            }
            self.plant.place(&base, &self.robot.stand_position_rad());
        }
        let active = (self.active)(self.ticks).to_owned();
        let decision = (self.decision)(self.ticks);
        self.ticks += 1;
        Ok(PilotTick { decision, active, base_contact, nonfoot_contact: base_contact })
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
        velocity_m_per_s: [0.0; 3],
        dropped: false,
        active: |_| "walk",
        decision: |_| None,
        ticks: 0,
        commands: Vec::new(),
    }
}

fn config() -> CourseConfig {
    CourseConfig::demo(CourseKind::StairsUp, 0.12, 1)
}

#[test]
fn half_a_metre_before_the_target_is_reached() {
    let mut carrier = Carrier { velocity_m_per_s: CLIMBING, ..carrier(&config(), 0.0) };
    let run = drive(&config(), &mut carrier).unwrap();
    assert_eq!(run.outcome, Outcome::Reached);
    // Flat 3 m, three treads, 2 m of the far flat, less half a metre; from x = 1 m.
    let wanted_m = 3.0 + 0.93 + 2.0 - 0.5 - 1.0;
    assert!((run.distance_m - wanted_m).abs() < 0.02, "{} for {wanted_m}", run.distance_m);
    assert!((run.duration_s - wanted_m / 0.6).abs() < 0.05, "{} s", run.duration_s);
    assert_eq!(run.ticks.len(), (run.duration_s / 0.02).round() as usize);
}

#[test]
fn passing_under_the_far_flat_is_not_reaching_it() {
    let mut carrier = Carrier { velocity_m_per_s: [0.6, 0.0, 0.0], ..carrier(&config(), 0.0) };
    let run = drive(&config(), &mut carrier).unwrap();
    assert_eq!(run.outcome, Outcome::Crashed, "it left the map at the end");
    let wanted_m = 2.0 * 3.0 + 0.93 - 1.0;
    assert!((run.distance_m - wanted_m).abs() < 0.02, "{} for {wanted_m}", run.distance_m);
}

#[test]
fn leaving_the_map_to_a_side_is_a_crash() {
    for (to_the_left_m_per_s, way_m) in [(0.6, 1.9), (-0.6, 2.1)] {
        let velocity_m_per_s = [0.6, to_the_left_m_per_s, 0.05];
        let mut carrier = Carrier { velocity_m_per_s, ..carrier(&config(), 0.0) };
        let run = drive(&config(), &mut carrier).unwrap();
        assert_eq!(run.outcome, Outcome::Crashed);
        assert!((run.distance_m - way_m).abs() < 0.02, "{} for {way_m}", run.distance_m);
    }
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

fn decided(forced: Option<Forced>, reason: Reason) -> Decision {
    let walk = SkillVerdict {
        name: "walk".into(),
        viability: None,
        cot: None,
        strangeness: None,
        viable: false,
        reason,
    };
    Decision { forced, skills: vec![walk], ..Decision::default() }
}

#[test]
fn standing_because_of_a_fault_is_stuck_until_a_skill_drives_again() {
    let faulted: fn(usize) -> _ =
        |tick| Some(decided((tick == 60).then_some(Forced::Fault), Reason::CommandKind));
    let ends = |active: fn(usize) -> &'static str, decision: fn(usize) -> Option<Decision>| {
        drive(&config(), &mut Carrier { active, decision, ..carrier(&config(), 0.0) }).unwrap()
    };
    let run = ends(|tick| if tick < 60 { "walk" } else { "stand" }, faulted);
    assert_eq!(run.outcome, Outcome::Stuck);
    assert!((run.duration_s - (60.0 * 0.02 + 2.0)).abs() < 1e-9, "{} s", run.duration_s);

    let run = ends(|tick| if tick < 60 || tick == 80 { "walk" } else { "stand" }, faulted);
    assert_eq!(run.outcome, Outcome::Stopped);

    let run = ends(|_| "stand", |_| Some(decided(None, Reason::PredictionsFailed)));
    assert_eq!(run.outcome, Outcome::Stuck, "none is left in service");
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
        velocity_m_per_s: CLIMBING,
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
    let mut carrier = Carrier { velocity_m_per_s: CLIMBING, ..carrier(&config(), 0.4) };
    drive(&config(), &mut carrier).unwrap();
    for command in &carrier.commands {
        assert!((command.velocity[0] - 0.6).abs() < 1e-6 && command.velocity[1] == 0.0);
        assert!((command.velocity[2] + 0.2).abs() < 1e-3, "half of the error of 0.4 rad, to the right");
    }
}
