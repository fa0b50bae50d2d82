//! What the host relies on, checked without a simulator; `vocaloco skills check` does the rest.

use template_skill::TemplateSkill;
use vocaloco_plugin_api::{
    Command, FootDescription, Host, JointDescription, JointTarget, RobotDescription, RobotState, Skill,
};

const JOINTS: usize = 12;

/// A robot with ANYmal's joint names and a stand that differs from joint to joint.
fn robot() -> RobotDescription {
    let legs = ["LF", "RF", "LH", "RH"];
    let joint = |leg: usize, place: usize| JointDescription {
        name: format!("{}_{}", legs[leg], ["HAA", "HFE", "KFE"][place]).into(),
        parent: if place == 0 { -1 } else { (3 * leg + place) as i32 - 1 },
        origin_in_parent_m: [0.1, 0.1, -0.2],
        axis: if place == 0 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] },
        lower_rad: -2.0,
        upper_rad: 2.0,
        effort_nm: 80.0,
        velocity_limit_rad_per_s: 8.5,
        stand_rad: 0.1 * (3 * leg + place) as f64 - 0.5,
        mass_kg: 2.0,
        com_in_link_m: [0.0, 0.0, -0.1],
    };
    let foot = |leg: usize| FootDescription {
        name: format!("{}_FOOT", legs[leg]).into(),
        joint: 3 * leg as u32 + 2,
        centre_in_link_m: [0.0, 0.0, -0.3],
        radius_m: 0.03,
    };
    RobotDescription {
        name: "test_robot".into(),
        mass_kg: 50.0,
        base_mass_kg: 26.0,
        stand_height_m: 0.55,
        joints: (0..JOINTS).map(|index| joint(index / 3, index % 3)).collect(),
        feet: (0..4).map(foot).collect(),
    }
}

/// The targets of `ticks` ticks after a reset, with a state that changes from tick to tick.
fn targets(skill: &mut TemplateSkill, ticks: usize) -> Vec<JointTarget> {
    let mut all = Vec::new();
    for tick in 0..ticks {
        let wave = (tick % 7) as f32 * 0.01;
        let position_rad: Vec<f32> = (0..JOINTS).map(|joint| wave + 0.1 * joint as f32 - 0.5).collect();
        let velocity = [wave; JOINTS];
        let state = RobotState {
            time_s: tick as f64 * 0.02,
            joint_position_rad: position_rad.as_slice().into(),
            joint_velocity_rad_per_s: velocity.as_slice().into(),
            joint_torque_nm: [][..].into(),
            base_linear_velocity_m_per_s: [0.3, wave, 0.0],
            base_angular_velocity_rad_per_s: [0.0, wave, 0.1],
            projected_gravity: [0.0, 0.0, -1.0],
            foot_contact: [][..].into(),
            terrain_m: [][..].into(),
        };
        if tick == 0 {
            skill.reset(&state).expect("a reset");
        }
        let mut joints = [JointTarget::default(); JOINTS];
        skill.act(&state, &Command::velocity(0.6, 0.0, 0.1), &mut joints).expect("targets");
        all.extend(joints);
    }
    all
}

fn bits(target: &JointTarget) -> [u32; 4] {
    [
        target.position_rad.to_bits(),
        target.stiffness_nm_per_rad.to_bits(),
        target.damping_nms_per_rad.to_bits(),
        target.feed_forward_nm.to_bits(),
    ]
}

#[test]
fn the_same_inputs_since_reset_give_the_same_bytes() {
    let mut skill = TemplateSkill::create("", &robot(), Host::default()).expect("an instance");
    let first = targets(&mut skill, 20);
    let again = targets(&mut skill, 20);
    let fresh = targets(&mut TemplateSkill::create("", &robot(), Host::default()).expect("an instance"), 20);
    for (index, target) in first.iter().enumerate() {
        let (tick, joint) = (index / JOINTS, index % JOINTS);
        assert_eq!(bits(target), bits(&again[index]), "tick {tick}, joint {joint}, after a reset");
        assert_eq!(bits(target), bits(&fresh[index]), "tick {tick}, joint {joint}, in a fresh instance");
    }
}

#[test]
fn every_target_is_finite_and_no_gain_is_negative() {
    let mut skill = TemplateSkill::create("", &robot(), Host::default()).expect("an instance");
    for (index, target) in targets(&mut skill, 50).iter().enumerate() {
        let JointTarget { position_rad, stiffness_nm_per_rad, damping_nms_per_rad, feed_forward_nm } =
            *target;
        let sound = position_rad.is_finite()
            && feed_forward_nm.is_finite()
            && (0.0..1e4).contains(&stiffness_nm_per_rad)
            && (0.0..1e3).contains(&damping_nms_per_rad);
        assert!(sound, "tick {}, joint {}: {target:?}", index / JOINTS, index % JOINTS);
    }
}

#[test]
fn it_holds_the_stand() {
    let robot = robot();
    let mut skill = TemplateSkill::create("", &robot, Host::default()).expect("an instance");
    for (target, joint) in targets(&mut skill, 1).iter().zip(&robot.joints) {
        assert_eq!(target.position_rad.to_bits(), (joint.stand_rad as f32).to_bits(), "{}", joint.name);
    }
}

#[test]
fn unknown_parameters_and_values_out_of_range_are_refused() {
    for text in ["stifness = 80.0", "stiffness_nm_per_rad = nan", "damping_nms_per_rad = -1.0"] {
        let error = TemplateSkill::create(text, &robot(), Host::default()).expect_err(text);
        assert!(error.message.contains(text.split(' ').next().unwrap_or(text)), "{error}");
    }
}
