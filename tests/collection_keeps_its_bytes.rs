//! A row depends on the configuration and its own number alone: threads, shards, kills and the
//! moment of a kill change no byte of a data set.

use std::{
    collections::BTreeMap,
    fs,
    path::Path,
    sync::{
        Arc, OnceLock,
        atomic::{AtomicU64, Ordering},
    },
};

use vocaloco_core::{plugin::PluginLibrary, robot::RobotModel};
use vocaloco_sim::{
    collect::{CollectConfig, CollectError, Collected, Collection},
    dataset::{self, DatasetError, Kind, Layout, META_FILE, Meta, Shard, shard_file},
    rollout::RolledSkill,
};
use vocaloco_tests::{plugin_folder, shipped};

const LAYOUT: Layout = Layout { rows: 7, rows_per_shard: 2 };

fn robot() -> &'static Arc<RobotModel> {
    static ROBOT: OnceLock<Arc<RobotModel>> = OnceLock::new();
    ROBOT.get_or_init(|| {
        Arc::new(RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the shipped robot"))
    })
}

/// The gait with its default parameters: what it can do does not matter here.
fn skill() -> &'static RolledSkill {
    static SKILL: OnceLock<RolledSkill> = OnceLock::new();
    SKILL.get_or_init(|| {
        let library = PluginLibrary::open(&[plugin_folder().to_owned()], "gait").expect("gait loads");
        RolledSkill::new("trot", library, "", robot()).expect("gait's default parameters")
    })
}

/// Two rollouts of at most half a second, so that a row takes a tenth of a second.
fn config(kind: Kind, seed: u64) -> CollectConfig {
    let mut config = CollectConfig::new(kind, seed);
    config.repeats = config.repeats.min(2);
    config.rollout.horizon_m = 0.2;
    config.rollout.time_limit_s = 0.8;
    config
}

fn collection(config: &CollectConfig, kind: Kind) -> Collection<'_> {
    Collection {
        robot: robot(),
        skill: skill(),
        kind,
        config,
        layout: LAYOUT,
        shard: Shard::ALL,
        threads: 1,
        resume: false,
        plugin_source_sha256: None,
    }
}

fn run(collection: &Collection<'_>, folder: &Path) -> Result<Collected, CollectError> {
    collection.run(folder, &|_| {})
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn bytes(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| {
            let entry = entry.expect("an entry");
            let name = entry.file_name().to_string_lossy().into_owned();
            (name, fs::read(entry.path()).expect("a file"))
        })
        .collect()
}

fn assert_same(found: &Path, wanted: &Path) {
    let (found, wanted) = (bytes(found), bytes(wanted));
    let names: Vec<_> = found.keys().collect();
    assert_eq!(names, wanted.keys().collect::<Vec<_>>());
    for (name, bytes) in &wanted {
        let differs = found[name].iter().zip(bytes).position(|(a, b)| a != b);
        assert!(found[name] == *bytes, "{name} differs, first at byte {differs:?}");
    }
}

/// The whole data set, collected in one go on one thread.
fn whole(kind: Kind) -> &'static Path {
    static VIABILITY: OnceLock<tempfile::TempDir> = OnceLock::new();
    static COT: OnceLock<tempfile::TempDir> = OnceLock::new();
    let cell = if kind == Kind::Viability { &VIABILITY } else { &COT };
    cell.get_or_init(|| {
        let folder = folder();
        run(&collection(&config(kind, 1), kind), folder.path()).expect("collects");
        folder
    })
    .path()
}

#[test]
fn one_thread_and_two_give_the_same_bytes() {
    for kind in [Kind::Viability, Kind::Cot] {
        let config = config(kind, 1);
        let two = folder();
        run(&Collection { threads: 2, ..collection(&config, kind) }, two.path()).expect("collects");
        assert_same(two.path(), whole(kind));
    }
}

#[test]
fn rows_that_start_midway_in_a_rollout_repeat_on_any_number_of_threads() {
    let settled = config(Kind::Viability, 1);
    for midway in [
        CollectConfig { own_starts_share: Some(1.0), ..settled.clone() },
        CollectConfig { in_stride_share: Some(1.0), ..settled.clone() },
    ] {
        repeats_elsewhere_on_the_same_tiles(&midway);
    }
}

fn repeats_elsewhere_on_the_same_tiles(midway: &CollectConfig) {
    let (one, two) = (folder(), folder());
    run(&collection(midway, Kind::Viability), one.path()).expect("collects");
    run(&Collection { threads: 2, ..collection(midway, Kind::Viability) }, two.path()).expect("collects");
    assert_same(two.path(), one.path());
    let (moved, stood) =
        (dataset::read(one.path()).expect("reads"), dataset::read(whole(Kind::Viability)).expect("reads"));
    let differing = (0..moved.len()).filter(|row| moved.fields[*row] != stood.fields[*row]).count();
    assert!(differing >= 3, "{differing} of {} rows see other ground than the settled robot", moved.len());
    assert_eq!(moved.terrain, stood.terrain, "on the same tiles");
}

#[test]
fn a_share_of_the_rows_starts_midway_and_the_others_are_as_without() {
    let settled = config(Kind::Viability, 1);
    let some = CollectConfig { own_starts_share: Some(0.5), ..settled.clone() };
    let mixed = folder();
    run(&collection(&some, Kind::Viability), mixed.path()).expect("collects");
    let (mixed, stood) =
        (dataset::read(mixed.path()).expect("reads"), dataset::read(whole(Kind::Viability)).expect("reads"));
    let same = (0..mixed.len()).filter(|row| mixed.fields[*row] == stood.fields[*row]).count();
    assert!((1..mixed.len()).contains(&same), "{same} of {} rows start from the stand", mixed.len());
    let text = serde_json::to_string(&settled).expect("a text");
    assert!(!text.contains("own_starts"), "a collection without is as ever: {text}");
}

#[test]
fn a_killed_run_resumes_and_ends_with_the_same_bytes() {
    let config = config(Kind::Viability, 1);
    let killed = folder();
    // A kill in the middle of a row: nothing of the block that it was in may count.
    let rows = AtomicU64::new(0);
    let until_row_4 = |_| assert!(rows.fetch_add(1, Ordering::Relaxed) < 4, "killed");
    let kill = std::panic::catch_unwind(|| {
        let _ = collection(&config, Kind::Viability).run(killed.path(), &until_row_4);
    });
    assert!(kill.is_err(), "it was not killed");
    // A kill in the middle of a write leaves a piece of a file behind.
    let piece = &bytes(whole(Kind::Viability))[&shard_file(2)][..100];
    fs::write(killed.path().join(format!(".{}.partial", shard_file(2))), piece).expect("a piece");
    assert!(matches!(
        dataset::read(killed.path()),
        Err(DatasetError::Incomplete { missing: 2, wanted: 4, .. })
    ));
    let resumed = Collection { resume: true, ..collection(&config, Kind::Viability) };
    let collected = run(&resumed, killed.path()).expect("resumes");
    assert_eq!((collected.shards_kept, collected.shards_written), (2, 2));
    assert_same(killed.path(), whole(Kind::Viability));
}

#[test]
fn a_truncated_shard_is_made_again() {
    let config = config(Kind::Viability, 1);
    let broken = folder();
    for (name, bytes) in bytes(whole(Kind::Viability)) {
        let kept = if name == shard_file(1) { &bytes[..bytes.len() / 2] } else { &bytes[..] };
        fs::write(broken.path().join(name), kept).expect("a copy");
    }
    let resumed = Collection { resume: true, ..collection(&config, Kind::Viability) };
    assert_eq!(run(&resumed, broken.path()).expect("resumes").shards_written, 1);
    assert_same(broken.path(), whole(Kind::Viability));
}

#[test]
fn parts_collected_apart_merge_into_the_same_bytes() {
    let config = config(Kind::Viability, 1);
    let (first, second, merged) = (folder(), folder(), folder());
    for (part, folder) in [("1/2", &first), ("2/2", &second)] {
        let shard = Shard::parse(part).expect("a shard");
        run(&Collection { shard, ..collection(&config, Kind::Viability) }, folder.path()).expect("collects");
    }
    let parts = [second.path().to_owned(), first.path().to_owned()];
    assert_eq!(dataset::merge(&parts, merged.path()).expect("merges"), 4);
    assert_same(merged.path(), whole(Kind::Viability));
}

#[test]
fn seven_shards_in_shuffled_order_on_one_thread_or_two_merge_into_the_same_bytes() {
    let config = config(Kind::Viability, 1);
    let layout = Layout { rows_per_shard: 1, ..LAYOUT };
    let one_go = folder();
    let all = Collection { layout, ..collection(&config, Kind::Viability) };
    run(&all, one_go.path()).expect("collects");
    let mut parts = Vec::new();
    for (turn, index) in [3, 7, 1, 5, 2, 6, 4].into_iter().enumerate() {
        let shard = Shard::parse(&format!("{index}/7")).expect("a shard");
        let part = folder();
        run(&Collection { shard, threads: 1 + turn % 2, ..all.clone() }, part.path()).expect("collects");
        parts.push(part);
    }
    let merged = folder();
    let sources: Vec<_> = [4, 0, 6, 2, 5, 1, 3].map(|part: usize| parts[part].path().to_owned()).into();
    assert_eq!(dataset::merge(&sources, merged.path()).expect("merges"), 7);
    assert_same(merged.path(), one_go.path());
    let stored = dataset::stored(merged.path()).expect("counts");
    assert_eq!((stored.rows, stored.shards_missing), (7, 0));
}

#[test]
fn a_data_set_can_grow() {
    let config = config(Kind::Viability, 1);
    let grown = folder();
    let small = Layout { rows: 3, ..LAYOUT };
    run(&Collection { layout: small, ..collection(&config, Kind::Viability) }, grown.path())
        .expect("collects");
    assert_eq!(dataset::read(grown.path()).expect("reads").len(), 3);
    let resumed = Collection { resume: true, ..collection(&config, Kind::Viability) };
    // The second file held one row and stands for two now.
    assert_eq!(run(&resumed, grown.path()).expect("resumes").shards_kept, 1);
    assert_same(grown.path(), whole(Kind::Viability));
}

#[test]
fn what_was_made_of_something_else_is_not_continued() {
    let kept = folder();
    for (name, bytes) in bytes(whole(Kind::Viability)) {
        fs::write(kept.path().join(name), bytes).expect("a copy");
    }
    let refusal = |config: &CollectConfig, resume: bool| {
        let again = Collection { resume, ..collection(config, Kind::Viability) };
        run(&again, kept.path()).expect_err("a refusal").to_string()
    };
    let mut other = config(Kind::Viability, 1);
    assert!(refusal(&other, false).contains("--resume"), "without --resume nothing is written over");
    other.patch_noise_m = 0.03;
    let line = refusal(&other, true);
    assert!(line.contains("config.patch_noise_m: found 0.02, wanted 0.03"), "{line}");
    let line = refusal(&config(Kind::Viability, 2), true);
    assert!(line.contains("config.seed: found 1, wanted 2"), "{line}");
    assert_same(kept.path(), whole(Kind::Viability));
}

#[test]
fn what_is_read_is_what_was_collected() {
    let viability = dataset::read(whole(Kind::Viability)).expect("reads");
    assert_eq!(viability.rows, (0..7).collect::<Vec<_>>());
    for row in 0..viability.len() {
        let field = &viability.fields[row];
        assert!(field.iter().all(|h| h.is_finite() && h.abs() <= 1.2), "row {row}");
        assert_eq!(field[15 * 11 + 5], 0.0, "row {row} is centred");
        assert_eq!(viability.rollouts[row], 2);
        let share = viability.successes[row] as f32 / 2.0;
        assert_eq!(viability.labels[row], share, "row {row}");
    }
    let cost = dataset::read(whole(Kind::Cot)).expect("reads");
    assert!(!cost.is_empty());
    for row in 0..cost.len() {
        assert!(!cost.trainable[row] || cost.labels[row] > 0.0, "row {row}: {}", cost.labels[row]);
    }
    // A pose does not depend on what is collected from it.
    for (row, number) in cost.rows.iter().enumerate() {
        assert_eq!(cost.fields[row], viability.fields[*number as usize], "row {number}");
    }
}

#[test]
fn a_damaged_data_set_is_refused_by_name() {
    let copy = folder();
    for (name, bytes) in bytes(whole(Kind::Viability)) {
        fs::write(copy.path().join(name), bytes).expect("a copy");
    }
    let meta = fs::read_to_string(copy.path().join(META_FILE)).expect("a meta");
    for (found, replaced, named) in [
        ("\"schema\": 1", "\"schema\": 2", "schema: found 2, wanted 1"),
        ("\"repeats\": 2", "\"repeats\": 2, \"retries\": 1", "retries"),
        ("\"rows_per_shard\": 2", "\"rows_per_shard\": 0", "rows_per_shard"),
    ] {
        assert!(meta.contains(found), "{found} in {meta}");
        fs::write(copy.path().join(META_FILE), meta.replace(found, replaced)).expect("a meta");
        let line = dataset::read(copy.path()).expect_err("a refusal").to_string();
        assert!(line.contains(META_FILE) && line.contains(named), "{line}");
    }
    fs::remove_file(copy.path().join(META_FILE)).expect("removed");
    assert!(Meta::read(copy.path()).expect_err("a refusal").to_string().contains(META_FILE));
}
