use std::{collections::BTreeMap, path::Path as FilePath, sync::OnceLock};

use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::observation::{ObservationTerm, Term};

use super::*;
use crate::{sensing::SensorNoise, threads::with_threads};

fn robot() -> Arc<RobotModel> {
    let robots = FilePath::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
    Arc::new(RobotModel::load(&robots, "anymal_d").expect("the shipped robot"))
}

/// Flat and stairs, few of each.
fn small() -> EnvironmentConfig {
    let share = |kind, size_m| TerrainShare::new(kind, 1.0, size_m);
    EnvironmentConfig {
        levels: 3,
        variants: 2,
        poses: 2,
        initial_level: 2,
        terrain: vec![share(TerrainKind::Flat, [0.0, 0.0]), share(TerrainKind::StairsUp, [0.05, 0.2])],
        ..EnvironmentConfig::default()
    }
}

fn ground_of(config: EnvironmentConfig) -> Arc<TrainingGround> {
    Arc::new(TrainingGround::new(config, &robot(), &BTreeMap::new(), 7).expect("a sound configuration"))
}

fn ground() -> &'static Arc<TrainingGround> {
    static GROUND: OnceLock<Arc<TrainingGround>> = OnceLock::new();
    GROUND.get_or_init(|| ground_of(small()))
}

/// Without pushes, noise, variation or latency, on flat ground.
fn calm() -> EnvironmentConfig {
    EnvironmentConfig {
        terrain: small().terrain[..1].to_vec(),
        latency_ticks: [0, 0],
        start: StartRules { moving_share: 0.0, ..StartRules::default() },
        push: PushRules { speed_m_per_s: [0.0, 0.0], ..PushRules::default() },
        noise: SensorNoise::NONE,
        ..small()
    }
}

/// Actions that shake every joint differently.
fn shaking(environment: &Environment, tick: usize) -> Vec<f32> {
    (0..environment.action_len()).map(|joint| 0.4 * ((tick * 3 + joint * 5) as f32 * 0.37).sin()).collect()
}

fn seen(environment: &Environment) -> (Vec<f32>, Vec<f32>) {
    let mut policy = vec![f32::NAN; environment.observation_len()];
    let mut privileged = vec![f32::NAN; environment.privileged_len()];
    environment.observe(&mut policy, &mut privileged);
    (policy, privileged)
}

/// Everything that an environment gives in some ticks, as bits.
fn record(environment: &mut Environment, ticks: usize) -> Vec<u32> {
    let mut bits = Vec::new();
    for tick in 0..ticks {
        let action = shaking(environment, tick);
        let step = environment.step(&action);
        let (policy, privileged) = seen(environment);
        bits.extend(policy.iter().chain(&privileged).chain([&step.reward]).map(|value| value.to_bits()));
        bits.push(environment.level());
        if step.end.is_some() {
            environment.begin_episode();
        }
    }
    bits
}

#[test]
fn the_same_seed_index_segment_and_level_give_the_same_bytes_on_any_number_of_threads() {
    use rayon::prelude::*;
    let run = |threads: usize| -> Vec<Vec<u32>> {
        with_threads(threads, || {
            let ground = ground_of(small());
            let one = |index: u32| {
                let mut environment = Environment::new(&ground, index);
                // A past that must not matter.
                record(&mut environment, 7 * threads + index as usize);
                environment.restart(5, 1);
                record(&mut environment, 150)
            };
            (0..6).into_par_iter().map(one).collect()
        })
        .expect("threads")
    };
    let (one, two) = (run(1), run(2));
    for (index, (first, second)) in one.iter().zip(&two).enumerate() {
        let differs = first.iter().zip(second).position(|(a, b)| a != b);
        assert_eq!(differs, None, "environment {index}");
        assert_eq!(first.len(), second.len(), "environment {index}");
    }
    assert_ne!(one[1], one[2], "environments of one terrain differ");
}

#[test]
fn segments_differ() {
    let run = |segment: u64| {
        let mut environment = Environment::new(ground(), 0);
        environment.restart(segment, 0);
        record(&mut environment, 30)
    };
    assert_ne!(run(0), run(1));
}

#[test]
fn time_that_is_up_is_a_time_out_and_a_base_on_the_ground_a_termination() {
    let mut environment = Environment::new(&ground_of(calm()), 0);
    // The default position is the stand: it stands until time is up.
    let still = vec![0.0; environment.action_len()];
    let mut ticks = 0;
    let end = loop {
        ticks += 1;
        if let Some(end) = environment.step(&still).end {
            break end;
        }
    };
    assert_eq!((end, ticks), (End::TimedOut, environment.episode.ticks));
    environment.begin_episode();
    // Legs drawn up as far as they go: hips back, knees bent.
    let folded: Vec<f32> = (0..12).map(|joint| [0.0, 2.0, -4.0][joint % 3]).collect();
    let fallen = (0..200).find_map(|_| {
        let step = environment.step(&folded);
        step.end.map(|end| (end, step.reward, environment.reward_terms().last().copied()))
    });
    let (end, reward, last) = fallen.expect("it falls");
    assert_eq!(end, End::Terminated);
    assert_eq!(last, Some(("termination", -1.0)));
    assert!(reward < 0.0, "{reward}");
}

#[test]
fn the_end_of_the_tile_is_a_time_out() {
    let mut environment = Environment::new(&ground_of(calm()), 0);
    environment.begin_episode();
    let map = &ground().stage(0, 0, 0).terrain;
    let edge_m = map.max_m[0] - tick::MAP_MARGIN_M;
    let height_m = robot().description.stand_height_m as f32;
    let ahead = BasePose::from_yaw([edge_m - 0.01, 0.0, height_m], 0.0);
    environment.plant.place(&ahead, &robot().stand_position_rad());
    environment.plant.push([1.0, 0.0, 0.0]);
    let still = vec![0.0; environment.action_len()];
    let end = (0..5).find_map(|_| environment.step(&still).end);
    assert_eq!(end, Some(End::TimedOut));
    assert!(environment.tick < environment.episode.ticks);
}

#[test]
fn standing_still_leads_down_and_a_short_first_episode_leads_nowhere() {
    let mut environment = Environment::new(&ground_of(calm()), 0);
    let still = vec![0.0; environment.action_len()];
    environment.restart(0, 2);
    let mut levels = vec![environment.level()];
    let mut halves = vec![environment.episode.ticks >= 225];
    for _ in 0..3 {
        while environment.step(&still).end.is_none() {}
        environment.begin_episode();
        levels.push(environment.level());
        halves.push(environment.episode.ticks >= 225);
    }
    for (pair, counts) in levels.windows(2).zip(halves) {
        assert_eq!(pair[1], pair[0].saturating_sub(u32::from(counts)), "{levels:?}");
    }
    assert_eq!(levels.last(), Some(&0));
}

#[test]
fn without_noise_policy_and_critic_see_the_plants_own_measurements() {
    let mut environment = Environment::new(&ground_of(calm()), 0);
    for tick in 0..20 {
        let action = shaking(&environment, tick);
        environment.step(&action);
    }
    let (policy, privileged) = seen(&environment);
    assert_eq!(policy, privileged[..policy.len()]);
    let measured = environment.plant().measure();
    for axis in 0..3 {
        assert_eq!(policy[axis], 2.0 * measured.base_linear_velocity[axis]);
        assert_eq!(policy[6 + axis], measured.projected_gravity[axis]);
    }
    let stand = robot().stand_position_rad();
    for joint in 0..12 {
        assert_eq!(policy[12 + joint], measured.joint_position_rad[joint] - stand[joint]);
        assert_eq!(policy[24 + joint], 0.05 * measured.joint_velocity_rad_per_s[joint]);
    }
    assert_eq!(policy[36..48], shaking(&environment, 19), "the last action");
    let height = 5.0 * (measured.base.position_m[2] - 0.5);
    assert!(policy[48..].iter().all(|value| (value - height).abs() < 1e-4), "flat ground");
    assert_eq!(policy.len(), 235);
}

#[test]
fn noise_is_the_policys_alone_and_drawn_once_a_tick() {
    let environment = Environment::new(ground(), 1);
    let ((policy, privileged), again) = (seen(&environment), seen(&environment));
    assert_eq!(policy, again.0);
    let differing = policy.iter().zip(&privileged).filter(|(noisy, truth)| noisy != truth).count();
    // Command and last action have no noise.
    assert!((200..=235 - 15).contains(&differing), "{differing}");
    let heights = policy[48..].iter().zip(&privileged[48..235]);
    let worst = heights.map(|(noisy, truth)| (noisy - truth).abs()).fold(0.0, f32::max);
    assert!((0.4..=0.5 + 1e-4).contains(&worst), "10 cm times 5: {worst}");
}

#[test]
fn a_blind_policys_critic_still_sees_the_ground() {
    let mut contract = standard_contract(&robot());
    contract.observation.retain(|term| term.term != Term::Heights);
    contract.observation.push(ObservationTerm::new(Term::FootContact, 1.0));
    let config = EnvironmentConfig { contract: Some(contract), ..calm() };
    let environment = Environment::new(&ground_of(config), 0);
    assert_eq!(environment.observation_len(), 52);
    // Five drawn or measured numbers, twelve of the feet, 187 heights.
    assert_eq!(environment.privileged_len(), 52 + 5 + 12 + 187);
    let (policy, privileged) = seen(&environment);
    assert_eq!(policy[48..], [1.0; 4], "it stands");
    assert!(privileged.iter().all(|value| value.is_finite()));
}

#[test]
fn an_expert_that_nobody_handed_over_is_refused_by_name() {
    let config =
        EnvironmentConfig { experts: BTreeMap::from([(TerrainKind::Flat, "walk".to_owned())]), ..small() };
    let refused = TrainingGround::new(config, &robot(), &BTreeMap::new(), 1).err().expect("no such expert");
    let text = refused.to_string();
    assert!(text.contains("environment.experts.flat") && text.contains("walk"), "{text}");

    let led = Some(LedRules { by: "trot".to_owned(), to_m: [0.5, 0.7] });
    let flat = vec![TerrainShare { led: led.clone(), ..small().terrain[0].clone() }];
    let refused = EnvironmentConfig { terrain: flat, ..small() }.check().expect_err("nothing to lead to");
    assert!(refused.to_string().contains("environment.terrain[0].led"), "{refused}");
    let terrain = vec![TerrainShare { led, ..small().terrain[1].clone() }];
    let config = EnvironmentConfig { terrain, ..small() };
    let refused = TrainingGround::new(config, &robot(), &BTreeMap::new(), 1).err().expect("no such skill");
    let text = refused.to_string();
    assert!(text.contains("environment.terrain[0].led.by") && text.contains("trot"), "{text}");
}

#[test]
fn a_contract_that_misfits_is_said_once() {
    let mut contract = super::standard_contract(&robot());
    contract.joints[0] = "LF_HAAA".into();
    let config = EnvironmentConfig { contract: Some(contract), ..small() };
    let error = TrainingGround::new(config, &robot(), &BTreeMap::new(), 1).err().unwrap();
    assert!(error.to_string().starts_with("environment.contract.joints[0]: found"), "{error}");
    assert!(std::error::Error::source(&error).is_none(), "a report of the chain would say it twice");
}

#[test]
fn levels_get_harder_and_keep_inside_their_range() {
    let ground = ground();
    let sizes: Vec<f32> = (0..3)
        .flat_map(|level| [0, 1].map(|variant| ground.stage(1, level, variant).terrain.size_m))
        .collect();
    assert!(sizes.windows(2).all(|pair| pair[0] < pair[1]), "{sizes:?}");
    assert!(sizes[0] >= 0.05 && sizes[5] <= 0.2 && sizes[5] > 0.17, "{sizes:?}");
}

#[test]
fn an_observed_clock_starts_where_the_expert_starts() {
    let mut contract = super::ground::standard_contract(&robot());
    contract.observation.insert(0, ObservationTerm::gait_phase(0.5));
    let ground = ground_of(EnvironmentConfig { contract: Some(contract), ..calm() });
    let mut phases = Vec::new();
    for index in 0..4 {
        let mut environment = Environment::new(&ground, index);
        environment.begin_episode();
        let (policy, _) = seen(&environment);
        let turns = policy[0].atan2(policy[1]) / std::f32::consts::TAU;
        let difference = turns - environment.episode.phase;
        assert!(
            (difference - difference.round()).abs() < 1e-4,
            "{turns} against {}",
            environment.episode.phase
        );
        phases.push(environment.episode.phase);
    }
    assert!(phases.iter().any(|phase| (phase - phases[0]).abs() > 0.01), "{phases:?}");
}

#[test]
fn a_robot_that_acts_in_the_mirror_is_the_mirror_image() {
    let ground = ground_of(calm());
    let [mut original, mut image] = [0, 0].map(|index| Environment::new(&ground, index));
    let mirror = original.mirror().expect("the shipped robot is its own mirror image").clone();
    let mut mirrored = vec![0.0; original.action_len()];
    let mut reflected = vec![0.0; original.observation_len()];
    for tick in 0..25 {
        let action = shaking(&original, tick);
        mirror.action(&action, &mut mirrored);
        original.step(&action);
        image.step(&mirrored);
        let [(first, _), (second, _)] = [seen(&original), seen(&image)];
        mirror.observation(&first, &mut reflected);
        for (at, (found, wanted)) in second.iter().zip(&reflected).enumerate() {
            assert!((found - wanted).abs() < 0.02, "tick {tick}, value {at}: {found}, wanted {wanted}");
        }
        let different = first.iter().zip(&second).any(|(a, b)| (a - b).abs() > 0.05);
        assert!(tick < 5 || different, "tick {tick}: nothing sets left apart from right");
    }
}

#[test]
fn twice_in_the_mirror_is_as_before_in_every_layout() {
    use vocaloco_plugin_api::{
        contract::Contract,
        observation::{HeightOrder, HistoryLayout},
    };
    let robot = robot();
    let all = |order, layout| -> Contract {
        let mut contract = super::ground::standard_contract(&robot);
        contract.history_layout = layout;
        contract.observation.push(ObservationTerm::new(Term::FootContact, 1.0));
        contract.observation.push(ObservationTerm::gait_phase(0.5));
        for term in &mut contract.observation {
            term.history = 2;
            if let Some(patch) = &mut term.patch {
                patch.order = order;
            }
        }
        contract
    };
    for order in [HeightOrder::RowsFromRight, HeightOrder::RowsFromLeft, HeightOrder::ColumnsFromRight] {
        for layout in [HistoryLayout::TermMajor, HistoryLayout::TimeMajor] {
            let contract = all(order, layout);
            let len =
                vocaloco_plugin_api::observation::Observer::new(&contract, &robot.description).unwrap().len();
            let mirror = Mirror::new(&contract, &robot.description).unwrap();
            let original: Vec<f32> = (0..len).map(|at| at as f32).collect();
            let (mut once, mut twice) = (vec![0.0; len], vec![f32::NAN; len]);
            mirror.observation(&original, &mut once);
            mirror.observation(&once, &mut twice);
            assert_eq!(twice, original, "{order:?}, {layout:?}");
            assert_ne!(once, original);
        }
    }
    let mut lopsided = super::ground::standard_contract(&robot);
    lopsided.action.default_position_rad.insert("LF_HAA".to_owned(), 0.3);
    assert_eq!(Mirror::new(&lopsided, &robot.description), None);
}

/// A policy that takes targets half a metre ahead, one second for each, on calm flat ground.
fn aiming() -> EnvironmentConfig {
    let mut contract = standard_contract(&robot());
    for term in &mut contract.observation {
        if term.term == Term::VelocityCommand {
            *term = ObservationTerm::new(Term::PositionTarget, 1.0);
        }
    }
    let target = Some(TargetRules { distance_m: [0.5, 0.5], time_s: [1.0, 1.0] });
    EnvironmentConfig { contract: Some(contract), target, ..calm() }
}

/// Where the target stands in the observation of [`aiming`].
const TARGET: std::ops::Range<usize> = 9..13;

fn until_the_end(environment: &mut Environment) -> End {
    let still = vec![0.0; environment.action_len()];
    (0..500).find_map(|_| environment.step(&still).end).expect("an end")
}

#[test]
fn a_target_lies_straight_ahead_and_its_time_ends_the_episode() {
    let mut environment = Environment::new(&ground_of(aiming()), 0);
    let seen_target = |environment: &Environment| seen(environment).0[TARGET].to_vec();
    environment.begin_episode();
    let first = seen_target(&environment);
    for (found, wanted) in first.iter().zip([0.5, 0.0, 0.0, 1.0]) {
        assert!((found - wanted).abs() < 1e-5, "{first:?}");
    }
    assert_eq!(until_the_end(&mut environment), End::Finished);
    let last = seen_target(&environment);
    assert!(last[3].abs() < 1e-4 && (last[0] - 0.5).abs() < 0.05, "it stood: {last:?}");
    assert_eq!(environment.tick, 50);
}

#[test]
fn a_first_episodes_target_has_the_time_that_the_episode_has() {
    let config = EnvironmentConfig {
        target: Some(TargetRules { distance_m: [0.5, 0.5], time_s: [4.0, 4.0] }),
        ..aiming()
    };
    let environment = Environment::new(&ground_of(config), 0);
    let left_s = seen(&environment).0[TARGET][3];
    assert!((left_s - 0.02 * environment.episode.ticks as f32).abs() < 1e-4 && left_s < 4.0, "{left_s} s");
}

#[test]
fn who_is_at_the_target_in_the_end_rises_unless_the_base_has_touched() {
    let level_after = |moved_m: f32, touched: bool| {
        let mut environment = Environment::new(&ground_of(aiming()), 0);
        environment.begin_episode();
        environment.level = 1;
        let base = environment.plant.measure().base;
        let ahead = BasePose::from_yaw([0.0; 3], base.yaw()).vector_in_world([moved_m, 0.0, 0.0]);
        let position_m = [0, 1, 2].map(|axis| base.position_m[axis] + ahead[axis]);
        environment.plant.place(&BasePose { position_m, ..base }, &robot().stand_position_rad());
        until_the_end(&mut environment);
        environment.base_has_touched |= touched;
        environment.begin_episode();
        environment.level()
    };
    assert_eq!([level_after(0.5, false), level_after(0.5, true), level_after(0.1, false)], [2, 1, 0]);
}

#[test]
fn targets_and_velocities_are_not_taken_for_one_another() {
    let refused = |config: EnvironmentConfig| {
        let refused = TrainingGround::new(config, &robot(), &BTreeMap::new(), 1);
        refused.err().expect("a refusal").to_string()
    };
    let without = refused(EnvironmentConfig { target: None, ..aiming() });
    assert!(without.starts_with("environment.target: found nothing"), "{without}");
    let blind = refused(EnvironmentConfig { contract: None, ..aiming() });
    assert!(blind.starts_with("environment.target: found a target"), "{blind}");
}

#[test]
fn an_expert_is_told_a_velocity_that_falls_near_the_target() {
    let told = |x_m: f32| {
        let command = Command {
            kind: vocaloco_plugin_api::CommandKind::PositionTarget,
            velocity: [0.6, 0.0, 0.2],
            target: [x_m, 0.1, 0.0, 3.0],
        };
        tick::for_an_expert(&command)
    };
    assert_eq!(told(1.2), Command::velocity(0.6, 0.0, 0.2));
    assert_eq!(told(0.25), Command::velocity(0.3, 0.0, 0.2));
    assert_eq!(told(-0.3), Command::velocity(0.0, 0.0, 0.2));
    let velocity = Command::velocity(0.5, 0.0, -0.1);
    assert_eq!(tick::for_an_expert(&velocity), velocity);
}

/// Ticks until legs drawn up as far as they go end an episode, and how.
fn fold(config: EnvironmentConfig) -> (u32, End) {
    let mut environment = Environment::new(&ground_of(config), 0);
    environment.begin_episode();
    let folded: Vec<f32> = (0..12).map(|joint| [0.0, 2.0, -4.0][joint % 3]).collect();
    let end = (0..200).find_map(|_| environment.step(&folded).end);
    (environment.tick, end.expect("it falls"))
}

#[test]
fn a_brief_contact_of_the_base_may_be_allowed_and_a_longer_one_not() {
    let (at_once, end) = fold(calm());
    assert_eq!(end, End::Terminated);
    let (later, end) = fold(EnvironmentConfig { base_contact_s: Some(0.1), ..calm() });
    assert_eq!(end, End::Terminated);
    assert!(later >= at_once + 5, "{later} ticks against {at_once}");
}

#[test]
fn a_base_far_below_its_start_has_fallen_before_it_touches() {
    let (touches, _) = fold(calm());
    let (falls, end) = fold(EnvironmentConfig { fall_m: Some(0.1), ..calm() });
    assert!(falls < touches && end == End::Terminated, "{falls} ticks against {touches}");
}

#[test]
fn walls_are_as_deep_as_asked_and_robots_stand_before_them() {
    let wall =
        TerrainShare { depth_m: Some([2.0, 3.0]), ..TerrainShare::new(TerrainKind::Wall, 1.0, [0.1, 0.4]) };
    let spawn = crate::spawn::SpawnRules { start_before_m: Some([0.5, 0.9]), ..calm().spawn };
    let ground = ground_of(EnvironmentConfig { terrain: vec![wall], spawn, ..calm() });
    let mut depths_m = Vec::new();
    for (level, variant) in [(0, 0), (1, 1), (2, 0)] {
        let stage = ground.stage(0, level, variant);
        let wall_m = stage.terrain.obstacle_x_m.expect("a wall is directed");
        for spawn in &stage.spawns {
            let before_m = wall_m - spawn.base.position_m[0];
            // Settling may move a robot by as much as the rules allow.
            assert!((0.4..=1.0).contains(&before_m), "level {level}: {before_m} m before");
        }
        let on_top = |ahead_m: f32| stage.terrain.height_m(wall_m + ahead_m, 0.0) > 0.05;
        assert!(on_top(0.01) && on_top(1.99) && !on_top(3.01), "level {level}");
        depths_m.push((0..300).filter(|centimetre| on_top(0.01 * *centimetre as f32)).count());
    }
    assert!(depths_m.iter().any(|depth| *depth != depths_m[0]), "{depths_m:?} cm");
}
