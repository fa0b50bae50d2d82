//! What a rollout counts as, whatever the plugin does: a pose belongs to its row and not to the skill,
//! and a plugin that fails has failed its rollout and nothing else.

use std::sync::{Arc, OnceLock};

use vocaloco_core::{plugin::PluginLibrary, robot::RobotModel};
use vocaloco_sim::{
    collect::{CollectConfig, CollectError, Collection, Mixture},
    dataset::{self, Dataset, Kind, Layout, Shard},
    evaluate::{Query, Sample, sample, summarise},
    rollout::{Outcome, Perturbations, RolledSkill},
    terrain::TerrainKind,
    threads::with_threads,
};
use vocaloco_tests::{plugin_folder, shipped};

fn robot() -> &'static Arc<RobotModel> {
    static ROBOT: OnceLock<Arc<RobotModel>> = OnceLock::new();
    ROBOT.get_or_init(|| {
        Arc::new(RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the shipped robot"))
    })
}

fn skill(plugin: &str, parameters: &str) -> RolledSkill {
    let library = PluginLibrary::open(&[plugin_folder().to_owned()], plugin).expect("the plugin loads");
    RolledSkill::new(plugin, library, parameters, robot()).expect("sound parameters")
}

fn query(terrain: TerrainKind, size_m: f32, samples: u64) -> Query {
    let mut query = Query::new(terrain, size_m, samples, 1);
    query.rules.time_limit_s = 1.0;
    query.rules.horizon_m = 0.3;
    query
}

fn samples(skill: &RolledSkill, query: &Query, threads: usize) -> Vec<Sample> {
    let samples: Result<_, CollectError> =
        with_threads(threads, || sample(robot(), skill, query, &|| ())).expect("threads");
    samples.expect("samples")
}

fn outcomes(samples: &[Sample]) -> Vec<Outcome> {
    samples.iter().map(|sample| sample.rollout.outcome).collect()
}

#[test]
fn a_plugin_that_fails_has_failed_the_rollout_and_nothing_else() {
    let query = query(TerrainKind::Flat, 0.0, 2);
    for fault in ["panic 10", "panic_in_reset 0", "error 10", "nan 10"] {
        let skill = skill("faulty", fault);
        let samples = samples(&skill, &query, 1);
        for (n, outcome) in outcomes(&samples).into_iter().enumerate() {
            assert_ne!(outcome, Outcome::Reached, "{fault}: rollout {n}");
            assert!(matches!(outcome, Outcome::Fault | Outcome::BaseCollision), "{fault}: {outcome:?}");
        }
        assert_eq!(summarise(&skill, &query, &samples).viable, 0.0, "{fault}");
    }
}

#[test]
fn a_row_counts_every_rollout_that_is_not_viable_as_a_collision_a_time_out_or_a_fault() {
    let query = query(TerrainKind::Flat, 0.0, 2);
    let (skill, standing) = (skill("faulty", "error 10"), skill("faulty", "none 0"));
    let mut samples = samples(&skill, &query, 1);
    assert_eq!(outcomes(&samples), [Outcome::Fault; 2]);
    samples.push(self::samples(&standing, &query, 1).remove(0));
    let row = summarise(&skill, &query, &samples);
    assert!((row.fault - 2.0 / 3.0).abs() < 1e-9, "{row:?}");
    let all = row.viable + row.base_collision + row.timeout + row.fault;
    assert!((all - 1.0).abs() < 1e-9, "{row:?}");
}

#[test]
fn standing_still_is_a_time_out_without_a_cost() {
    let query = query(TerrainKind::Flat, 0.0, 2);
    let skill = skill("faulty", "none 0");
    let samples = samples(&skill, &query, 1);
    assert_eq!(outcomes(&samples), [Outcome::Timeout; 2]);
    let row = summarise(&skill, &query, &samples);
    assert_eq!((row.timeout, row.cot_mean), (1.0, None));
    assert!(samples.iter().all(|sample| sample.rollout.cot_positive.is_none()));
}

#[test]
fn one_thread_and_two_measure_the_same() {
    let query = query(TerrainKind::StairsUp, 0.08, 6);
    let skill = skill("gait", "");
    let row = |threads| {
        let row = summarise(&skill, &query, &samples(&skill, &query, threads));
        serde_json::to_string(&row).expect("a row")
    };
    assert_eq!(row(1), row(2));
}

#[test]
fn walking_costs_more_than_nothing_and_no_more_than_power_counted_as_signed_allows() {
    let samples = samples(&skill("gait", ""), &query(TerrainKind::Flat, 0.0, 4), 2);
    let reached: Vec<_> =
        samples.iter().filter(|sample| sample.rollout.outcome == Outcome::Reached).collect();
    assert!(!reached.is_empty(), "{:?}", outcomes(&samples));
    for sample in reached {
        let cot = sample.rollout.cot_positive.expect("a cost");
        let signed = sample.rollout.cot_signed.expect("a signed cost");
        assert!(cot > 0.02 && cot < 2.0, "{cot}");
        assert!(signed < cot, "braking counts negative: {signed} {cot}");
    }
}

#[test]
fn perturbations_differ_from_pose_to_pose_and_can_be_switched_off() {
    let mut still = query(TerrainKind::Flat, 0.0, 3);
    still.perturb = Perturbations::parse("none").expect("none");
    let skill = skill("gait", "");
    let cost = |query: &Query| -> Vec<Option<f64>> {
        samples(&skill, query, 1).iter().map(|sample| sample.rollout.cot_signed).collect()
    };
    let (perturbed, quiet) = (cost(&query(TerrainKind::Flat, 0.0, 3)), cost(&still));
    assert_ne!(perturbed, quiet);
    let spread = |costs: &[Option<f64>]| {
        let costs: Vec<f64> = costs.iter().flatten().copied().collect();
        costs.iter().fold(f64::MIN, |a, b| a.max(*b)) - costs.iter().fold(f64::MAX, |a, b| a.min(*b))
    };
    // On flat ground without perturbations only the yaw differs, which the gait does not feel.
    assert!(spread(&quiet) < 0.5 * spread(&perturbed), "{quiet:?} {perturbed:?}");
}

fn collected(skill: &RolledSkill, kind: Kind) -> Dataset {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut config = CollectConfig::new(kind, 5);
    config.repeats = 1;
    config.rollout.horizon_m = 0.3;
    config.rollout.time_limit_s = 1.0;
    config.mixture = Mixture::only(TerrainKind::StairsUp);
    let collection = Collection {
        robot: robot(),
        skill,
        kind,
        config: &config,
        layout: Layout { rows: 4, rows_per_shard: 4 },
        shard: Shard::ALL,
        threads: 2,
        resume: false,
        plugin_source_sha256: None,
    };
    collection.run(folder.path(), &|_| {}).expect("collects");
    dataset::read(folder.path()).expect("reads")
}

#[test]
fn a_pose_belongs_to_its_row_and_not_to_the_skill() {
    let (gait, standing) = (skill("gait", ""), skill("faulty", "none 0"));
    let (walked, stood) = (collected(&gait, Kind::Viability), collected(&standing, Kind::Viability));
    assert_eq!(walked.fields, stood.fields);
    assert_eq!(walked.size_m, stood.size_m);
    assert_eq!(stood.labels, [0.0; 4]);
}

#[test]
fn a_cost_without_distance_is_stored_and_not_trained_on() {
    let stood = collected(&skill("faulty", "none 0"), Kind::Cot);
    assert_eq!(stood.len(), 4);
    assert!(stood.trainable.iter().all(|trainable| !trainable));
    assert!(stood.labels.iter().all(|label| label.is_nan()));
    let crashed = collected(&skill("faulty", "panic 5"), Kind::Cot);
    assert_eq!(crashed.len(), 0, "rollouts that crash are left out");
}
