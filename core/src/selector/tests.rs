use super::*;

const FORWARD: Command = Command::velocity(0.6, 0.0, 0.0);

fn rule(name: &str, viability_threshold: f32) -> Rule {
    let command =
        CommandRange { kind: CommandKind::Velocity, forward_m_per_s: [0.4, 0.7], target_distance_m: None };
    Rule {
        name: name.into(),
        viability_threshold,
        hold_threshold: viability_threshold,
        cost_margin: 0.0,
        command,
        time_limit_s: 4.0,
        committed: false,
    }
}

fn selector() -> Selector {
    Selector::new(vec![rule("walk", 0.95), rule("ascend", 0.925), rule("descend", 0.925)])
}

fn choose(selector: &mut Selector, predictions: [(f32, f32); 3], command: &Command) -> (Choice, Vec<Reason>) {
    let predictions = predictions.map(|(viability, cot)| Prediction::of(viability, cot));
    let mut reasons = Vec::new();
    let choice = selector.choose(&predictions, command, Active::Stand, &mut reasons);
    (choice, reasons)
}

#[test]
fn two_skills_of_nearly_one_cost_do_not_win_by_turns_within_the_margin() {
    let walks = Command::velocity(0.6, 0.0, 0.0);
    let turns = |margin: f32| {
        let rules = [rule("walk", 0.95), rule("ascend", 0.925), rule("descend", 0.925)];
        let mut selector = Selector::new(rules.map(|rule| Rule { cost_margin: margin, ..rule }).into());
        let costs = [(0.52, 0.53), (0.54, 0.51), (0.51, 0.53), (0.55, 0.52)];
        costs.map(|(ascend, descend)| {
            choose(&mut selector, [(0.5, 0.3), (0.99, ascend), (0.98, descend)], &walks).0
        })
    };
    let [ascend, descend] = [Choice::Skill(1), Choice::Skill(2)];
    assert_eq!(turns(0.0), [ascend, descend, ascend, descend], "the paper's rule");
    assert_eq!(turns(0.1), [ascend; 4]);
}

#[test]
fn a_margin_keeps_no_winner_that_is_unviable_or_clearly_dearer() {
    let walks = Command::velocity(0.6, 0.0, 0.0);
    let rules = [rule("walk", 0.95), rule("ascend", 0.925), rule("descend", 0.925)];
    let mut selector = Selector::new(rules.map(|rule| Rule { cost_margin: 0.1, ..rule }).into());
    let mut winner = |predictions| choose(&mut selector, predictions, &walks).0;
    assert_eq!(winner([(0.5, 0.3), (0.99, 0.50), (0.98, 0.53)]), Choice::Skill(1));
    assert_eq!(winner([(0.97, 0.44), (0.99, 0.50), (0.98, 0.53)]), Choice::Skill(0), "12 % cheaper");
    assert_eq!(winner([(0.5, 0.44), (0.9, 0.45), (0.98, 0.53)]), Choice::Skill(2), "unviable");
    assert_eq!(winner([(0.5, 0.44), (0.9, 0.45), (0.9, 0.53)]), Choice::Stop);
}

#[test]
fn the_cheapest_viable_skill_wins() {
    let (choice, _) = choose(&mut selector(), [(0.99, 0.2), (0.99, 0.9), (0.99, 0.5)], &FORWARD);
    assert_eq!(choice, Choice::Skill(0));
    let (choice, reasons) = choose(&mut selector(), [(0.94, 0.2), (0.99, 0.9), (0.93, 0.5)], &FORWARD);
    assert_eq!(choice, Choice::Skill(2), "walk is cheaper but below its threshold");
    assert_eq!(reasons[0], Reason::BelowThreshold { threshold: 0.95 });
}

#[test]
fn a_viability_at_its_threshold_is_viable_and_of_equal_costs_the_first_wins() {
    let (choice, _) = choose(&mut selector(), [(0.95, 0.5), (0.925, 0.5), (0.99, 0.5)], &FORWARD);
    assert_eq!(choice, Choice::Skill(0));
}

#[test]
fn with_no_viable_skill_it_stops() {
    let (choice, _) = choose(&mut selector(), [(0.0, 0.2), (0.9, 0.9), (0.92, 0.5)], &FORWARD);
    assert_eq!(choice, Choice::Stop);
}

#[test]
fn a_cost_that_is_not_positive_is_not_viable_but_stays_in_service() {
    let mut selector = selector();
    for _ in 0..10 {
        let (choice, reasons) = choose(&mut selector, [(0.99, 0.0), (0.99, -0.1), (0.99, 0.5)], &FORWARD);
        assert_eq!(choice, Choice::Skill(2));
        assert_eq!(reasons[..2], [Reason::CotNotPositive; 2]);
    }
    assert_eq!(selector.out_of_service(0), None);
}

#[test]
fn three_unusable_predictions_in_a_row_take_a_skill_out_of_service() {
    for bad in [(f32::NAN, 0.2), (0.99, f32::INFINITY), (1.01, 0.2), (-0.01, 0.2)] {
        let mut selector = selector();
        let mut tick = |walk| choose(&mut selector, [walk, (0.99, 0.9), (0.0, 0.5)], &FORWARD);
        for _ in 0..2 {
            assert_eq!(tick(bad), (Choice::Skill(1), tick_reasons(Reason::Unusable)));
        }
        assert_eq!(tick((0.99, 0.2)).0, Choice::Skill(0), "a usable one in between counts anew");
        for _ in 0..2 {
            tick(bad);
        }
        assert_eq!(tick(bad).1[0], Reason::PredictionsFailed);
        assert_eq!(tick((0.99, 0.2)), (Choice::Skill(1), tick_reasons(Reason::PredictionsFailed)));
    }
}

fn tick_reasons(walk: Reason) -> Vec<Reason> {
    vec![walk, Reason::Viable { threshold: 0.925 }, Reason::BelowThreshold { threshold: 0.925 }]
}

#[test]
fn a_command_outside_the_declared_range_is_not_viable() {
    let viable = [(0.99, 0.2), (0.99, 0.9), (0.99, 0.5)];
    for (forward, inside) in [(0.39, false), (0.4, true), (0.7, true), (0.71, false), (-0.5, false)] {
        let (choice, reasons) = choose(&mut selector(), viable, &Command::velocity(forward, 0.0, 0.0));
        assert_eq!(choice != Choice::Stop, inside, "{forward} m/s: {reasons:?}");
    }
    let mut target = FORWARD;
    target.kind = CommandKind::PositionTarget;
    assert_eq!(choose(&mut selector(), viable, &target).1, [Reason::CommandKind; 3]);
}

#[test]
fn a_skill_added_with_lower_cost_wins_and_changes_no_other_verdict() {
    let mut grown = selector();
    let (_, before) = choose(&mut grown, [(0.99, 0.3), (0.99, 0.9), (0.1, 0.5)], &FORWARD);
    let mut rules = grown.rules().to_vec();
    rules.push(rule("trot", 0.95));
    let mut grown = Selector::new(rules);
    let predictions = [(0.99, 0.3), (0.99, 0.9), (0.1, 0.5), (0.99, 0.25)];
    let predictions = predictions.map(|(viability, cot)| Prediction::of(viability, cot));
    let mut reasons = Vec::new();
    assert_eq!(grown.choose(&predictions, &FORWARD, Active::Stand, &mut reasons), Choice::Skill(3));
    assert_eq!(reasons[..3], before[..]);
}

#[test]
fn only_a_command_without_any_motion_is_zero() {
    assert!(is_zero(&Command::velocity(0.0, -0.0, 0.0)));
    assert!(!is_zero(&Command::velocity(0.0, 0.0, 0.2)));
    assert!(!is_zero(&Command::velocity(-0.1, 0.0, 0.0)));
}

#[test]
fn terrain_unlike_the_training_s_is_not_viable_however_sure_the_prediction() {
    let mut selector = selector();
    let mut reasons = Vec::new();
    let strange =
        |strangeness: f32| Prediction { strangeness: Some(strangeness), ..Prediction::of(0.99, 0.2) };
    for strangeness in [1.01, 40.0, f32::NAN, f32::INFINITY, -1.0] {
        let predictions = [strange(strangeness), strange(1.0), Prediction::of(0.99, 0.5)];
        assert_eq!(
            selector.choose(&predictions, &FORWARD, Active::Stand, &mut reasons),
            Choice::Skill(1),
            "{strangeness}"
        );
        assert!(matches!(reasons[0], Reason::UnknownTerrain { .. }), "{strangeness}: {}", reasons[0]);
        assert!(!reasons[0].is_out_of_service());
    }
}

#[test]
fn a_skill_that_drives_is_held_to_its_own_threshold_and_others_are_not() {
    let held = |name| Rule { hold_threshold: 0.5, ..rule(name, 0.9) };
    let mut selector = Selector::new(vec![held("walk"), held("climb")]);
    let predictions = [Prediction::of(0.7, 0.5), Prediction::of(0.7, 0.2)];
    let mut reasons = Vec::new();
    let mut choose = |predictions: &[Prediction], drives| {
        (selector.choose(predictions, &FORWARD, drives, &mut reasons), reasons.clone())
    };
    assert_eq!(choose(&predictions, Active::Stand).0, Choice::Stop);
    let (choice, reasons) = choose(&predictions, Active::Skill(0));
    assert_eq!(choice, Choice::Skill(0));
    let wanted = [Reason::Viable { threshold: 0.5 }, Reason::BelowThreshold { threshold: 0.9 }];
    assert_eq!(reasons, wanted);
    let sunk = [Prediction::of(0.4, 0.5), predictions[1]];
    assert_eq!(choose(&sunk, Active::Skill(0)).0, Choice::Stop);
    // Having won is not driving: while the window has not agreed yet, the threshold to begin counts.
    assert_eq!(choose(&predictions, Active::Stand).0, Choice::Stop);
}

#[test]
fn holding_follows_a_threshold_that_is_set_unless_it_is_lower() {
    let mut same = rule("walk", 0.9);
    same.set_threshold(0.95);
    assert_eq!((same.viability_threshold, same.hold_threshold), (0.95, 0.95));
    let mut lower = Rule { hold_threshold: 0.8, ..rule("walk", 0.9) };
    lower.set_threshold(0.95);
    assert_eq!(lower.hold_threshold, 0.8);
    lower.set_threshold(0.7);
    assert_eq!(lower.hold_threshold, 0.7);
}
