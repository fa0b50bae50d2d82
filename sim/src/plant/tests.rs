use std::path::PathBuf;
use std::sync::Arc;

use vocaloco_core::robot::{RobotModel, StandParameters};
use vocaloco_plugin_api::JointTarget;

use super::*;
use crate::terrain::{Terrain, TerrainKind};

const KINDS: [PlantKind; 2] = [PlantKind::Reference, PlantKind::Fast];

fn robot() -> Arc<RobotModel> {
    let robots = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
    Arc::new(RobotModel::load(&robots, "anymal_d").expect("the shipped robot"))
}

fn flat() -> Terrain {
    Terrain::tile(TerrainKind::Flat, 0.0, 1)
}

fn hold(positions: &[f32], stiffness: f32, damping: f32) -> Vec<JointTarget> {
    let target = |position: &f32| JointTarget {
        position_rad: *position,
        stiffness_nm_per_rad: stiffness,
        damping_nms_per_rad: damping,
        feed_forward_nm: 0.0,
    };
    positions.iter().map(target).collect()
}

/// Targets that hold the stand.
fn stand(robot: &RobotModel) -> Vec<JointTarget> {
    let StandParameters { stiffness_nm_per_rad, damping_nms_per_rad, .. } = robot.stand;
    hold(&robot.stand_position_rad(), stiffness_nm_per_rad, damping_nms_per_rad)
}

/// Targets of a trot in place that turns slowly: left and right differ.
fn trot(robot: &RobotModel, step: usize) -> Vec<JointTarget> {
    let phase = libm::sinf(std::f32::consts::TAU * step as f32 * STEP_S / 0.5);
    let mut positions = robot.stand_position_rad();
    for (joint, position) in positions.iter_mut().enumerate() {
        let diagonal = if matches!(joint / 3, 0 | 3) { 1.0 } else { -1.0 };
        let front = if joint < 6 { 1.0 } else { -1.0 };
        let bend = [0.05, 0.35, -0.7][joint % 3];
        *position += front * bend * (diagonal * phase).max(0.0);
    }
    hold(&positions, 95.0, 3.6)
}

fn in_the_air(robot: &Arc<RobotModel>, kind: PlantKind) -> Plant {
    let mut plant = Plant::new(robot, &flat(), kind);
    plant.place(&BasePose::from_yaw([0.0, 0.0, 30.0], 0.3), &robot.stand_position_rad());
    plant
}

#[test]
fn the_stand_holds_on_flat_ground() {
    let robot = robot();
    for kind in KINDS {
        let mut plant = Plant::new(&robot, &flat(), kind);
        for _ in 0..600 {
            plant.step(&stand(&robot));
        }
        let measured = plant.measure();
        let sunk = robot.description.stand_height_m as f32 - measured.base.position_m[2];
        assert!((0.0..0.03).contains(&sunk), "{kind:?}: sank by {sunk} m");
        assert!(measured.projected_gravity[2] < -0.999, "{kind:?}: {:?}", measured.projected_gravity);
        assert!(measured.base.position_m[0].abs() < 0.01 && measured.base.position_m[1].abs() < 0.01);
        assert_eq!(measured.foot_contact, [true; 4], "{kind:?}");
        assert!(!measured.base_contact && !measured.nonfoot_contact, "{kind:?}");
        assert!(measured.joint_velocity_rad_per_s.iter().all(|v| v.abs() < 0.01), "{kind:?}");
    }
}

#[test]
fn the_stand_holds_on_a_grid() {
    let robot = robot();
    let terrain = Terrain::tile(TerrainKind::Rough, 0.03, 4);
    let mut plant = Plant::new(&robot, &terrain, PlantKind::Reference);
    let height = robot.description.stand_height_m as f32 + 0.03;
    plant.place(&BasePose::from_yaw([0.5, -0.3, height], 1.1), &robot.stand_position_rad());
    for _ in 0..400 {
        plant.step(&stand(&robot));
    }
    let measured = plant.measure();
    let above = measured.base.position_m[2] - terrain.height_m(0.5, -0.3);
    assert!((above - height).abs() < 0.08, "stands {above} m above the ground");
    assert!(measured.foot_contact.iter().filter(|contact| **contact).count() >= 3);
    assert!(!measured.nonfoot_contact && measured.projected_gravity[2] < -0.98);
}

#[test]
fn a_trot_touches_with_feet_alone_and_lifts_each() {
    let robot = robot();
    let mut plant = Plant::new(&robot, &flat(), PlantKind::Reference);
    let mut steps_in_contact = [0; 4];
    for step in 0..400 {
        plant.step(&trot(&robot, step));
        let measured = plant.measure();
        assert!(!measured.nonfoot_contact, "step {step}");
        for (count, contact) in steps_in_contact.iter_mut().zip(&measured.foot_contact) {
            *count += usize::from(*contact);
        }
    }
    for (foot, count) in robot.description.feet.iter().zip(steps_in_contact) {
        assert!((100..380).contains(&count), "{} touched in {count} of 400 steps", foot.name);
    }
}

#[test]
fn the_applied_torque_is_what_the_drive_can_give() {
    let robot = robot();
    let mut plant = in_the_air(&robot, PlantKind::Reference);
    let mut at_effort = 0;
    for step in 0..200 {
        let wild: Vec<f32> =
            (0..12).map(|joint| if (step / 7 + joint * 5) % 3 == 0 { 9.0 } else { -9.0 }).collect();
        let before = plant.measure().joint_velocity_rad_per_s.clone();
        plant.step(&hold(&wild, 80.0, 2.0));
        for (joint, torque) in plant.measure().joint_torque_nm.iter().enumerate() {
            let limited = robot.drive.limit(*torque, before[joint]);
            assert!((limited - torque).abs() < 1e-4, "step {step}, joint {joint}: {torque} N·m");
            at_effort += usize::from(torque.abs() > 79.9);
        }
    }
    assert!(at_effort > 100, "the limit was asked for {at_effort} times");
}

#[test]
fn motor_strength_scales_the_torque() {
    let robot = robot();
    let targets = hold(&[0.3; 12], 20.0, 1.0);
    let torque = |motor_strength: f32| {
        let mut plant = in_the_air(&robot, PlantKind::Fast);
        plant.vary(&Variation { motor_strength, ..Variation::default() });
        plant.step(&targets);
        plant.measure().joint_torque_nm.clone()
    };
    for (weak, full) in torque(0.5).iter().zip(torque(1.0)) {
        assert!((weak - 0.5 * full).abs() < 1e-5 && full.abs() > 1e-3);
    }
}

#[test]
fn a_snapshot_continues_bit_for_bit_in_this_plant_and_in_another() {
    let robot = robot();
    for kind in KINDS {
        for terrain in
            [Terrain::tile(TerrainKind::StairsUp, 0.1, 3), Terrain::tile(TerrainKind::Rough, 0.05, 3)]
        {
            let start = BasePose::from_yaw([0.9, 0.1, 0.68 + terrain.height_m(0.9, 0.1)], 0.1);
            let mut plant = Plant::new(&robot, &terrain, kind);
            plant.vary(&Variation { friction: 0.6, base_mass_offset_kg: 3.0, motor_strength: 0.9 });
            plant.place(&start, &robot.stand_position_rad());
            let run = |plant: &mut Plant, steps: std::ops::Range<usize>| -> Vec<Measurement> {
                let step = |step| {
                    plant.step(&trot(&robot, step));
                    plant.measure().clone()
                };
                steps.map(step).collect()
            };
            run(&mut plant, 0..150);
            let snapshot = plant.snapshot();
            let continued = run(&mut plant, 150..400);
            let work = (plant.positive_work_j(), plant.signed_work_j());
            plant.restore(&snapshot);
            let again = run(&mut plant, 150..400);
            let mut other = Plant::new(&robot, &terrain, kind);
            other.restore(&snapshot);
            let elsewhere = run(&mut other, 150..400);
            for (step, measured) in continued.iter().enumerate() {
                assert_eq!(*measured, again[step], "{kind:?}, {}, step {step}", terrain.kind);
                assert_eq!(*measured, elsewhere[step], "{kind:?}, {}, step {step}", terrain.kind);
            }
            assert_eq!(work, (other.positive_work_j(), other.signed_work_j()));
        }
    }
}

#[test]
fn placing_forgets_what_came_before() {
    let robot = robot();
    let terrain = Terrain::tile(TerrainKind::StairsDown, 0.1, 3);
    let pose = BasePose::from_yaw([1.0, 0.0, 0.65 + terrain.height_m(1.0, 0.0)], -0.2);
    let mut fresh = Plant::new(&robot, &terrain, PlantKind::Fast);
    let mut used = Plant::new(&robot, &terrain, PlantKind::Fast);
    used.place(&BasePose::from_yaw([0.0, 0.3, 1.4], 2.0), &robot.stand_position_rad());
    for step in 0..300 {
        used.step(&trot(&robot, step));
    }
    for plant in [&mut fresh, &mut used] {
        plant.place(&pose, &robot.stand_position_rad());
    }
    for step in 0..200 {
        fresh.step(&trot(&robot, step));
        used.step(&trot(&robot, step));
        assert_eq!(fresh.measure(), used.measure(), "step {step}");
    }
}

#[test]
fn the_measurement_after_placing_is_the_placement() {
    let robot = robot();
    let mut plant = Plant::new(&robot, &flat(), PlantKind::Reference);
    let pose = BasePose::from_roll_pitch_yaw([1.0, -2.0, 0.9], 0.1, -0.2, 2.0);
    let mut joints = robot.stand_position_rad();
    joints[4] += 0.25;
    plant.place(&pose, &joints);
    assert_eq!(plant.measure().base, pose);
    assert_eq!(plant.measure().joint_position_rad, joints);
    plant.step_torques(&[0.0; 12]);
    for (after, before) in plant.measure().joint_position_rad.iter().zip(&joints) {
        assert!((after - before).abs() < 0.01, "{after} after {before}");
    }
}

/// ΔT = work of the joints + work of gravity, with nothing touched and no range reached; the bound is
/// the reference's promise.
#[test]
fn the_work_balance_of_the_reference_closes_within_one_percent() {
    let robot = robot();
    let mut plant = in_the_air(&robot, PlantKind::Reference);
    let (mut gravity_j, mut turned_over_j, mut worst_j) = (0.0, 0.0, 0.0_f64);
    for step in 0..200 {
        let mut positions = robot.stand_position_rad();
        for (joint, position) in positions.iter_mut().enumerate() {
            let cycles = (1.0 + 0.1 * joint as f32) * step as f32 * STEP_S;
            *position += 0.25 * libm::sinf(std::f32::consts::TAU * cycles);
        }
        let (before, work_before_j) = (plant.momentum(), plant.signed_work_j());
        plant.step(&hold(&positions, 95.0, 3.6));
        let after = plant.momentum();
        let fallen_m_kg = 0.5 * (before.vertical_kg_m_per_s + after.vertical_kg_m_per_s) * f64::from(STEP_S);
        gravity_j -= f64::from(GRAVITY_M_PER_S2) * fallen_m_kg;
        turned_over_j += (plant.signed_work_j() - work_before_j).abs();
        worst_j = worst_j.max((after.kinetic_energy_j - gravity_j - plant.signed_work_j()).abs());
    }
    assert!(turned_over_j > 20.0, "{turned_over_j} J were turned over");
    assert!(worst_j < 0.01 * turned_over_j, "{worst_j} J are missing of {turned_over_j} J");
    assert!(plant.positive_work_j() > plant.signed_work_j());
}

#[test]
fn full_torque_does_not_push_a_joint_past_its_range() {
    let robot = robot();
    for kind in KINDS {
        for (joint, described) in robot.description.joints.iter().enumerate() {
            // Knees alone: other joints would meet another leg first.
            if !described.name.ends_with("KFE") {
                continue;
            }
            for sign in [1.0, -1.0] {
                let mut plant = in_the_air(&robot, kind);
                let mut targets = hold(&robot.stand_position_rad(), 200.0, 5.0);
                targets[joint] = JointTarget { feed_forward_nm: 60.0 * sign, ..JointTarget::default() };
                let (mut lowest, mut highest) = (f32::MAX, f32::MIN);
                for _ in 0..200 {
                    plant.step(&targets);
                    lowest = lowest.min(plant.measure().joint_position_rad[joint]);
                    highest = highest.max(plant.measure().joint_position_rad[joint]);
                }
                let (lower, upper) = (described.lower_rad as f32, described.upper_rad as f32);
                assert!(
                    lowest > lower - 0.1 && highest < upper + 0.1,
                    "{kind:?}, {}: {lowest} to {highest} of {lower} to {upper}",
                    described.name
                );
                let rest = plant.measure().joint_position_rad[joint];
                let limit = if sign > 0.0 { upper } else { lower };
                assert!((rest - limit).abs() < 0.02, "{kind:?}, {}: rests at {rest}", described.name);
            }
        }
    }
}

#[test]
fn legs_do_not_pass_through_each_other() {
    let robot = robot();
    let inner_limit_reached = |both: bool| {
        let mut plant = in_the_air(&robot, PlantKind::Reference);
        let mut targets = hold(&robot.stand_position_rad(), 200.0, 5.0);
        let inwards = |torque: f32| JointTarget { feed_forward_nm: torque, ..JointTarget::default() };
        targets[0] = inwards(-30.0);
        if both {
            targets[3] = inwards(30.0);
        }
        for _ in 0..200 {
            plant.step(&targets);
        }
        (plant.measure().joint_position_rad[0] + 0.785).abs() < 0.03
    };
    assert!(inner_limit_reached(false), "one leg alone reaches its range");
    assert!(!inner_limit_reached(true), "two stop at each other before");
}

#[test]
fn a_limp_robot_falls_on_its_base() {
    let robot = robot();
    let mut plant = Plant::new(&robot, &flat(), PlantKind::Reference);
    let limp = vec![JointTarget::default(); 12];
    plant.step(&limp);
    assert!(!plant.measure().base_contact);
    let fell = (0..400).any(|_| {
        plant.step(&limp);
        plant.measure().base_contact && plant.measure().nonfoot_contact
    });
    assert!(fell);
}

#[test]
fn a_push_is_the_velocity_asked_for() {
    let robot = robot();
    let mut plant = in_the_air(&robot, PlantKind::Reference);
    plant.push([0.5, -0.25, 0.125]);
    let measured = plant.measure();
    let found = measured.base.vector_in_world(measured.base_linear_velocity);
    for (found, wanted) in found.iter().zip([0.5, -0.25, 0.125]) {
        assert!((found - wanted).abs() < 1e-5, "{found} for {wanted}");
    }
    for _ in 0..20 {
        plant.step_torques(&[0.0; 12]);
    }
    let [x, y, _] = plant.measure().base.position_m;
    assert!((x - 0.05).abs() < 2e-3 && (y + 0.025).abs() < 2e-3, "{x} {y}");
}

#[test]
fn friction_and_added_mass_reach_the_engine() {
    let robot = robot();
    let after_push = |variation: Variation| {
        let mut plant = Plant::new(&robot, &flat(), PlantKind::Fast);
        plant.vary(&variation);
        for step in 0..400 {
            if step == 200 {
                plant.push([0.8, 0.0, 0.0]);
            }
            plant.step(&stand(&robot));
        }
        plant.measure().base.position_m
    };
    let slippery = after_push(Variation { friction: 0.1, ..Variation::default() });
    let rough = after_push(Variation { friction: 1.25, ..Variation::default() });
    assert!(slippery[0] > rough[0] + 0.1, "slid {} m and {} m", slippery[0], rough[0]);
    let light = after_push(Variation { base_mass_offset_kg: -5.0, ..Variation::default() });
    let heavy = after_push(Variation { base_mass_offset_kg: 5.0, ..Variation::default() });
    assert!(heavy[2] < light[2] - 0.002, "stood at {} m and {} m", heavy[2], light[2]);
}

#[test]
fn velocities_are_in_the_base_frame() {
    let robot = robot();
    let mut plant = Plant::new(&robot, &flat(), PlantKind::Reference);
    plant.place(
        &BasePose::from_yaw([0.0, 0.0, 5.0], std::f32::consts::FRAC_PI_2),
        &robot.stand_position_rad(),
    );
    plant.push([0.0, 1.0, 0.0]);
    let [forward, left, _] = plant.measure().base_linear_velocity;
    assert!((forward - 1.0).abs() < 1e-5 && left.abs() < 1e-5, "{forward} {left}");
}

/// The ranges are ours (docs/method.md), "to be checked against self-collision".
#[test]
fn no_leg_reaches_the_base_or_a_leg_across_within_its_ranges() {
    let robot = robot();
    let mut plant = Plant::new(&robot, &flat(), PlantKind::Fast);
    for leg in 0..4 {
        let mut touching = 0;
        let at = |joint: usize, share: f64| {
            let described = &robot.description.joints[3 * leg + joint];
            let (lower, upper) = (described.lower_rad + 0.01, described.upper_rad - 0.01);
            (lower + (upper - lower) * share) as f32
        };
        for index in 0..(5 * 10 * 7_u32) {
            let share = |step: u32, of: u32| f64::from(step) / f64::from(of - 1);
            let shares = [share(index / 70, 5), share(index / 7 % 10, 10), share(index % 7, 7)];
            let mut positions = robot.stand_position_rad();
            for (joint, share) in shares.into_iter().enumerate() {
                positions[3 * leg + joint] = at(joint, share);
            }
            plant.place(&BasePose::from_yaw([0.0, 0.0, 30.0], 0.0), &positions);
            plant.step_torques(&[0.0; 12]);
            plant.step_torques(&[0.0; 12]);
            let measured = plant.measure();
            assert!(!measured.base_contact, "leg {leg} at {shares:?} of its ranges");
            // Stretched straight at the other leg of its side, it does meet that one.
            let stretched_at_neighbour = if leg < 2 { shares[1] > 0.75 } else { shares[1] < 0.25 };
            assert!(!measured.nonfoot_contact || stretched_at_neighbour, "leg {leg} at {shares:?}");
            touching += usize::from(measured.nonfoot_contact);
        }
        assert!(touching < 18, "leg {leg} touches something in {touching} of 350 poses");
    }
}

#[test]
fn a_snapshot_takes_another_plant_to_its_own_terrain() {
    let robot = robot();
    let stairs = Terrain::tile(TerrainKind::StairsUp, 0.2, 1);
    let mut climber = Plant::new(&robot, &stairs, PlantKind::Reference);
    climber.place(
        &BasePose::from_yaw([6.0, 0.0, stairs.height_m(6.0, 0.0) + 0.6], 0.0),
        &robot.stand_position_rad(),
    );
    let snapshot = climber.snapshot();
    let mut guest = Plant::new(&robot, &flat(), PlantKind::Fast);
    guest.restore(&snapshot);
    let mut fresh = Plant::from_snapshot(&snapshot);
    for _ in 0..100 {
        for plant in [&mut climber, &mut guest, &mut fresh] {
            plant.step(&stand(&robot));
        }
    }
    assert_eq!(climber.measure(), guest.measure());
    assert_eq!(climber.measure(), fresh.measure());
    guest.place(&BasePose::from_yaw([6.0, 0.0, 5.0], 0.0), &robot.stand_position_rad());
    climber.place(&BasePose::from_yaw([6.0, 0.0, 5.0], 0.0), &robot.stand_position_rad());
    assert_eq!(climber.measure(), guest.measure());
}

#[test]
fn a_foot_that_is_pushed_against_a_riser_stumbles_and_one_that_stands_does_not() {
    let robot = robot();
    // The riser is at x = 1.8 m.
    let terrain = Terrain::tile(TerrainKind::Wall, 0.3, 1);
    let height_m = robot.description.stand_height_m as f32;
    for kind in KINDS {
        let mut plant = Plant::new(&robot, &terrain, kind);
        plant.place(&BasePose::from_yaw([1.22, 0.0, height_m], 0.0), &robot.stand_position_rad());
        for _ in 0..100 {
            plant.step(&stand(&robot));
        }
        assert_eq!(plant.measure().foot_contact, [true; 4], "{kind:?}");
        assert_eq!(plant.measure().foot_stumble, [false; 4], "{kind:?}");
        plant.vary(&Variation { friction: 0.1, ..Variation::default() });
        plant.push([1.0, 0.0, 0.0]);
        let mut stumbled = [false; 4];
        for _ in 0..100 {
            plant.step(&stand(&robot));
            for (ever, now) in stumbled.iter_mut().zip(&plant.measure().foot_stumble) {
                *ever |= now;
            }
        }
        assert_eq!(stumbled, [true, true, false, false], "{kind:?}: the front feet meet the riser");
    }
}
