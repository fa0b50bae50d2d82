//! From a data set on disk to models and a card, through the verb itself.

use std::collections::BTreeMap;
use std::path::Path;

use clap::Parser;
use vocaloco_core::heightfield::Heightfield;
use vocaloco_core::predictor::{Predictor, Quantity};
use vocaloco_sim::collect::CollectConfig;
use vocaloco_sim::dataset::{Cost, Kind, META_FILE, Meta, RobotId, Row, SCHEMA, SimulatorId, SkillId};
use vocaloco_sim::dataset::{shard_file, write_shard};
use vocaloco_sim::rollout::Outcome;
use vocaloco_sim::stream::{stream, uniform};
use vocaloco_sim::terrain::TerrainKind;

use super::{Args, run};

const ROWS: u64 = 96;

fn meta(kind: Kind, skill: &str) -> Meta {
    Meta {
        schema: SCHEMA,
        kind,
        rows: ROWS,
        rows_per_shard: ROWS,
        robot: RobotId { name: "anymal_d".into(), files_sha256: BTreeMap::new() },
        skill: SkillId {
            name: skill.into(),
            plugin: "gait".into(),
            plugin_version: "0.1.0".into(),
            plugin_source_sha256: Some("5ca1ab1e".into()),
            parameters_sha256: String::new(),
            policy_sha256: None,
            target_distance_m: None,
        },
        simulator: SimulatorId { name: "rapier3d".into(), version: "0.36.1".into() },
        config: CollectConfig::new(kind, 1),
    }
}

/// A step ahead whose height decides the label; every eighth cost ran out of time.
fn row(kind: Kind, row: u64) -> Row {
    let size_m = uniform(&mut stream(row, "test/row", &[]), 0.02, 0.4);
    let cells_m = std::array::from_fn(|i| [if i > 18 { size_m } else { 0.0 }; 11]);
    let heightfield = Heightfield { cells_m };
    let timed_out = kind == Kind::Cot && row.is_multiple_of(8);
    let outcome = if timed_out { Outcome::Timeout } else { Outcome::Reached };
    let label = match kind {
        Kind::Viability => f32::from(u8::from(size_m < 0.2)),
        Kind::Cot if timed_out => f32::NAN,
        Kind::Cot => 0.2 + size_m,
    };
    let mut heightfield_m = [0.0; 341];
    heightfield_m.copy_from_slice(heightfield.cells_m.as_flattened());
    Row {
        row,
        seed: row,
        terrain: TerrainKind::StairsUp,
        size_m,
        difficulty: 0.5,
        spawn: [0.0; 4],
        spawn_attempts: 1,
        heightfield_m,
        field_m: *heightfield.prepare(None).unwrap().as_slice(),
        label,
        trainable: !timed_out,
        rollouts: 1,
        successes: u32::from(!timed_out),
        base_collisions: 0,
        cost: (kind == Kind::Cot).then_some(Cost { outcome, signed: 0.1 }),
    }
}

fn data_set(data: &Path, kind: Kind, skill: &str) {
    data_set_of(data, kind, skill, 1);
}

fn data_set_of(data: &Path, kind: Kind, skill: &str, seed: u64) {
    let folder = data.join("walk").join(kind.id());
    std::fs::create_dir_all(&folder).unwrap();
    Meta { config: CollectConfig::new(kind, seed), ..meta(kind, skill) }.write(&folder).unwrap();
    let rows: Vec<Row> = (0..ROWS).map(|index| row(kind, index)).collect();
    write_shard(&folder.join(shard_file(0)), kind, &(0..ROWS), &rows).unwrap();
}

fn train(data: &Path, out: &Path, more: &[&str]) -> anyhow::Result<()> {
    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }
    let line = ["train", "--skill", "walk", "--data", data.to_str().unwrap(), "--out", out.to_str().unwrap()];
    let line = line.into_iter().chain(["--epochs", "2", "--json"]).chain(more.iter().copied());
    run(&Line::parse_from(line).args).map(|_| ())
}

fn read(folder: &Path, file: &str) -> Vec<u8> {
    std::fs::read(folder.join(file)).unwrap()
}

#[test]
fn a_data_set_becomes_two_models_that_load_and_a_card_that_says_whence() {
    let (data, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    data_set(data.path(), Kind::Viability, "walk");
    data_set(data.path(), Kind::Cot, "walk");
    train(data.path(), out.path(), &["--threads", "1"]).unwrap();
    Predictor::load(&out.path().join("viability.onnx"), Quantity::Viability).unwrap();
    Predictor::load(&out.path().join("cot.onnx"), Quantity::Cot).unwrap();
    let card = String::from_utf8(read(out.path(), "CARD.md")).unwrap();
    let facts =
        ["## viability.onnx", "## cot.onnx", "--seed 1`", "stairs_up 0.0", "12 rows that ran out of time"];
    for fact in facts {
        assert!(card.contains(fact), "{fact} is missing in\n{card}");
    }
    // The same once more, on two threads, gives the same bytes; another seed does not.
    let again = tempfile::tempdir().unwrap();
    train(data.path(), again.path(), &["--threads", "2"]).unwrap();
    for file in ["viability.onnx", "cot.onnx", "CARD.md"] {
        assert_eq!(read(out.path(), file), read(again.path(), file), "{file}");
    }
    train(data.path(), again.path(), &["--seed", "2", "--kind", "cot"]).unwrap();
    assert_eq!(read(out.path(), "viability.onnx"), read(again.path(), "viability.onnx"));
    assert_ne!(read(out.path(), "cot.onnx"), read(again.path(), "cot.onnx"));
}

#[test]
fn a_card_says_which_source_collected_its_rows_and_which_rows_its_scores_are_of() {
    let (data, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    data_set(data.path(), Kind::Viability, "walk");
    data_set(data.path(), Kind::Cot, "walk");
    train(data.path(), out.path(), &["--threads", "1"]).unwrap();
    let card = String::from_utf8(read(out.path(), "CARD.md")).unwrap();
    for fact in
        ["plugin gait 0.1.0, its source sha256 `5ca1ab1e`", "their loss chose the epoch", "| kept back |"]
    {
        assert_eq!(card.matches(fact).count(), 2, "{fact:?}, once for each model, in\n{card}");
    }
    // Far too few rows for a promise, and it says so.
    assert!(card.contains("| 0.01 | none: too few unsafe rows |"), "{card}");
}

#[test]
fn thresholds_may_come_from_other_rows_but_not_from_the_trained_ones() {
    let [data, other, out] = [(); 3].map(|()| tempfile::tempdir().unwrap());
    data_set(data.path(), Kind::Viability, "walk");
    data_set_of(other.path(), Kind::Viability, "walk", 2);
    let more = ["--kind", "viability", "--thresholds-from", other.path().to_str().unwrap()];
    train(data.path(), out.path(), &more).unwrap();
    let unsafe_rows = (0..ROWS).filter(|index| row(Kind::Viability, *index).label < 0.5).count();
    let card = String::from_utf8(read(out.path(), "CARD.md")).unwrap();
    let counted = format!("| 0.01 | none: too few unsafe rows | {unsafe_rows} |");
    assert!(card.contains(&counted) && card.contains("a data set of its own"), "{counted} in {card}");

    data_set_of(other.path(), Kind::Viability, "walk", 1);
    let error = train(data.path(), out.path(), &more).unwrap_err().to_string();
    assert!(error.contains("config.seed: found 1"), "{error}");

    let older = SkillId { parameters_sha256: "01der".into(), ..meta(Kind::Viability, "walk").skill };
    let config = CollectConfig::new(Kind::Viability, 2);
    let older = Meta { skill: older, config, ..meta(Kind::Viability, "walk") };
    older.write(&other.path().join("walk/viability")).unwrap();
    let error = train(data.path(), out.path(), &more).unwrap_err().to_string();
    assert!(error.contains("skill: found") && error.contains("01der"), "{error}");

    let more = ["--kind", "cot", "--thresholds-from", other.path().to_str().unwrap()];
    let error = train(data.path(), out.path(), &more).unwrap_err().to_string();
    assert!(error.contains("--thresholds-from: found --kind cot"), "{error}");
}

#[test]
fn a_missing_or_foreign_data_set_is_named_and_nothing_is_written() {
    let (data, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    data_set(data.path(), Kind::Viability, "walk");
    let missing = train(data.path(), out.path(), &[]).unwrap_err().to_string();
    assert!(missing.contains("walk/cot") && missing.contains("collect"), "{missing}");
    data_set(data.path(), Kind::Cot, "ascend");
    let foreign = train(data.path(), out.path(), &[]).unwrap_err().to_string();
    assert!(foreign.contains(META_FILE) && foreign.contains("ascend"), "{foreign}");
    assert_eq!(std::fs::read_dir(out.path()).unwrap().count(), 0);
}
