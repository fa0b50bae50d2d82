use super::*;

/// No two numbers alike.
fn deed() -> Deed {
    Deed {
        command: [0.6, 0.0, 0.2],
        velocity_in_yaw: [0.3, 0.4],
        vertical_m_per_s: -0.5,
        angular_velocity: [1.0, 2.0, 0.7],
        heading_error_rad: -0.3,
        projected_gravity: [0.1, -0.2, -0.97],
        height_error_m: -0.04,
        torque_squared: 1000.0,
        joint_acceleration_squared: 4e4,
        overspeed_rad_per_s: 1.5,
        action_change_squared: 0.8,
        power_per_weight: 0.12,
        air_time_s: -0.2,
        stumbles: 2.0,
        limb_contact_share: 0.25,
        base_contact_share: 0.75,
        aim: Some(Aim::new([0.0, 0.5, 0.0, 0.4], [0.3, 0.04], 0.7, 0.9)),
    }
}

fn scales(sigma: f32) -> Scales {
    Scales { sigma, target: TargetReward::default() }
}

#[test]
fn every_term_is_its_formula() {
    let wanted: [(RewardTerm, f32); 22] = [
        // |(0.3, −0.4)|² = 0.25, over σ = 0.5.
        (RewardTerm::LinearVelocity, (-0.5_f32).exp()),
        (RewardTerm::YawRate, (-0.5_f32).exp()),
        (RewardTerm::Heading, 0.09),
        (RewardTerm::VerticalVelocity, 0.25),
        (RewardTerm::RollPitchRate, 5.0),
        (RewardTerm::Orientation, 0.05),
        (RewardTerm::BaseHeight, 0.0016),
        (RewardTerm::Torque, 1000.0),
        (RewardTerm::JointAcceleration, 4e4),
        (RewardTerm::JointOverspeed, 1.5),
        (RewardTerm::ActionRate, 0.8),
        (RewardTerm::Power, 0.12),
        (RewardTerm::FootAirTime, -0.2),
        (RewardTerm::FootStumble, 2.0),
        (RewardTerm::LimbCollision, 0.25),
        (RewardTerm::Alive, 1.0),
        (RewardTerm::BaseCollision, 0.75),
        // Half a metre off, 4 cm/s of the 50 cm/s wanted.
        (RewardTerm::Target, 0.5),
        (RewardTerm::TargetApproach, 0.08),
        (RewardTerm::TargetWaiting, 0.0),
        (RewardTerm::TargetMotion, 0.0),
        (RewardTerm::TargetPosture, 0.0),
    ];
    for (term, wanted) in wanted {
        let found = deed().value(term, &scales(0.5));
        assert!((found - wanted).abs() <= 1e-5 * wanted.abs(), "{term:?}: {found}, wanted {wanted}");
    }
}

#[test]
fn a_reward_is_the_sum_of_its_terms_times_weight_and_time_step() {
    let config = RewardConfig { clip_negative: false, ..RewardConfig::default() };
    let mut judge = Judge::new(&config);
    let reward = judge.reward(&deed(), false);
    let wanted: f32 = RewardTerm::ALL
        .iter()
        .map(|(term, _, weight)| weight * deed().value(*term, &scales(0.25)) * 0.02)
        .sum();
    assert!((reward - wanted).abs() < 1e-6, "{reward}, wanted {wanted}");
    let sum: f32 = judge.terms().iter().map(|(_, value)| value).sum();
    assert!((reward - sum).abs() < 1e-6);
    let names: Vec<&str> = judge.terms().iter().map(|(id, _)| *id).collect();
    assert_eq!((names[0], names[16]), ("linear_velocity", "termination"));
}

#[test]
fn targets_stand_in_the_record_where_they_have_a_weight() {
    let weights = RewardWeights::default().with(RewardTerm::Target, 10.0);
    let config = RewardConfig { weights, ..RewardConfig::default() };
    let mut judge = Judge::new(&config);
    judge.reward(&deed(), false);
    let last: Vec<(&str, f32)> = judge.terms()[16..].to_vec();
    assert_eq!(last.iter().map(|(id, _)| *id).collect::<Vec<_>>(), ["target", "termination"]);
    assert!((last[0].1 - 0.1).abs() < 1e-6, "10/s of a half for 20 ms: {last:?}");
    let text = |config: &RewardConfig| serde_json::to_string(config).unwrap();
    assert!(text(&config).contains("\"target\":10.0"));
    assert!(!text(&RewardConfig::default()).contains("target"), "velocity skills are recorded as ever");
}

#[test]
fn a_negative_total_is_clipped_but_a_fall_still_costs() {
    let bad = Deed { vertical_m_per_s: 3.0, ..deed() };
    let mut judge = Judge::new(&RewardConfig::default());
    assert_eq!(judge.reward(&bad, false), 0.0);
    assert_eq!(judge.reward(&bad, true), -1.0);
    assert_eq!(judge.terms()[16], ("termination", -1.0));
    let mut judge = Judge::new(&RewardConfig { clip_negative: false, ..RewardConfig::default() });
    assert!(judge.reward(&bad, false) < -0.2);
}

#[test]
fn a_measurement_of_nan_is_not_taken_for_a_reward_of_zero() {
    let mut judge = Judge::new(&RewardConfig::default());
    assert!(judge.reward(&Deed { vertical_m_per_s: f32::NAN, ..deed() }, false).is_nan());
}

#[test]
fn weights_left_out_keep_their_defaults_and_unknown_ones_are_refused() {
    let config: RewardConfig = toml::from_str("[weights]\npower = -2.0").unwrap();
    assert_eq!(config.weights, RewardWeights::default().with(RewardTerm::Power, -2.0));
    let refused = toml::from_str::<RewardConfig>("[weights]\npowr = -2.0").unwrap_err();
    assert!(refused.to_string().contains("powr"), "{refused}");
}

#[test]
fn the_ids_are_those_of_the_file() {
    for (term, id, _) in RewardTerm::ALL {
        assert_eq!(serde_json::to_string(&term).unwrap(), format!("\"{id}\""));
    }
}
