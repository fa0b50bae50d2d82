use std::f32::consts::TAU;

use super::*;
use crate::contract::tests::{contract, robot};
use crate::contract::{Contract, Factor};
use crate::{Command, RobotState};

const TERRAIN: [f32; 6] = [-0.5, -0.6, f32::NAN, -0.7, -0.4, f32::NAN];

fn patch(order: HeightOrder) -> HeightPatch {
    HeightPatch { back_m: 0.1, front_m: 0.1, half_width_m: 0.05, resolution_m: 0.1, offset_m: 0.5, order }
}

/// Position and velocity of joint j are 0.1·(j + 1) and −(j + 1), contact on the left foot alone.
fn state(forward: f32) -> RobotState<'static> {
    RobotState {
        time_s: 0.0,
        joint_position_rad: (&[0.1_f32, 0.2, 0.3, 0.4][..]).into(),
        joint_velocity_rad_per_s: (&[-1.0_f32, -2.0, -3.0, -4.0][..]).into(),
        joint_torque_nm: (&[10.0_f32, 20.0, 30.0, 40.0][..]).into(),
        base_linear_velocity_m_per_s: [forward, 0.1, 0.2],
        base_angular_velocity_rad_per_s: [0.3, 0.4, 0.5],
        projected_gravity: [0.0, 0.1, -0.99],
        foot_contact: (&[1_u8, 0][..]).into(),
        terrain_m: (&TERRAIN[..]).into(),
    }
}

fn observer(terms: Vec<ObservationTerm>) -> Observer {
    Observer::new(&Contract { observation: terms, ..contract() }, &robot()).unwrap()
}

fn observed(observer: &mut Observer, forward: f32) -> Vec<f32> {
    let mut out = vec![f32::NAN; observer.len()];
    let command = Command::velocity(0.6, -0.1, 0.2);
    observer.write(&state(forward), &command, &[1.0, 2.0, 3.0, 4.0], &mut out).unwrap();
    out
}

fn one(term: ObservationTerm) -> Vec<f32> {
    observed(&mut observer(vec![term]), 0.5)
}

fn assert_near(found: &[f32], wanted: &[f32]) {
    let near = found.len() == wanted.len() && found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near, "{found:?}, wanted {wanted:?}");
}

#[test]
fn each_term_is_what_its_name_says() {
    let of = |term| one(ObservationTerm::new(term, 2.0));
    assert_near(&of(Term::BaseLinearVelocity), &[1.0, 0.2, 0.4]);
    assert_near(&of(Term::BaseAngularVelocity), &[0.6, 0.8, 1.0]);
    assert_near(&of(Term::ProjectedGravity), &[0.0, 0.2, -1.98]);
    assert_near(&of(Term::VelocityCommand), &[1.2, -0.2, 0.4]);
    assert_near(&of(Term::LastAction), &[2.0, 4.0, 6.0, 8.0]);
    assert_near(&of(Term::FootContact), &[2.0, 0.0]);
}

#[test]
fn joints_come_in_the_policys_order() {
    let of = |term| one(ObservationTerm::new(term, 1.0));
    // R_KNEE, L_HIP, L_KNEE, R_HIP, less −0.4, 0.1, 0.2, −0.3.
    assert_near(&of(Term::JointPosition), &[0.8, 0.0, 0.0, 0.6]);
    assert_near(&of(Term::JointVelocity), &[-4.0, -1.0, -2.0, -3.0]);
    assert_near(&of(Term::JointTorque), &[40.0, 10.0, 20.0, 30.0]);
}

#[test]
fn factors_may_differ_by_component_and_the_clip_comes_first() {
    let scale = Factor::Each(vec![2.0, 2.0, 0.25]);
    let command =
        ObservationTerm { scale, clip: Some(0.15), ..ObservationTerm::new(Term::VelocityCommand, 1.0) };
    assert_near(&one(command), &[0.3, -0.2, 0.0375]);
}

#[test]
fn no_value_exceeds_a_hundred() {
    assert_near(&one(ObservationTerm::new(Term::JointVelocity, 50.0)), &[-100.0, -50.0, -100.0, -100.0]);
}

#[test]
fn heights_are_measured_from_half_a_metre_below_the_base() {
    // Left column: −0.5, unknown, −0.4; right column: −0.6, −0.7, unknown. Unknown is the last behind.
    let of = |order| one(ObservationTerm::heights(patch(order), 5.0));
    assert_near(&of(HeightOrder::RowsFromLeft), &[0.0, 0.5, 0.0, 1.0, -0.5, 1.0]);
    assert_near(&of(HeightOrder::RowsFromRight), &[0.5, 0.0, 1.0, 0.0, 1.0, -0.5]);
    assert_near(&of(HeightOrder::ColumnsFromRight), &[0.5, 1.0, 1.0, 0.0, 0.0, -0.5]);
}

#[test]
fn heights_unknown_behind_take_the_first_ahead_and_none_at_all_is_zero() {
    let patch = patch(HeightOrder::RowsFromLeft);
    let mut out = [0.0; 6];
    patch.write(&[f32::NAN, f32::NAN, f32::NAN, f32::NAN, -0.2, f32::NAN], &mut out);
    assert_near(&out, &[-0.3, 0.0, -0.3, 0.0, -0.3, 0.0]);
}

#[test]
fn heights_are_clipped_to_a_metre() {
    let patch = HeightPatch { offset_m: 2.0, ..patch(HeightOrder::RowsFromLeft) };
    let values = one(ObservationTerm { clip: None, ..ObservationTerm::heights(patch, 5.0) });
    assert_near(&values, &[-5.0; 6]);
}

#[test]
fn the_phase_counts_ticks_and_starts_again_with_a_reset() {
    let mut observer = observer(vec![ObservationTerm::gait_phase(0.5)]);
    observer.set_initial_phase(0.25);
    for run in 0..2 {
        observer.reset();
        for tick in 0..60_u8 {
            let angle = TAU * (f32::from(tick) * 0.02 / 0.5 + 0.25);
            let found = observed(&mut observer, 0.0);
            let near = (found[0] - angle.sin()).abs() < 1e-4 && (found[1] - angle.cos()).abs() < 1e-4;
            assert!(near, "run {run}, tick {tick}: {found:?}");
        }
    }
}

fn with_history(term: Term, history: usize) -> ObservationTerm {
    ObservationTerm { history, ..ObservationTerm::new(term, 1.0) }
}

#[test]
fn a_history_begins_full_of_the_first_value_and_forgets_on_reset() {
    let mut observer = observer(vec![with_history(Term::BaseLinearVelocity, 3)]);
    let forward = |values: Vec<f32>| [values[0], values[3], values[6]];
    for _ in 0..2 {
        observer.reset();
        assert_eq!(forward(observed(&mut observer, 1.0)), [1.0, 1.0, 1.0]);
        assert_eq!(forward(observed(&mut observer, 2.0)), [1.0, 1.0, 2.0]);
        assert_eq!(forward(observed(&mut observer, 3.0)), [1.0, 2.0, 3.0]);
        assert_eq!(forward(observed(&mut observer, 4.0)), [2.0, 3.0, 4.0]);
    }
}

#[test]
fn histories_lie_term_by_term_or_tick_by_tick() {
    let terms = vec![with_history(Term::FootContact, 2), with_history(Term::BaseLinearVelocity, 2)];
    let mut by_term = observer(terms.clone());
    let contract = Contract { history_layout: HistoryLayout::TimeMajor, observation: terms, ..contract() };
    let mut by_tick = Observer::new(&contract, &robot()).unwrap();
    for observer in [&mut by_term, &mut by_tick] {
        observed(observer, 1.0);
    }
    assert_near(&observed(&mut by_term, 2.0), &[1.0, 0.0, 1.0, 0.0, 1.0, 0.1, 0.2, 2.0, 0.1, 0.2]);
    assert_near(&observed(&mut by_tick, 2.0), &[1.0, 0.0, 1.0, 0.1, 0.2, 1.0, 0.0, 2.0, 0.1, 0.2]);
}

#[test]
fn a_state_of_another_shape_is_refused_by_field() {
    let mut observer = observer(vec![ObservationTerm::heights(patch(HeightOrder::default()), 5.0)]);
    let mut out = vec![0.0; observer.len()];
    let state = RobotState { terrain_m: (&TERRAIN[..5]).into(), ..state(0.0) };
    let error = observer.write(&state, &Command::velocity(0.0, 0.0, 0.0), &[0.0; 4], &mut out).unwrap_err();
    assert_eq!(error.message.as_str(), "terrain_m: found 5 values, wanted 6");
}

#[test]
fn only_what_terms_read_is_needed() {
    let needs = observer(vec![ObservationTerm::new(Term::JointVelocity, 1.0)]).needs();
    assert!(needs.terrain.is_none() && !needs.foot_contacts && !needs.joint_torques);
    let terms = vec![
        ObservationTerm::heights(patch(HeightOrder::default()), 1.0),
        ObservationTerm::new(Term::FootContact, 1.0),
    ];
    let needs = observer(terms).needs();
    assert!(needs.terrain.is_some() && needs.foot_contacts && !needs.joint_torques);
}

#[test]
fn a_term_that_lacks_or_has_too_much_is_refused_by_field() {
    let refused = |term: ObservationTerm| {
        let contract = Contract { observation: vec![term], ..contract() };
        Observer::new(&contract, &robot()).unwrap_err().field
    };
    assert_eq!(refused(ObservationTerm::new(Term::Heights, 1.0)), "observation[0].patch");
    assert_eq!(refused(ObservationTerm::new(Term::GaitPhase, 1.0)), "observation[0].period_s");
    let odd = ObservationTerm { period_s: Some(0.5), ..ObservationTerm::new(Term::JointVelocity, 1.0) };
    assert_eq!(refused(odd), "observation[0].period_s");
    let uneven = HeightPatch { front_m: 0.13, ..patch(HeightOrder::default()) };
    assert_eq!(refused(ObservationTerm::heights(uneven, 1.0)), "observation[0].patch.front_m");
    assert_eq!(refused(with_history(Term::FootContact, 0)), "observation[0].history");
    let wide = HeightPatch { half_width_m: 0.6, ..patch(HeightOrder::default()) };
    assert_eq!(refused(ObservationTerm::heights(wide, 1.0)), "observation[0].patch.half_width_m");
}

#[test]
fn time_major_histories_are_equally_long() {
    let contract = Contract {
        history_layout: HistoryLayout::TimeMajor,
        observation: vec![with_history(Term::FootContact, 2), with_history(Term::LastAction, 3)],
        ..contract()
    };
    assert_eq!(Observer::new(&contract, &robot()).unwrap_err().field, "observation[1].history");
}
