//! What a rollout in stride is: the rest of the rollout that came there, with the skill as it was.

use std::{collections::BTreeMap, sync::Arc};

use vocaloco_core::robot::RobotModel;
use vocaloco_sim::{
    plant::{Plant, PlantKind},
    rollout::{Chance, Outcome, Perturbations, RolloutRules, RunUp, Trial},
    sensing::SensorNoise,
    spawn::{Spawn, SpawnRules, Spawner},
    stream::stream,
    terrain::{Terrain, TerrainKind},
};
use vocaloco_tests::shipped;
use vocaloco_train::policy_learning::run::load_expert;

const RUN_UP_TICKS: usize = 60;

#[test]
fn a_rollout_in_stride_goes_on_where_a_rollout_has_come_to() {
    let robot =
        Arc::new(RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the shipped robot"));
    let walk = load_expert(&shipped(), &robot, "walk", &BTreeMap::new()).expect("the shipped walk");
    let flat = Terrain::tile(TerrainKind::Flat, 0.0, 1);
    let mut plant = Plant::new(&robot, &flat, PlantKind::Fast);
    let spawner = Spawner::new(&robot, SpawnRules::default());
    let spawn = spawner.settle(&mut plant, &flat, &mut stream(5, "pose", &[])).expect("level ground");
    // Nothing differs between rollouts, and none steers: a path that begins midway asks for the same.
    let chance = Chance::draw(5, 0, &Perturbations::parse("none").expect("a word for it"), SensorNoise::NONE);
    let rules = |ticks: usize| RolloutRules {
        horizon_m: 5.0,
        time_limit_s: ticks as f64 * 0.02,
        steering_per_s: 0.0,
        ..RolloutRules::default()
    };
    let mut roll = |rules: &RolloutRules, spawn: &Spawn, run_up: Option<&RunUp>| {
        let trial = Trial { terrain: &flat, spawn, skill: &walk, rules };
        let rollout = match run_up {
            Some(run_up) => trial.roll_in_stride(run_up, &mut plant, &chance),
            None => trial.roll_out(&mut plant, &chance),
        };
        assert_eq!(rollout.outcome, Outcome::Timeout);
        (plant.measure().base, rollout)
    };

    let (there, _) = roll(&rules(RUN_UP_TICKS), &spawn, None);
    let (whole, _) = roll(&rules(RUN_UP_TICKS + 40), &spawn, None);
    let midway = Spawn { base: there, ..spawn.clone() };
    let run_up = RunUp { from: spawn.clone(), ticks: RUN_UP_TICKS, chance: chance.clone() };
    let (rest, rollout) = roll(&rules(40), &midway, Some(&run_up));
    assert_eq!(rest, whole, "the same tick of the same rollout");
    assert!((rollout.duration_s - 0.8).abs() < 1e-9, "time counts from where it goes on");
    let from_stand = roll(&rules(40), &spawn, None).1.distance_m;
    assert!(rollout.distance_m > from_stand + 0.1, "{} m in stride, {from_stand} m", rollout.distance_m);
}
