//! The committed slice of a data set is small, reads as `docs/data.md` says, and holds the same poses in
//! both kinds.

use std::{fs, path::PathBuf};

use std::sync::Arc;

use vocaloco_core::{
    registry::{ModelPolicy, load_skill},
    robot::RobotModel,
};
use vocaloco_sim::{
    collect::Collection,
    dataset::{self, Dataset, Kind, Layout, Shard},
    identity,
    rollout::RolledSkill,
    terrain::TerrainKind,
};
use vocaloco_tests::{repository, shipped};

fn folder(kind: Kind) -> PathBuf {
    repository().join("tests/data/walk").join(kind.id())
}

fn slice(kind: Kind) -> Dataset {
    dataset::read(&folder(kind)).expect("the slice reads")
}

#[test]
fn the_slice_is_at_most_two_megabytes() {
    let bytes = |kind| -> u64 {
        let entries = fs::read_dir(folder(kind)).expect("the slice").map(|entry| entry.expect("an entry"));
        entries.map(|entry| entry.metadata().expect("a size").len()).sum()
    };
    let (viability, cot) = (bytes(Kind::Viability), bytes(Kind::Cot));
    assert!(viability + cot <= 2_000_000, "{viability} and {cot} bytes");
}

#[test]
fn labels_are_shares_and_positive_costs_over_every_terrain() {
    let (viability, cot) = (slice(Kind::Viability), slice(Kind::Cot));
    assert_eq!(viability.len() as u64, viability.meta.rows, "every row has a viability");
    assert!((1..viability.len()).contains(&cot.len()), "{} rows of cost: crashes are left out", cot.len());
    for terrain in TerrainKind::ALL {
        assert!(viability.terrain.contains(&terrain), "{terrain}");
    }
    for row in 0..viability.len() {
        let share = viability.successes[row] as f32 / viability.rollouts[row] as f32;
        assert_eq!(viability.labels[row], share, "row {row}");
    }
    for row in (0..cot.len()).filter(|row| cot.trainable[*row]) {
        assert!((0.05..5.0).contains(&cot.labels[row]), "row {row}: {}", cot.labels[row]);
    }
}

#[test]
fn both_kinds_see_the_same_fields() {
    let (viability, cot) = (slice(Kind::Viability), slice(Kind::Cot));
    assert_eq!(viability.meta.config.seed, cot.meta.config.seed);
    for (row, number) in cot.rows.iter().enumerate() {
        assert_eq!(cot.fields[row], viability.fields[*number as usize], "row {number}");
    }
}

/// A change of the simulator that moves a skill's data shows here, in rows collected long ago.
#[test]
fn its_first_rows_are_collected_again_with_the_same_bits_and_the_same_meta() {
    let robot = Arc::new(RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the robot"));
    let walk = load_skill(&shipped(), "walk", &robot.description, ModelPolicy::Optional).expect("walk");
    let skill = RolledSkill::from_loaded(&walk, &robot).expect("it can be rolled out");
    let source = identity::source_sha256(&repository().join("plugins/gait")).expect("its sources");
    for kind in [Kind::Viability, Kind::Cot] {
        let kept = slice(kind);
        let layout = Layout { rows: 3, rows_per_shard: 3 };
        let collection = Collection {
            robot: &robot,
            skill: &skill,
            kind,
            config: &kept.meta.config,
            layout,
            shard: Shard::ALL,
            threads: 0,
            resume: false,
            plugin_source_sha256: source.clone(),
        };
        let meta =
            dataset::Meta { rows: layout.rows, rows_per_shard: layout.rows_per_shard, ..kept.meta.clone() };
        let text = |meta| serde_json::to_string(meta).expect("a text");
        assert_eq!(text(&collection.meta()), text(&meta), "{kind:?}");
        let folder = tempfile::tempdir().expect("a temporary folder");
        collection.run(folder.path(), &|_| {}).expect("collects");
        let again = dataset::read(folder.path()).expect("reads");
        for (at, row) in again.rows.iter().enumerate() {
            assert_eq!(*row, kept.rows[at], "{kind:?}");
            assert_eq!(again.fields[at], kept.fields[at], "{kind:?}, row {row}");
            assert_eq!(again.labels[at].to_bits(), kept.labels[at].to_bits(), "{kind:?}, row {row}");
            assert_eq!(again.successes[at], kept.successes[at], "{kind:?}, row {row}");
        }
        assert!(!again.is_empty());
    }
}

#[test]
fn the_document_names_every_column() {
    let document = fs::read_to_string(repository().join("docs/data.md")).expect("docs/data.md");
    let shard = folder(Kind::Cot).join(dataset::shard_file(0));
    let columns = dataset::columns(&shard).expect("a Parquet file");
    assert!(columns.len() > 15, "{columns:?}");
    for column in columns {
        assert!(document.contains(&format!("| `{column}` |")), "{column} is not in docs/data.md");
    }
}
