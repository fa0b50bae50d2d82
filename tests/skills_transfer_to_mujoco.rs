//! The shipped skills, nothing retuned, do in MuJoCo what they do in rapier, on the same ground with the
//! same friction. Needs the feature `peers` and then `python3` with the package `mujoco`.

use std::sync::{Arc, OnceLock};

use vocaloco_core::{
    registry::{ModelPolicy, load_skill},
    robot::RobotModel,
};
use vocaloco_plugin_api::JointTarget;
use vocaloco_sim::{
    evaluate::{Query, sample, summarise, summarise_rollouts},
    physics::Physics,
    plant::{Plant, PlantKind, Variation},
    rollout::{Outcome, RolledSkill, Rollout, RolloutRules},
    spawn::{SpawnRules, Spawner},
    stream::stream,
    terrain::{Terrain, TerrainKind},
    threads::with_threads,
    transfer::{Interpreter, MujocoPlant, Pair, Peers, sample_pairs},
};
use vocaloco_tests::shipped;

/// Rollouts of a comparison. A skill that reaches its horizon in 98 % of cases reaches it fewer than 10
/// times of 12 in 0.2 %.
const SAMPLES: u64 = 12;
const LEAST: usize = 10;

fn robot() -> &'static Arc<RobotModel> {
    static ROBOT: OnceLock<Arc<RobotModel>> = OnceLock::new();
    ROBOT.get_or_init(|| {
        Arc::new(RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the shipped robot"))
    })
}

fn skill(name: &str) -> RolledSkill {
    let loaded = load_skill(&shipped(), name, &robot().description, ModelPolicy::Optional);
    RolledSkill::from_loaded(&loaded.expect("a shipped skill"), robot()).expect("it can be rolled out")
}

fn peer() -> MujocoPlant {
    MujocoPlant::start(&Interpreter::default(), &shipped().robots_folder(), robot()).expect("MuJoCo starts")
}

fn pairs(skill: &RolledSkill, query: &Query, threads: usize) -> Vec<Pair> {
    let peers = Peers::start(Interpreter::default(), shipped().robots_folder(), robot()).expect("MuJoCo");
    let pairs = with_threads(threads, || sample_pairs(robot(), skill, query, &peers, &|| ()));
    let pairs = pairs.expect("threads").expect("MuJoCo answers");
    let stood: Vec<Pair> = pairs.into_iter().flatten().collect();
    assert_eq!(stood.len() as u64, query.samples, "every pose stands in MuJoCo too");
    stood
}

fn the_skill_passes_in_both(name: &str, terrain: TerrainKind, size_m: f32) {
    let skill = skill(name);
    let pairs = pairs(&skill, &Query::new(terrain, size_m, SAMPLES, 1), 2);
    let reached =
        |of: fn(&Pair) -> &Rollout| pairs.iter().filter(|pair| of(pair).outcome == Outcome::Reached).count();
    let (rapier, mujoco) = (reached(|pair| &pair.rapier), reached(|pair| &pair.mujoco));
    let outcomes: Vec<_> = pairs.iter().map(|pair| (pair.rapier.outcome, pair.mujoco.outcome)).collect();
    assert!(rapier >= LEAST, "{name} in rapier: {rapier} of {SAMPLES}: {outcomes:?}");
    assert!(mujoco >= LEAST, "{name} in MuJoCo: {mujoco} of {SAMPLES}: {outcomes:?}");
}

#[test]
fn walk_passes_on_flat_ground_in_both() {
    the_skill_passes_in_both("walk", TerrainKind::Flat, 0.0);
}

#[test]
fn ascend_passes_on_steps_of_ten_centimetres_in_both() {
    the_skill_passes_in_both("ascend_network", TerrainKind::StairsUp, 0.1);
}

#[test]
fn descend_passes_on_steps_of_ten_centimetres_in_both() {
    the_skill_passes_in_both("descend_network", TerrainKind::StairsDown, 0.1);
}

#[test]
fn threads_change_nothing_and_rapiers_row_is_that_of_the_protocol() {
    let skill = skill("walk");
    let rules = RolloutRules { horizon_m: 0.4, time_limit_s: 1.2, ..RolloutRules::default() };
    let query = Query { rules, ..Query::new(TerrainKind::Discrete, 0.05, 5, 3) };
    let rows = |threads| {
        let pairs = pairs(&skill, &query, threads);
        let row = |of: fn(&Pair) -> &Rollout| {
            let rollouts: Vec<&Rollout> = pairs.iter().map(of).collect();
            serde_json::to_string(&summarise_rollouts(&skill, &query, &rollouts)).expect("a row")
        };
        [row(|pair| &pair.rapier), row(|pair| &pair.mujoco)]
    };
    let one = rows(1);
    assert_eq!(one, rows(2));
    let samples =
        with_threads(2, || sample(robot(), &skill, &query, &|| ())).expect("threads").expect("poses");
    let alone = serde_json::to_string(&summarise(&skill, &query, &samples)).expect("a row");
    assert_eq!(one[0], alone);
    assert_ne!(one[0], one[1], "two simulators");
}

#[test]
fn the_ground_is_the_same() {
    let mut peer = peer();
    for kind in TerrainKind::ALL {
        let terrain = Terrain::tile(kind, if kind == TerrainKind::Flat { 0.0 } else { 0.17 }, 5);
        peer.lay(&terrain).expect("the terrain is laid");
        // Irrational steps: never on an edge, where the two may differ.
        let points: Vec<[f32; 2]> = (0..500_u32)
            .map(|n| {
                let share =
                    [0.618_034_f32, 0.414_214].map(|factor| 0.01 + 0.98 * (n as f32 * factor).fract());
                [0, 1].map(|axis| {
                    terrain.min_m[axis] + share[axis] * (terrain.max_m[axis] - terrain.min_m[axis])
                })
            })
            .collect();
        let heights_m = peer.heights_m(&points).expect("heights");
        for ([x_m, y_m], found) in points.iter().zip(heights_m) {
            let wanted = terrain.height_m(*x_m, *y_m);
            assert!((found - wanted).abs() < 1e-4, "{kind} at {x_m}, {y_m}: MuJoCo {found}, ours {wanted}");
        }
    }
}

/// A pose on a terrain, in rapier and put down as it is in MuJoCo.
fn standing(terrain: &Terrain) -> (Plant, MujocoPlant, Vec<JointTarget>) {
    let mut plant = Plant::new(robot(), terrain, PlantKind::Reference);
    let spawner = Spawner::new(robot(), SpawnRules::default());
    let spawn = spawner.settle(&mut plant, terrain, &mut stream(4, "pose", &[])).expect("a valid pose");
    let mut peer = peer();
    peer.lay(terrain).expect("the terrain is laid");
    let standing_rad = plant.measure().joint_position_rad.clone();
    peer.place(&spawn.base, &standing_rad).expect("the robot is placed");
    (plant, peer, spawn.targets)
}

/// How far the base moves in a second of standing, m.
fn drift_m(plant: &mut impl Physics, targets: &[JointTarget]) -> f32 {
    let from = plant.measure().base.position_m;
    for _ in 0..200 {
        plant.step(targets);
    }
    let to = plant.measure().base.position_m;
    from.iter().zip(to).map(|(from, to)| (to - from).powi(2)).sum::<f32>().sqrt()
}

#[test]
fn a_second_of_standing_moves_the_base_by_less_than_a_centimetre() {
    for (kind, size_m) in [
        (TerrainKind::Flat, 0.0),
        (TerrainKind::StairsUp, 0.15),
        (TerrainKind::Rough, 0.05),
        (TerrainKind::Slope, 0.3),
    ] {
        let (_, mut peer, targets) = standing(&Terrain::tile(kind, size_m, 2));
        let moved_m = drift_m(&mut peer, &targets);
        assert!(moved_m < 0.01, "{kind}: {moved_m} m");
    }
}

/// Feet that slide after a push go as far in one as in the other, whatever the coefficient.
#[test]
fn friction_is_the_same_coefficient_in_both() {
    let (mut plant, mut peer, targets) = standing(&Terrain::tile(TerrainKind::Flat, 0.0, 2));
    let snapshot = plant.snapshot();
    let (base, standing_rad) = (plant.measure().base, plant.measure().joint_position_rad.clone());
    let mut last_m = f32::INFINITY;
    for friction in [0.05, 0.1, 0.2, 0.4] {
        let variation = Variation { friction, ..Variation::default() };
        plant.restore(&snapshot);
        peer.place(&base, &standing_rad).expect("the robot is placed");
        let ours_m = slide_m(&mut plant, &variation, &targets);
        let theirs_m = slide_m(&mut peer, &variation, &targets);
        assert!(
            (ours_m - theirs_m).abs() < 0.05 * ours_m,
            "{friction}: rapier {ours_m} m, MuJoCo {theirs_m} m"
        );
        assert!(theirs_m < 0.95 * last_m, "{friction}: {theirs_m} m, with less friction {last_m} m");
        last_m = theirs_m;
    }
}

/// How far a push of 1 m/s takes the base in a second, m.
fn slide_m(physics: &mut impl Physics, variation: &Variation, targets: &[JointTarget]) -> f32 {
    physics.vary(variation);
    physics.push([1.0, 0.0, 0.0]);
    drift_m(physics, targets)
}

#[test]
fn mass_pushes_and_motor_strength_reach_mujoco() {
    let flat = Terrain::tile(TerrainKind::Flat, 0.0, 1);
    let (mut plant, mut peer, targets) = standing(&flat);
    drift_m(&mut peer, &targets);
    let before_m = peer.measure().base.position_m[2];
    peer.vary(&Variation { base_mass_offset_kg: 15.0, ..Variation::default() });
    drift_m(&mut peer, &targets);
    let loaded_m = peer.measure().base.position_m[2];
    assert!(loaded_m < before_m - 0.001, "15 kg more: {before_m} m, then {loaded_m} m");
    peer.vary(&Variation { motor_strength: 0.6, ..Variation::default() });
    drift_m(&mut peer, &targets);
    let weak_m = peer.measure().base.position_m[2];
    assert!(weak_m < before_m - 0.001, "weaker drives: {before_m} m, then {weak_m} m");
    for velocity in [pushed(&mut plant), pushed(&mut peer)] {
        let speed = velocity.iter().map(|part| part * part).sum::<f32>().sqrt();
        assert!((speed - 0.5).abs() < 0.02, "pushed by 0.5 m/s: {velocity:?}");
    }
    peer.check().expect("MuJoCo answered all along");
}

fn pushed(physics: &mut impl Physics) -> [f32; 3] {
    physics.push([0.3, -0.4, 0.0]);
    physics.measure().base_linear_velocity
}
