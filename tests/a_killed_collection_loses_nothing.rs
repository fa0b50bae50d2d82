//! `collect` as a process, killed at moments drawn over its whole run, again and again: resumed, it ends
//! with the bytes of one that was never killed. `VOCALOCO_KILLS` asks for more kills than the few of a
//! normal run.

use std::{
    collections::BTreeMap,
    fs,
    path::Path,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use vocaloco_sim::stream::{stream, uniform};
use vocaloco_tests::{plugin_folder, repository};

/// Kills of a normal run.
const KILLS: u32 = 8;
/// Kills after which what is there is thrown away, so that early moments are met too.
const KILLS_TO_A_FOLDER: u32 = 4;

/// Starts a collection of 24 rows in 8 shards, on one thread or two by turns.
fn start(out: &Path, turn: u32) -> Child {
    let threads = ["1", "2"][turn as usize % 2];
    Command::new(plugin_folder().join("vocaloco"))
        .args(["collect", "--skill", "walk", "--kind", "cot", "--plant", "fast", "--samples", "24"])
        .args(["--rows-per-shard", "3", "--resume", "--threads", threads, "--out"])
        .arg(out)
        .env("VOCALOCO_ROOT", repository())
        .env("VOCALOCO_PLUGIN_PATH", plugin_folder())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the program starts")
}

fn finish(out: &Path, turn: u32) {
    let status = start(out, turn).wait().expect("it ends");
    assert!(status.success(), "{status}");
}

/// All files of the data set but the log of its runs.
fn bytes(out: &Path) -> BTreeMap<String, Vec<u8>> {
    fs::read_dir(out.join("walk/cot"))
        .expect("a data set")
        .map(|entry| entry.expect("an entry"))
        .map(|entry| (entry.file_name().to_string_lossy().into_owned(), entry.path()))
        .filter(|(name, _)| name != "runs.jsonl")
        .map(|(name, path)| (name, fs::read(path).expect("a file")))
        .collect()
}

fn shards(out: &Path) -> usize {
    let Ok(entries) = fs::read_dir(out.join("walk/cot")) else { return 0 };
    let names = entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned());
    names.filter(|name| name.starts_with("shard-")).count()
}

#[test]
fn killed_at_any_moment_and_resumed_it_ends_with_the_same_bytes() {
    let kills =
        std::env::var("VOCALOCO_KILLS").map_or(KILLS, |text| text.parse().expect("a number of kills"));
    let folder = tempfile::tempdir().expect("a temporary folder");
    // Building belongs to no run.
    plugin_folder();
    let whole = folder.path().join("whole");
    #[expect(clippy::disallowed_methods, reason = "kills are drawn over the time that a run takes")]
    let began = Instant::now();
    finish(&whole, 0);
    let run_s = began.elapsed().as_secs_f32();
    let whole = bytes(&whole);
    assert_eq!(whole.len(), 9, "{:?}", whole.keys());

    let mut moments = stream(1, "kills", &[]);
    let (mut cut_short, mut kept) = (0, 0);
    for first in (0..kills).step_by(KILLS_TO_A_FOLDER as usize) {
        let killed = folder.path().join(format!("killed-{first}"));
        for turn in first..kills.min(first + KILLS_TO_A_FOLDER) {
            let mut child = start(&killed, turn);
            std::thread::sleep(Duration::from_secs_f32(uniform(&mut moments, 0.0, run_s)));
            cut_short += u32::from(child.try_wait().expect("a status").is_none());
            child.kill().expect("the kill");
            child.wait().expect("it ends");
            let there = shards(&killed);
            kept += u32::from((1..8).contains(&there));
        }
        finish(&killed, first);
        let killed = bytes(&killed);
        assert_eq!(killed.keys().collect::<Vec<_>>(), whole.keys().collect::<Vec<_>>());
        for (name, wanted) in &whole {
            let differs = killed[name].iter().zip(wanted).position(|(a, b)| a != b);
            assert!(killed[name] == *wanted, "{name} after kills {first} and on: first at byte {differs:?}");
        }
    }
    // Kills that all come too early or too late would prove nothing.
    assert!(cut_short > 0 && kept > 0, "{cut_short} of {kills} cut a run short, {kept} left some shards");
}
