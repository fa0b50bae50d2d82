//! A gait whose footholds keep within reach and that slows down downhill comes down onto steps in full stride.
//! The deployed walk leaves its path or falls on one flight in nine, though rows that start near a step say 99 %:
//! it sends a fore foot two treads down, farther than the leg reaches.

use std::sync::Arc;

use vocaloco_core::{
    registry::{ModelPolicy, load_skill},
    robot::RobotModel,
};
use vocaloco_sim::{
    evaluate::{Query, sample},
    rollout::{Outcome, RolledSkill, RolloutRules},
    spawn::SpawnRules,
    terrain::TerrainKind,
    threads::with_threads,
};
use vocaloco_tests::shipped;

#[test]
fn walk_at_speed_comes_down_onto_stairs_in_full_stride() {
    let robot = Arc::new(RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the robot"));
    let loaded = load_skill(&shipped(), "walk_at_speed", &robot.description, ModelPolicy::Optional);
    let skill = RolledSkill::from_loaded(&loaded.expect("the skill"), &robot).expect("it can be rolled out");
    let mut lost = Vec::new();
    for size_m in [0.125, 0.15] {
        let mut query = Query::new(TerrainKind::StairsDown, size_m, 60, 701);
        query.rules = RolloutRules { horizon_m: 3.5, time_limit_s: 9.3, ..query.rules };
        query.spawn = SpawnRules { start_before_m: Some([0.6, 1.4]), ..query.spawn };
        let samples = with_threads(0, || sample(&robot, &skill, &query, &|| ())).expect("threads");
        let outcomes = samples.expect("samples").into_iter().map(|sample| sample.rollout.outcome);
        lost.extend(outcomes.filter(|outcome| *outcome != Outcome::Reached).map(|outcome| (size_m, outcome)));
    }
    // About 1 % is expected of 120; walk loses 15.
    assert!(lost.len() <= 5, "{lost:?}");
}
