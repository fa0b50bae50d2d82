//! What a learner is promised of the training environment and the shipped experts: an action asks for
//! the expert's torque, and an expert that drives through its own actions walks.

use std::{
    collections::BTreeMap,
    sync::{Arc, OnceLock},
};

use vocaloco_core::{plugin::PluginLibrary, robot::RobotModel};
use vocaloco_sim::{
    environment::{
        Environment, EnvironmentConfig, LedRules, PushRules, StartRules, TerrainShare, TrainingGround,
        speed::{Actor, measure},
    },
    rollout::RolledSkill,
    terrain::{Terrain, TerrainKind},
};
use vocaloco_tests::{plugin_folder, repository, shipped};
use vocaloco_train::policy_learning::run::load_expert;

fn robot() -> Arc<RobotModel> {
    Arc::new(RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the shipped robot"))
}

/// The shipped walk on flat ground, sensor noise and variation as in training, no pushes.
fn ground() -> &'static Arc<TrainingGround> {
    static GROUND: OnceLock<Arc<TrainingGround>> = OnceLock::new();
    GROUND.get_or_init(|| ground_of(TerrainShare::new(TerrainKind::Flat, 1.0, [0.0, 0.0])))
}

/// The same on other terrain.
fn ground_of(terrain: TerrainShare) -> Arc<TrainingGround> {
    let robot = robot();
    let library = PluginLibrary::open(&[plugin_folder().to_owned()], "gait").expect("the plugin loads");
    let parameters =
        std::fs::read_to_string(repository().join("skills/walk/gait.toml")).expect("the shipped walk");
    let walk = RolledSkill::new("walk", library, &parameters, &robot).expect("sound parameters");
    let config = EnvironmentConfig {
        levels: 1,
        variants: 1,
        poses: 2,
        initial_level: 0,
        experts: BTreeMap::from([(terrain.kind, "walk".to_owned())]),
        terrain: vec![terrain],
        start: StartRules { moving_share: 0.0, ..StartRules::default() },
        push: PushRules { speed_m_per_s: [0.0, 0.0], ..PushRules::default() },
        latency_ticks: [0, 0],
        ..EnvironmentConfig::default()
    };
    let experts = BTreeMap::from([("walk".to_owned(), walk)]);
    Arc::new(TrainingGround::new(config, &robot, &experts, 3).expect("a sound configuration"))
}

#[test]
fn an_expert_is_a_structured_controller_with_other_parameters_or_a_network_as_it_is() {
    let (installation, robot) = (shipped(), robot());
    let no_hurry = BTreeMap::from([("hurry".to_owned(), 0.0)]);
    for name in ["ascend", "ascend_network"] {
        let expert = load_expert(&installation, &robot, name, &no_hurry).expect("a sound expert");
        assert!(expert.instance(Some(0.25), &robot).is_ok(), "{name}");
    }
    let wrong = BTreeMap::from([("haste".to_owned(), 0.0)]);
    let error = format!("{:#}", load_expert(&installation, &robot, "ascend", &wrong).expect_err("refused"));
    assert!(error.contains("haste") && error.contains("gait.toml"), "{error}");
}

/// An environment at the start of an episode of full length.
fn environment(index: u32) -> Environment {
    let mut environment = Environment::new(ground(), index);
    environment.begin_episode();
    environment
}

#[test]
fn an_expert_that_drives_from_the_shadow_walks_on_flat_for_five_seconds() {
    for index in 0..4 {
        let mut environment = environment(index);
        let start_m = environment.plant().measure().base.position_m;
        let commanded = environment.command().velocity[0];
        let mut action = vec![0.0; environment.action_len()];
        for tick in 0..250 {
            assert!(environment.expert_action(&mut action), "environment {index}, tick {tick}");
            let step = environment.step(&action);
            assert_eq!(step.end, None, "environment {index}, tick {tick}");
        }
        let end_m = environment.plant().measure().base.position_m;
        let made_m = (end_m[0] - start_m[0]).hypot(end_m[1] - start_m[1]);
        assert!(made_m > 0.7 * commanded * 5.0, "environment {index}: {made_m} m at {commanded} m/s");
    }
}

#[test]
fn the_expert_keeps_its_own_time_while_another_drives_and_asking_twice_changes_nothing() {
    let run = |asked_twice: bool| {
        let mut environment = environment(1);
        let still = vec![0.0; environment.action_len()];
        let mut action = vec![0.0; environment.action_len()];
        let mut said = Vec::new();
        for _ in 0..60 {
            for _ in 0..=usize::from(asked_twice) {
                assert!(environment.expert_action(&mut action));
            }
            said.push(action.clone());
            environment.step(&still);
        }
        said
    };
    let once = run(false);
    assert_eq!(once, run(true));
    // A trot's feet lift in turn, though the robot stands: its clock runs on.
    let knee = |tick: usize| once[tick][2];
    let range = (0..60).map(knee).fold((f32::MAX, f32::MIN), |(low, high), at| (low.min(at), high.max(at)));
    assert!(range.1 - range.0 > 0.3, "the knee's action stays within {range:?}");
}

#[test]
fn the_experts_action_asks_for_a_torque_that_the_drives_then_give() {
    let mut environment = environment(2);
    let mut action = vec![0.0; environment.action_len()];
    for _ in 0..40 {
        assert!(environment.expert_action(&mut action));
        let measured = environment.plant().measure();
        let (q, qd) = (measured.joint_position_rad.clone(), measured.joint_velocity_rad_per_s.clone());
        let drive = environment.plant().robot().drive;
        for joint in 0..12 {
            let target = environment.expert_targets().expect("it has just acted")[joint];
            let wanted = drive.limit(target.torque_nm(q[joint], qd[joint]), qd[joint]);
            let stand = environment.plant().robot().stand_position_rad()[joint];
            let asked = 80.0 * (stand + 0.5 * action[joint] - q[joint]) - 2.0 * qd[joint];
            let found = drive.limit(asked, qd[joint]);
            assert!((found - wanted).abs() < 0.02, "joint {joint}: {found} N·m, wanted {wanted} N·m");
        }
        environment.step(&action);
    }
}

#[test]
fn a_skipped_tick_starts_the_expert_anew() {
    let mut environment = environment(1);
    let mut action = vec![0.0; environment.action_len()];
    let still = action.clone();
    let mut first = Vec::new();
    for tick in 0..20 {
        assert!(environment.expert_action(&mut action));
        if tick == 0 {
            first.clone_from(&action);
        }
        environment.step(&still);
    }
    environment.step(&still);
    assert!(environment.expert_action(&mut action));
    let apart = first.iter().zip(&action).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(apart < 1.0, "back at its initial phase: {apart}");
}

#[test]
fn speed_is_measured_with_and_without_an_expert() {
    let zero = measure(ground(), 2, 1, Actor::Zero);
    let expert = measure(ground(), 2, 1, Actor::Expert);
    for speed in [zero, expert] {
        assert!(speed.steps_per_s > 0.0 && speed.physics_steps_per_s > 0.0 && speed.overhead_us.is_finite());
    }
}

#[test]
fn a_led_episode_begins_in_stride_at_the_asked_distance_and_repeats() {
    let share = TerrainShare::new(TerrainKind::Gap, 1.0, [0.2, 0.2]);
    let led = TerrainShare {
        start_before_m: Some([1.2, 1.5]),
        led: Some(LedRules { by: "walk".to_owned(), to_m: [0.5, 0.7] }),
        ..share
    };
    let ground = ground_of(led);
    let mut speeds = Vec::new();
    for index in 0..4 {
        let environment = Environment::new(&ground, index);
        let measured = environment.plant().measure();
        // The edge of one gap lies where that of any other does.
        let edge_m = Terrain::tile(TerrainKind::Gap, 0.2, 1).obstacle_x_m.expect("a gap is directed");
        let before_m = edge_m - measured.base.position_m[0];
        assert!((0.45..=0.75).contains(&before_m), "environment {index}: {before_m} m before");
        assert!(!measured.base_contact, "environment {index}");
        let [x, y, _] = measured.base.vector_in_world(measured.base_linear_velocity);
        speeds.push(x.hypot(y));
        let mut again = Environment::new(&ground, index);
        again.restart(0, 0);
        assert!(again.plant().measure() == measured, "environment {index} repeats");
    }
    assert!(speeds.iter().all(|speed| *speed > 0.2), "it walks: {speeds:?} m/s");
}

#[test]
fn whoever_falls_on_the_way_begins_from_the_stand() {
    let share = TerrainShare::new(TerrainKind::Gap, 1.0, [0.6, 0.6]);
    // Beyond a gap that walk does not cross.
    let led = Some(LedRules { by: "walk".to_owned(), to_m: [-1.5, -1.2] });
    let ground = ground_of(TerrainShare { start_before_m: Some([0.6, 0.9]), led, ..share });
    for index in 0..4 {
        let environment = Environment::new(&ground, index);
        let measured = environment.plant().measure();
        let edge_m = Terrain::tile(TerrainKind::Gap, 0.6, 1).obstacle_x_m.expect("a gap is directed");
        let before_m = edge_m - measured.base.position_m[0];
        assert!((0.5..=1.0).contains(&before_m), "environment {index}: {before_m} m before");
        let speed = measured.base_linear_velocity.map(f32::abs).into_iter().fold(0.0, f32::max);
        assert!(speed < 0.1, "environment {index} stands: {speed} m/s");
    }
}
