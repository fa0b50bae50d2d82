//! Without noise a skill that nothing stops is driven by the loop as it is driven alone: what it is told and shown
//! is the same, number for number.

use std::sync::Arc;

use vocaloco_core::{
    registry::{ModelPolicy, load_skill},
    robot::RobotModel,
    runtime::{Runtime, RuntimeConfig, Skill},
    switch::Windows,
};
use vocaloco_sim::{
    course::{CourseConfig, CourseRun, CourseStage, SelectorPilot, SkillPilot, drive},
    rollout::RolledSkill,
    sensing::SensorNoise,
    terrain::CourseKind,
};
use vocaloco_tests::{Says, shipped};

fn poses(run: &CourseRun) -> Vec<([f32; 3], [f32; 4])> {
    run.ticks.iter().map(|tick| (tick.base.position_m, tick.base.orientation_xyzw)).collect()
}

#[test]
fn walk_goes_the_same_way_alone_and_in_the_loop() {
    let robot = Arc::new(RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the robot"));
    let loaded = load_skill(&shipped(), "walk", &robot.description, ModelPolicy::Optional).expect("walk");
    let config = CourseConfig {
        noise: SensorNoise::NONE,
        field_noise_m: 0.0,
        ..CourseConfig::demo(CourseKind::StairsDown, 0.1, 7)
    };

    let CourseStage { terrain, mut plant } = CourseStage::set(&robot, &config).expect("a settled robot");
    let rolled = RolledSkill::from_loaded(&loaded, &robot).expect("it can be rolled out");
    let mut instance = loaded.create(&robot.description).expect("an instance");
    let mut pilot = SkillPilot::new(&config, &mut plant, &terrain, (&rolled, &mut instance));
    let alone = drive(&config, &mut pilot).expect("driven");

    let CourseStage { terrain, mut plant } = CourseStage::set(&robot, &config).expect("a settled robot");
    let controller = loaded.create(&robot.description).expect("an instance");
    let skill = Skill {
        rule: Skill::rule_of(&loaded),
        needs: *controller.needs(),
        controller: Box::new(controller),
        predictors: Box::new(Says::always(1.0, 0.2)),
    };
    let windows = Windows { switch: 1, stop: 1, resume: 1 };
    let runtime_config = RuntimeConfig::of(windows);
    let mut runtime = Runtime::from_skills(runtime_config, Arc::clone(&robot), vec![skill]);
    let mut pilot = SelectorPilot::new(&config, &mut plant, &terrain, &mut runtime);
    let looped = drive(&config, &mut pilot).expect("driven");

    let (alone, looped) = (poses(&alone), poses(&looped));
    let first = alone.iter().zip(&looped).position(|(alone, looped)| alone != looped);
    assert!(alone.len() > 100, "{} ticks", alone.len());
    assert_eq!(first, None, "the tick in which they part");
    assert_eq!(alone.len(), looped.len());
}
