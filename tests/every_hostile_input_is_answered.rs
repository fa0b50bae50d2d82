//! Whatever is fed to a door that takes bytes from outside, it answers: with what it read or with an
//! error. The corpora under `tests/fuzz/corpus`, the shipped files, inputs made to hurt, and thousands of
//! fixed mutations of all of them; `VOCALOCO_MUTATIONS=100` tries a hundred times as many.

#[path = "fuzz/targets.rs"]
mod targets;

use std::fs;
use std::io::Write as _;
use std::path::PathBuf;

use flate2::Compression;
use flate2::write::GzEncoder;
use vocaloco_core::bundle::pack;
use vocaloco_tests::{Fixture, constant_model, repository};

use targets::{PART, TARGETS, Target};

/// Largest input that is mutated, bytes: beyond, a mutation costs more than it finds.
const MUTATED_BYTES: usize = 64 << 10;

fn shipped(path: &str) -> Vec<u8> {
    fs::read(repository().join(path)).expect(path)
}

/// The committed inputs of a target.
fn corpus(name: &str) -> Vec<PathBuf> {
    let folder = repository().join("tests/fuzz/corpus").join(name);
    let entries = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    files.sort();
    files
}

/// Inputs of a target: committed ones, shipped ones, and some made to hurt.
fn seeds(name: &str) -> Vec<Vec<u8>> {
    let mut seeds = vec![Vec::new(), vec![0; 64], vec![0xff; 64]];
    seeds.extend(corpus(name).iter().map(|file| fs::read(file).expect("a file")));
    let nested = |open: &str, inner: &str, close: &str, depth: usize| {
        [open.repeat(depth), inner.to_owned(), close.repeat(depth)].concat().into_bytes()
    };
    match name {
        "manifest" => {
            seeds.push(shipped("manifests/skills/ascend.toml"));
            seeds.push([b"schema = ".to_vec(), nested("[", "1", "]", 20_000)].concat());
            seeds.push([b"schema = ".to_vec(), nested("{a=", "1", "}", 20_000)].concat());
            seeds.push([b"schema.".to_vec(), b"a.".repeat(20_000), b"b = 1".to_vec()].concat());
        }
        "deployment" => {
            seeds.push(shipped("manifests/deployments/anymal_stairs.toml"));
            seeds.push([b"skills = ".to_vec(), nested("[", "", "]", 20_000)].concat());
        }
        "robot" => {
            let [mjcf, settings] =
                ["xml", "toml"].map(|kind| shipped(&format!("manifests/robots/anymal_d.{kind}")));
            seeds.push([mjcf, PART.to_vec(), settings.clone()].concat());
            let deep = nested("<body name=\"a\">", "", "</body>", 20_000);
            seeds.push(
                [
                    b"<mujoco><worldbody>".to_vec(),
                    deep,
                    b"</worldbody></mujoco>".to_vec(),
                    PART.to_vec(),
                    settings.clone(),
                ]
                .concat(),
            );
            let bomb = b"<!DOCTYPE m [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;\"><!ENTITY c \"&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;\">]><mujoco model=\"&c;&c;&c;\"/>";
            seeds.push([bomb.to_vec(), PART.to_vec(), settings].concat());
        }
        "model" => {
            seeds.push(constant_model("viability", 0.9));
            seeds.push(constant_model("cot", 0.3));
            seeds.push(shipped("skills/walk/cot.onnx"));
            // A graph of a million empty nodes.
            seeds.push([vec![0x3a, 0x80, 0x80, 0x80, 0x01], [0x0a, 0].repeat(1 << 20)].concat());
        }
        "heightfield" => {
            for height_m in [0.1, f32::NAN, f32::INFINITY, f32::MAX, -f32::MAX, 1e-45] {
                seeds.push(height_m.to_le_bytes().repeat(31 * 11));
            }
            let mut mixed: Vec<u8> = (0..31 * 11)
                .flat_map(|cell| if cell % 3 == 0 { f32::NAN } else { 0.01 * cell as f32 }.to_le_bytes())
                .collect();
            mixed.extend([0.0_f32, 0.0, 0.1, 1.0, 2.0, 0.5].iter().flat_map(|number| number.to_le_bytes()));
            seeds.push(mixed);
        }
        "line" => {
            seeds.push(nested("[", "", "]", 100_000));
            seeds.push(nested("{\"a\":", "1", "}", 100_000));
        }
        "bundle" => {
            let source = Fixture::new();
            source.add_skill("hold", "none", 0.97, 0.3);
            let file = source.root().join("hold.skill");
            pack(&source.installation(), "hold", &file, None).expect("packed");
            seeds.push(fs::read(&file).expect("a bundle"));
            let mut bomb = GzEncoder::new(Vec::new(), Compression::best());
            for _ in 0..300 {
                bomb.write_all(&vec![0; 1 << 20]).expect("written");
            }
            seeds.push(bomb.finish().expect("packed zeros"));
        }
        _ => {}
    }
    seeds
}

/// A fixed sequence of numbers that looks random.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, end: usize) -> usize {
        // splitmix64.
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) % end.max(1) as u64) as usize
    }
}

fn mutate(input: &[u8], numbers: &mut Numbers) -> Vec<u8> {
    let mut bytes = input.to_vec();
    for _ in 0..=numbers.below(4) {
        let at = numbers.below(bytes.len());
        let end = (at + numbers.below(32)).min(bytes.len());
        match numbers.below(7) {
            _ if bytes.is_empty() => bytes.push(numbers.below(256) as u8),
            0 => bytes[at] ^= 1 << numbers.below(8),
            1 => bytes[at] = [0, 1, 0x7f, 0x80, 0xff, b'\n', b'"', b'-'][numbers.below(8)],
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..end)),
            4 => {
                let piece = bytes[at..end].to_vec();
                let to = numbers.below(bytes.len());
                bytes.splice(to..to, piece);
            }
            5 => {
                let word = [&b"nan"[..], b"inf", b"1e400", b"-1", b"99999999999999999999", b"../", b"\0"]
                    [numbers.below(7)];
                bytes.splice(at..end, word.iter().copied());
            }
            _ => bytes[at] = numbers.below(256) as u8,
        }
    }
    bytes
}

fn answered(name: &str, mutations: usize) {
    let target: Target = TARGETS.iter().find(|(known, _)| *known == name).expect("a target").1;
    let seeds = seeds(name);
    for seed in &seeds {
        target(seed);
    }
    let small: Vec<&Vec<u8>> = seeds.iter().filter(|seed| seed.len() <= MUTATED_BYTES).collect();
    let mut numbers = Numbers(7);
    let times = std::env::var("VOCALOCO_MUTATIONS").ok().and_then(|times| times.parse().ok()).unwrap_or(1);
    for number in 0..mutations * times {
        let input = mutate(small[numbers.below(small.len())], &mut numbers);
        let outcome = std::panic::catch_unwind(|| target(&input));
        assert!(outcome.is_ok(), "{name}: mutation {number}: {}", input.escape_ascii());
    }
}

#[test]
fn manifests() {
    answered("manifest", 5000);
    answered("deployment", 5000);
}

#[test]
fn robots() {
    answered("robot", 500);
}

#[test]
fn models() {
    answered("model", 1500);
}

#[test]
fn heightfields() {
    answered("heightfield", 5000);
}

#[test]
fn lines() {
    answered("line", 5000);
}

#[test]
fn bundles_and_signatures() {
    answered("bundle", 1500);
    answered("archive", 3000);
    answered("signature", 5000);
}

#[test]
fn every_target_has_a_corpus() {
    for (name, _) in TARGETS {
        assert!(!corpus(name).is_empty(), "{name}: an empty folder");
    }
}

#[test]
fn every_corpus_has_a_target() {
    for entry in fs::read_dir(repository().join("tests/fuzz/corpus")).expect("corpora") {
        let name = entry.expect("an entry").file_name();
        assert!(TARGETS.iter().any(|(known, _)| name == *known), "{}", name.display());
    }
}
