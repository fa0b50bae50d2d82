//! A skill that takes position targets is rolled out as the loop would run it: its target lies where its
//! manifest says, its time is the manifest's, and nothing of it shows in what velocity skills leave behind.

use std::sync::Arc;

use vocaloco_core::{
    registry::{LoadedSkill, ModelPolicy, load_skill},
    robot::RobotModel,
};
use vocaloco_plugin_api::{Command, JointTarget};
use vocaloco_sim::{
    collect::{CollectConfig, CollectError, Mixture},
    course::{self, CourseConfig, Selector},
    dataset::Kind,
    driver::{Driver, SensorNoise},
    evaluate::{Query, sample},
    identity,
    plant::{BasePose, Plant, PlantKind},
    rollout::{Outcome, RolledSkill, RolloutRules},
    stream::stream,
    terrain::{CourseKind, Terrain, TerrainKind},
    threads::with_threads,
};
use vocaloco_tests::{Fixture, PolicyModel, shipped};

const TEXT: &str = r#"schema = 1
name = "aim"
summary = "Shows in four joints what it is told"
plugin = "onnx"

[models]
policy = "policy.onnx"
viability = "viability.onnx"
cot = "cot.onnx"

[selection]
viability_threshold = 0.9
committed = true

[command]
kind = "position_target"
target_distance_m = 1.75

[rollout]
horizon_m = 1.25
time_limit_s = 1.2

[contract]
joints = ["LF_HAA", "LF_HFE", "LF_KFE", "RF_HAA", "RF_HFE", "RF_KFE", "LH_HAA", "LH_HFE", "LH_KFE", "RH_HAA", "RH_HFE", "RH_KFE"]
observation = [{ term = "position_target" }]
action = { kind = "joint_position", scale = 0.01, default_position_rad = { LF_HAA = 0.0, LF_HFE = 0.4, LF_KFE = -0.8, RF_HAA = 0.0, RF_HFE = 0.4, RF_KFE = -0.8, LH_HAA = 0.0, LH_HFE = -0.4, LH_KFE = 0.8, RH_HAA = 0.0, RH_HFE = -0.4, RH_KFE = 0.8 } }
gains = { stiffness_nm_per_rad = 120.0, damping_nms_per_rad = 4.0 }
"#;

/// Stands, its first four joints off the stand by a hundredth of what the policy is told.
fn fixture() -> Fixture {
    let fixture = Fixture::new();
    fixture.write("manifests/skills/aim.toml", TEXT.as_bytes());
    let mut policy = PolicyModel::arbitrary(&[4, 12]);
    let (weight, bias) = &mut policy.layers[0];
    for (joint, row) in weight.iter_mut().enumerate() {
        row.iter_mut().enumerate().for_each(|(at, weight)| *weight = f32::from(u8::from(at == joint)));
    }
    bias.fill(0.0);
    fixture.write("skills/aim/policy.onnx", &policy.onnx());
    fixture
}

fn robot(fixture: &Fixture) -> Arc<RobotModel> {
    let folder = fixture.installation().robots_folder();
    Arc::new(RobotModel::load(&folder, "anymal_d").expect("the shipped robot"))
}

fn load(fixture: &Fixture, robot: &RobotModel) -> LoadedSkill {
    load_skill(&fixture.installation(), "aim", &robot.description, ModelPolicy::Optional)
        .unwrap_or_else(|refusal| panic!("{refusal}"))
}

fn rolled(fixture: &Fixture, robot: &RobotModel) -> RolledSkill {
    RolledSkill::from_loaded(&load(fixture, robot), robot).expect("it can be rolled out")
}

/// What the policy was told, read off its joint targets.
fn told(targets: &[JointTarget], robot: &RobotModel) -> [f32; 4] {
    let stand_rad = robot.stand_position_rad();
    std::array::from_fn(|joint| (targets[joint].position_rad - stand_rad[joint]) / 0.01)
}

#[test]
fn the_target_lies_where_the_manifest_says_and_its_time_runs_out() {
    let fixture = fixture();
    let robot = robot(&fixture);
    let skill = rolled(&fixture, &robot);
    let terrain = Terrain::tile(TerrainKind::Flat, 0.0, 1);
    let mut plant = Plant::new(&robot, &terrain, PlantKind::Fast);
    let mut instance = skill.instance(None, &robot).expect("an instance");
    let rng = stream(1, "test/target", &[]);
    let mut driver =
        Driver::new(&mut plant, &terrain, &mut instance, SensorNoise::NONE, rng).aiming(skill.target());
    driver.start().expect("a start");
    // Steering by a yaw rate does not turn the way to the target.
    let command = Command::velocity(0.6, 0.0, 0.4);
    let seen = |driver: &mut Driver<'_>| {
        driver.tick(&command, |_| ()).expect("a tick");
        told(driver.targets(), &robot)
    };
    let first = seen(&mut driver);
    for (found, wanted) in first.iter().zip([1.75, 0.0, 0.0, 1.2]) {
        assert!((found - wanted).abs() < 1e-3, "{first:?}");
    }
    let second = seen(&mut driver);
    assert!((second[3] - 1.18).abs() < 1e-3, "{second:?}");
    // Moved a metre ahead, the target stays where it is.
    let height_m = robot.description.stand_height_m as f32;
    driver.plant.place(&BasePose::from_yaw([1.0, 0.0, height_m], 0.0), &robot.stand_position_rad());
    let third = seen(&mut driver);
    assert!((third[0] - 0.75).abs() < 0.01 && third[3] < 1.17, "{third:?}");
    // Reached, it is set anew.
    driver.plant.place(&BasePose::from_yaw([1.72, 0.0, height_m], 0.0), &robot.stand_position_rad());
    let fourth = seen(&mut driver);
    assert!((fourth[0] - 1.75).abs() < 0.01 && (fourth[3] - 1.2).abs() < 1e-3, "{fourth:?}");
}

#[test]
fn the_time_limit_of_the_manifest_ends_the_rollout() {
    let fixture = fixture();
    let robot = robot(&fixture);
    let loaded = load(&fixture, &robot);
    let skill = RolledSkill::from_loaded(&loaded, &robot).expect("it can be rolled out");
    let rules = RolloutRules::of(&loaded.manifest.rollout);
    assert_eq!((rules.horizon_m, rules.forward_m_per_s), (1.25, 0.6));
    let query = Query { rules, plant: PlantKind::Fast, ..Query::new(TerrainKind::Flat, 0.0, 2, 1) };
    let samples: Result<_, CollectError> =
        with_threads(2, || sample(&robot, &skill, &query, &|| ())).expect("threads");
    for (index, sample) in samples.expect("samples").iter().enumerate() {
        let rollout = &sample.rollout;
        assert_eq!(rollout.outcome, Outcome::Timeout, "rollout {index}: it stands");
        assert!((rollout.duration_s - 1.2).abs() < 1e-9, "rollout {index}: {} s", rollout.duration_s);
    }
}

#[test]
fn one_skill_alone_goes_to_its_targets_on_a_course() {
    let fixture = fixture();
    let robot = robot(&fixture);
    let config = CourseConfig { steps: 1, ..CourseConfig::evaluation(CourseKind::StairsUp, 0.05, 1, 0) };
    let skill = rolled(&fixture, &robot);
    let run = course::roll_out(&robot, &config, &Selector::Skill(&skill)).expect("it is driven to its end");
    assert_eq!(run.outcome, course::Outcome::Stuck, "it stands");
}

#[test]
fn a_data_set_names_the_distance_of_targets_and_a_velocity_skills_is_as_ever() {
    let fixture = fixture();
    let robot = robot(&fixture);
    let meta = serde_json::to_value(identity::skill(&rolled(&fixture, &robot), None)).expect("an identity");
    assert_eq!(meta["target_distance_m"], 1.75, "{meta}");
    let walk = load_skill(&shipped(), "walk", &robot.description, ModelPolicy::Optional).expect("walk");
    let walk = RolledSkill::from_loaded(&walk, &robot).expect("it can be rolled out");
    let meta = serde_json::to_value(identity::skill(&walk, None)).expect("an identity");
    assert!(meta.get("target_distance_m").is_none(), "{meta}");
}

#[test]
fn poses_before_an_obstacle_are_drawn_there_alone() {
    let fixture = fixture();
    let robot = robot(&fixture);
    let skill = rolled(&fixture, &robot);
    let mut query = Query::new(TerrainKind::Wall, 0.4, 6, 3);
    query.plant = PlantKind::Fast;
    query.rules.time_limit_s = 0.1;
    query.field_noise_m = 0.0;
    query.spawn.start_before_m = Some([0.6, 0.7]);
    query.spawn.yaw_rad = 0.0;
    let samples: Result<_, CollectError> =
        with_threads(2, || sample(&robot, &skill, &query, &|| ())).expect("threads");
    for (index, sample) in samples.expect("samples").iter().enumerate() {
        let ahead: Vec<f32> = (10..31).map(|row| sample.field.as_slice()[row * 11 + 5]).collect();
        let edge = ahead.iter().position(|height_m| *height_m > ahead[0] + 0.3).expect("a wall ahead");
        assert!((6..=8).contains(&edge), "pose {index}: the wall is {edge} cells ahead");
    }
    let config = CollectConfig::new(Kind::Viability, 1);
    let text = serde_json::to_string(&CollectConfig { mixture: Mixture::only(TerrainKind::Wall), ..config });
    assert!(!text.expect("a text").contains("start_before_m"), "collections are as ever");
}
