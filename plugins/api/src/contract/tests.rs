use super::*;
use crate::observation::Term;
use crate::{FootDescription, JointDescription};

/// Two legs of two joints; no two numbers alike.
pub(crate) fn robot() -> RobotDescription {
    let joint = |name: &str, upper_rad: f64| JointDescription {
        name: name.into(),
        parent: -1,
        origin_in_parent_m: [0.0; 3],
        axis: [0.0, 1.0, 0.0],
        lower_rad: -2.0,
        upper_rad,
        effort_nm: 80.0,
        velocity_limit_rad_per_s: 8.5,
        stand_rad: 0.0,
        mass_kg: 1.0,
        com_in_link_m: [0.0; 3],
    };
    let foot = |name: &str, joint| FootDescription {
        name: name.into(),
        joint,
        centre_in_link_m: [0.0; 3],
        radius_m: 0.03,
    };
    RobotDescription {
        name: "biped".into(),
        mass_kg: 20.0,
        base_mass_kg: 16.0,
        stand_height_m: 0.5,
        joints: vec![joint("L_HIP", 1.0), joint("L_KNEE", 1.1), joint("R_HIP", 1.2), joint("R_KNEE", 1.3)]
            .into(),
        feet: vec![foot("L_FOOT", 1), foot("R_FOOT", 3)].into(),
    }
}

/// Joints in another order than the robot's.
pub(crate) fn contract() -> Contract {
    let joints = ["R_KNEE", "L_HIP", "L_KNEE", "R_HIP"];
    let defaults = [-0.4, 0.1, 0.2, -0.3];
    let named = |values: [f64; 4]| joints.iter().map(|name| (*name).to_owned()).zip(values).collect();
    Contract {
        rate_hz: 50.0,
        initial_phase: 0.0,
        history_layout: HistoryLayout::TermMajor,
        joints: joints.map(str::to_owned).to_vec(),
        observation: vec![
            ObservationTerm::new(Term::BaseLinearVelocity, 2.0),
            ObservationTerm::new(Term::JointPosition, 1.0),
        ],
        action: Action {
            kind: ActionKind::JointPosition,
            scale: PerJoint::Each(named([0.5, 0.25, 0.3, 0.6])),
            clip: 4.0,
            default_position_rad: named(defaults),
        },
        gains: Gains {
            stiffness_nm_per_rad: PerJoint::All(80.0),
            damping_nms_per_rad: PerJoint::Each(named([2.0, 3.0, 4.0, 5.0])),
        },
    }
}

fn misfit(spoil: impl FnOnce(&mut Contract)) -> (String, String) {
    let mut contract = contract();
    spoil(&mut contract);
    let misfits = contract.misfits(&robot());
    assert_eq!(misfits.len(), 1, "{misfits:?}");
    (misfits[0].field.clone(), misfits[0].found.clone())
}

fn found_in(field: &str, found: &str) -> (String, String) {
    (field.to_owned(), found.to_owned())
}

#[test]
fn a_sound_contract_has_no_misfits() {
    assert_eq!(contract().misfits(&robot()), []);
}

#[test]
fn joints_must_be_the_robots_each_once() {
    assert_eq!(misfit(|it| it.joints[1] = "L_ANKLE".into()), found_in("joints[1]", "\"L_ANKLE\""));
    assert_eq!(misfit(|it| it.joints[1] = "R_KNEE".into()), found_in("joints[1]", "\"R_KNEE\" again"));
    assert_eq!(misfit(|it| drop(it.joints.pop())), found_in("joints", "3 joints"));
}

#[test]
fn numbers_by_joint_are_complete_and_name_no_stranger() {
    let missing = misfit(|it| {
        let PerJoint::Each(damping) = &mut it.gains.damping_nms_per_rad else { unreachable!() };
        damping.remove("R_HIP");
    });
    assert_eq!(missing, found_in("gains.damping_nms_per_rad.R_HIP", "nothing"));
    let strange = misfit(|it| {
        let PerJoint::Each(scale) = &mut it.action.scale else { unreachable!() };
        scale.insert("TAIL".into(), 0.5);
    });
    assert_eq!(strange, found_in("action.scale.TAIL", "\"TAIL\""));
}

#[test]
fn a_default_outside_the_joints_range_is_refused() {
    let far = misfit(|it| {
        it.action.default_position_rad.insert("L_HIP".into(), 1.05);
    });
    assert_eq!(far, found_in("action.default_position_rad.L_HIP", "1.05"));
}

#[test]
fn nan_is_refused_wherever_a_number_stands() {
    assert_eq!(misfit(|it| it.rate_hz = f64::NAN), found_in("rate_hz", "NaN"));
    assert_eq!(misfit(|it| it.initial_phase = f64::NAN), found_in("initial_phase", "NaN"));
    assert_eq!(misfit(|it| it.action.clip = f64::NAN), found_in("action.clip", "NaN"));
    assert_eq!(misfit(|it| it.action.scale = PerJoint::All(f64::NAN)), found_in("action.scale", "NaN"));
    let gains = misfit(|it| it.gains.stiffness_nm_per_rad = PerJoint::All(f64::NAN));
    assert_eq!(gains, found_in("gains.stiffness_nm_per_rad", "NaN"));
    let scale = misfit(|it| it.observation[0].scale = Factor::All(f64::NAN));
    assert_eq!(scale, found_in("observation[0].scale", "NaN"));
    let clip = misfit(|it| it.observation[1].clip = Some(f64::NAN));
    assert_eq!(clip, found_in("observation[1].clip", "NaN"));
}

#[test]
fn factors_are_as_many_as_components() {
    let short = misfit(|it| it.observation[0].scale = Factor::Each(vec![2.0, 0.25]));
    assert_eq!(short, found_in("observation[0].scale", "2 factors"));
}
