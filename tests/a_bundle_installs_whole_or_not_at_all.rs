//! A skill packed into one file is installed on an installation that never saw its source, and runs
//! there; a bundle that is not what it should be leaves the installation as it was.

use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use vocaloco_core::bundle::{install, pack, remove};
use vocaloco_core::installation::Installation;
use vocaloco_core::lock::{PublicKey, SecretKey, sha256_hex};
use vocaloco_core::plugin::library_file_name;
use vocaloco_core::registry::load_deployment;
use vocaloco_core::staging::Stage;
use vocaloco_tests::{Fixture, snapshot};

/// The bundle of a sound skill `hold`, in a folder of its own.
fn packed(key: Option<&SecretKey>) -> (tempfile::TempDir, PathBuf) {
    let source = Fixture::new();
    source.add_skill("hold", "none", 0.97, 0.3);
    source.write("skills/hold/CARD.md", b"# hold\n");
    source.write("skills/hold/notes.txt", b"not for others");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("hold.skill");
    pack(&source.installation(), "hold", &file, key).expect("packed");
    (folder, file)
}

/// An installation with robots and no plugin path: a machine that never saw a source.
fn bare() -> (Fixture, Installation) {
    let fixture = Fixture::new();
    let installation = Installation { root: fixture.root().to_owned(), plugin_path: Vec::new() };
    (fixture, installation)
}

fn key() -> SecretKey {
    SecretKey::generate().expect("randomness")
}

/// The refusal of a bundle by a bare installation, which stays as it was.
fn refused(bundle: &Path, keys: &[PublicKey], parts: &[&str]) {
    let (_fixture, installation) = bare();
    let before = snapshot(&installation.root);
    let line = install(&installation, bundle, keys).expect_err("a refusal").to_string();
    eprintln!("{line}");
    assert!(!line.contains('\n') && line.len() < 600, "one readable line: {line}");
    for part in ["found ", "wanted "].iter().chain(parts) {
        assert!(line.contains(part), "{part:?} is not in: {line}");
    }
    let after = snapshot(&installation.root);
    assert!(before.keys().eq(after.keys()) && before == after, "nothing is left behind: {:?}", after.keys());
}

/// An entry of a tar: path as written in the header, type, content.
type Entry = (Vec<u8>, tar::EntryType, Vec<u8>);

fn entries(bundle: &Path) -> Vec<Entry> {
    let bytes = fs::read(bundle).expect("a bundle");
    let mut archive = tar::Archive::new(GzDecoder::new(bytes.as_slice()));
    let read = |entry: std::io::Result<tar::Entry<'_, _>>| {
        let mut entry = entry.expect("an entry");
        let mut content = Vec::new();
        entry.read_to_end(&mut content).expect("content");
        (entry.path_bytes().into_owned(), entry.header().entry_type(), content)
    };
    archive.entries().expect("entries").map(read).collect()
}

/// A bundle of these entries, whatever their paths: a header takes any bytes.
fn write(bundle: &Path, entries: &[Entry]) {
    let mut tar = tar::Builder::new(GzEncoder::new(Vec::new(), Compression::fast()));
    for (path, kind, content) in entries {
        let mut header = tar::Header::new_ustar();
        header.as_old_mut().name[..path.len()].copy_from_slice(path);
        header.set_entry_type(*kind);
        header.set_size(content.len() as u64);
        header.set_mode(0o644);
        if kind.is_symlink() || kind.is_hard_link() {
            header.set_link_name("/etc/passwd").expect("a link");
        }
        header.set_cksum();
        tar.append(&header, content.as_slice()).expect("appended");
    }
    fs::write(bundle, tar.into_inner().and_then(GzEncoder::finish).expect("a bundle")).expect("written");
}

/// A bundle spoiled in its entries.
fn spoiled(spoil: impl FnOnce(&mut Vec<Entry>), parts: &[&str]) {
    let (_folder, bundle) = packed(None);
    let mut all = entries(&bundle);
    spoil(&mut all);
    write(&bundle, &all);
    refused(&bundle, &[], parts);
}

/// A bundle whose lock has `path` with `content` too.
fn with_file(path: &str, kind: tar::EntryType, content: &[u8], parts: &[&str]) {
    spoiled(
        |entries| {
            let line = format!("\"{path}\" = \"{}\"\n", sha256_hex(content));
            entries[0].2.extend(line.as_bytes());
            entries.push((path.as_bytes().to_vec(), kind, content.to_vec()));
        },
        parts,
    );
}

#[test]
fn a_bundle_rewritten_unchanged_is_installed() {
    let (_folder, bundle) = packed(None);
    write(&bundle, &entries(&bundle));
    let (_fixture, installation) = bare();
    install(&installation, &bundle, &[]).expect("installed");
}

#[test]
fn a_packed_skill_runs_where_its_source_never_was() {
    let (_folder, bundle) = packed(None);
    let (fixture, installation) = bare();
    fixture.add_deployment("one", &["hold"]);
    load_deployment(&installation, "one").expect_err("not there yet");
    let installed = install(&installation, &bundle, &[]).expect("installed");
    assert_eq!((installed.skill.as_str(), installed.files, installed.signed), ("hold", 6, false));
    let loaded = load_deployment(&installation, "one").expect("sound");
    let skill = &loaded.skills[0];
    assert!(skill.library.file().ends_with(library_file_name("faulty")));
    skill.create(&loaded.robot.description).expect("an instance");
    assert!(!fixture.root().join("skills/hold/notes.txt").exists(), "what no manifest names is not packed");
    assert_eq!(fs::read(fixture.root().join("skills/hold/CARD.md")).expect("the card"), b"# hold\n");

    remove(&installation, "hold").expect("removed");
    assert!(!fixture.root().join("skills/hold").exists());
    load_deployment(&installation, "one").expect_err("gone");
    install(&installation, &bundle, &[]).expect("installed again");
}

#[test]
fn the_same_skill_packs_to_the_same_bytes() {
    let [(_one, first), (_two, second)] = [packed(None), packed(None)];
    assert_eq!(fs::read(first).expect("a bundle"), fs::read(second).expect("a bundle"));
}

#[test]
fn a_name_that_is_taken_is_refused() {
    let (_folder, bundle) = packed(None);
    for taken in ["manifests/skills/hold.toml", "skills/hold/training.toml"] {
        let (fixture, installation) = bare();
        fixture.write(taken, b"mine");
        let before = snapshot(fixture.root());
        let line = install(&installation, &bundle, &[]).expect_err("taken").to_string();
        assert!(line.contains("\"hold\", taken by ") && line.contains("skills remove"), "{line}");
        assert_eq!(before, snapshot(fixture.root()));
    }
    let (_fixture, installation) = bare();
    install(&installation, &bundle, &[]).expect("installed");
    install(&installation, &bundle, &[]).expect_err("taken by itself");
}

/// A link that leads nowhere is no file, and a name all the same: what is written through it lands elsewhere.
#[cfg(unix)]
#[test]
fn a_name_that_a_link_has_is_taken_wherever_it_leads() {
    let (_folder, bundle) = packed(None);
    for taken in ["manifests/skills/hold.toml", "skills/hold"] {
        let (fixture, installation) = bare();
        let link = fixture.root().join(taken);
        fs::create_dir_all(link.parent().expect("a folder")).expect("a folder");
        std::os::unix::fs::symlink("/nowhere/at/all", &link).expect("a link");
        let before = snapshot(fixture.root());
        let line = install(&installation, &bundle, &[]).expect_err("taken").to_string();
        assert!(line.contains("\"hold\", taken by "), "{line}");
        assert_eq!(before, snapshot(fixture.root()));
    }
}

/// The folder is renamed into place before the manifest: where the second rename fails (here onto another file
/// system), the first is undone.
#[cfg(target_os = "linux")]
#[test]
fn an_installation_that_fails_half_way_is_undone() {
    let (_folder, bundle) = packed(None);
    let (fixture, installation) = bare();
    let elsewhere = tempfile::tempdir_in("/dev/shm").expect("another file system");
    fs::create_dir_all(fixture.root().join("skills")).expect("a folder");
    std::os::unix::fs::symlink(elsewhere.path(), fixture.root().join("manifests/skills")).expect("a link");
    let before = snapshot(fixture.root());
    let line = install(&installation, &bundle, &[]).expect_err("no rename").to_string();
    assert!(line.contains("manifests/skills/hold.toml: rename"), "{line}");
    assert_eq!(before, snapshot(fixture.root()));
    assert!(fs::read_dir(elsewhere.path()).expect("a folder").next().is_none());
}

/// A plugin's initialiser may have ended the process that installed it.
#[cfg(unix)]
#[test]
fn what_a_killed_installation_has_left_goes_with_the_next_and_one_at_work_stays() {
    let (_folder, bundle) = packed(None);
    let (fixture, installation) = bare();
    fixture.write(".staging-killed/skills/hold/lock.toml", b"");
    let at_work = Stage::new(fixture.root(), Vec::new()).expect("a stage");
    install(&installation, &bundle, &[]).expect("a sound bundle");
    assert!(!fixture.root().join(".staging-killed").exists());
    assert!(at_work.installation().root.exists());
}

/// What unpacks without end is read up to the limit and no further.
#[test]
fn zeros_without_end_are_refused() {
    let (_folder, bundle) = packed(None);
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    let zeros = vec![0; 1 << 20];
    for _ in 0..300 {
        encoder.write_all(&zeros).expect("written");
    }
    fs::write(&bundle, encoder.finish().expect("a bundle")).expect("written");
    refused(&bundle, &[], &["hold.skill"]);

    // The same behind a header that promises all of it.
    let mut header = tar::Header::new_gnu();
    header.set_path("bundle.lock").expect("a path");
    header.set_entry_type(tar::EntryType::Regular);
    header.set_size(1 << 40);
    header.set_cksum();
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(header.as_bytes()).expect("written");
    for _ in 0..300 {
        encoder.write_all(&zeros).expect("written");
    }
    fs::write(&bundle, encoder.finish().expect("a bundle")).expect("written");
    refused(&bundle, &[], &["bundle.lock", "1099511627776 bytes", "at most 134217728 bytes in all"]);
}

#[test]
fn a_path_out_of_the_skills_place_is_refused() {
    for path in [
        "../outside.txt",
        "skills/hold/../../outside.txt",
        "/etc/outside.txt",
        "skills/other/outside.txt",
        "manifests/deployments/anymal_stairs.toml",
        "manifests/skills/walk.toml",
        "skills/hold",
        "skills/hold/.hidden",
        "skills/hold//x",
        "skills/hold/bundle.lock",
    ] {
        with_file(path, tar::EntryType::Regular, b"x", &["entry", "inside skills/hold/"]);
    }
}

#[test]
fn a_path_that_only_the_archive_has_is_refused() {
    for path in ["../outside.txt", "/etc/outside.txt", "skills/hold/extra.txt"] {
        spoiled(
            |entries| entries.push((path.into(), tar::EntryType::Regular, b"x".to_vec())),
            &["entry", path],
        );
    }
}

#[test]
fn links_and_other_kinds_are_refused() {
    for kind in [
        tar::EntryType::Symlink,
        tar::EntryType::Link,
        tar::EntryType::Directory,
        tar::EntryType::Fifo,
        tar::EntryType::Char,
        tar::EntryType::GNUSparse,
        tar::EntryType::GNULongName,
        tar::EntryType::XHeader,
    ] {
        with_file("skills/hold/link", kind, b"", &["entry", "plain files alone"]);
    }
}

#[test]
fn a_file_that_is_not_as_locked_is_refused() {
    for index in 1..7 {
        spoiled(
            |entries| {
                let content = &mut entries[index].2;
                let middle = content.len() / 2;
                content[middle] ^= 1;
            },
            &["sha256 of ", "as its lock has it"],
        );
    }
}

#[test]
fn a_file_that_is_missing_or_there_twice_is_refused() {
    spoiled(|entries| drop(entries.pop()), &["entry", "found no ", "every file that its lock has"]);
    spoiled(|entries| entries.push(entries[2].clone()), &["twice", "every file once"]);
}

#[test]
fn a_small_file_that_unpacks_to_much_is_refused() {
    let (_folder, bundle) = packed(None);
    let mut all = entries(&bundle);
    // Two entries of 100 MB of zeros each: 200 kB packed.
    for name in ["skills/hold/a", "skills/hold/b"] {
        let zeros = vec![0; 100 << 20];
        all[0].2.extend(format!("\"{name}\" = \"{}\"\n", sha256_hex(&zeros)).as_bytes());
        all.push((name.into(), tar::EntryType::Regular, zeros));
    }
    write(&bundle, &all);
    assert!(fs::metadata(&bundle).expect("a bundle").len() < 4 << 20);
    refused(&bundle, &[], &["skills/hold/b", "104857600 bytes", "at most 134217728 bytes in all"]);
}

#[test]
fn an_entry_that_promises_more_than_there_is_is_refused() {
    let (_folder, bundle) = packed(None);
    let mut header = tar::Header::new_ustar();
    header.set_path("bundle.lock").expect("a path");
    header.set_entry_type(tar::EntryType::Regular);
    header.set_size(100 << 20);
    header.set_cksum();
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(header.as_bytes()).expect("written");
    fs::write(&bundle, encoder.finish().expect("a bundle")).expect("written");
    refused(&bundle, &[], &["bundle.lock"]);
}

#[test]
fn many_entries_are_refused() {
    spoiled(
        |entries| {
            for number in 0..40 {
                let path = format!("skills/hold/{number}");
                entries[0].2.extend(format!("\"{path}\" = \"{}\"\n", sha256_hex(b"x")).as_bytes());
                entries.push((path.into(), tar::EntryType::Regular, b"x".to_vec()));
            }
        },
        &["files", "at most 32"],
    );
}

#[test]
fn what_is_no_bundle_is_refused() {
    let (_folder, bundle) = packed(None);
    let whole = fs::read(&bundle).expect("a bundle");
    for bytes in [&b""[..], b"not gzip", &whole[..whole.len() / 2], &whole[..30]] {
        fs::write(&bundle, bytes).expect("written");
        refused(&bundle, &[], &["hold.skill"]);
    }
    spoiled(|entries| drop(entries.remove(0)), &["entry", "bundle.lock first"]);
}

#[test]
fn another_platform_interface_or_schema_is_refused() {
    for (from, to, field) in [
        (format!("-{}", std::env::consts::OS), "-amiga".to_owned(), "platform"),
        ("schema = 1".to_owned(), "schema = 2".to_owned(), "schema"),
        ("interface = ".to_owned(), "interface = 9".to_owned(), "interface"),
        ("skill = \"hold\"".to_owned(), "skill = \"../hold\"".to_owned(), "skill"),
    ] {
        spoiled(
            |entries| {
                let text = String::from_utf8(entries[0].2.clone()).expect("text");
                assert!(text.contains(&from), "{from} is in {text}");
                entries[0].2 = text.replacen(&from, &to, 1).into_bytes();
            },
            &[field],
        );
    }
}

#[test]
fn an_unsound_skill_is_refused_though_its_hashes_are_right() {
    spoiled(
        |entries| {
            let model = entries.iter_mut().find(|entry| entry.0.ends_with(b"cot.onnx")).expect("a model");
            let (before, after) = (sha256_hex(&model.2), sha256_hex(b"no model"));
            model.2 = b"no model".to_vec();
            let text = String::from_utf8(entries[0].2.clone()).expect("text");
            entries[0].2 = text.replace(&before, &after).into_bytes();
        },
        &["skills/hold/cot.onnx"],
    );
}

#[test]
fn an_unsound_skill_is_not_packed() {
    let source = Fixture::new();
    source.add_skill("hold", "none", 0.97, 0.3);
    source.write("skills/hold/cot.onnx", b"no model");
    let file = source.root().join("hold.skill");
    pack(&source.installation(), "hold", &file, None).expect_err("unsound");
    assert!(!file.exists());
}

#[test]
fn a_signature_by_a_trusted_key_is_taken_and_any_other_refused() {
    let (mine, foreign) = (key(), key());
    let trusted = [mine.public()];
    let (_folder, bundle) = packed(Some(&mine));
    let (fixture, installation) = bare();
    assert!(install(&installation, &bundle, &trusted).expect("trusted").signed);
    assert!(fixture.root().join("skills/hold/bundle.lock.sig").is_file());
    remove(&installation, "hold").expect("removed");

    let (_folder, unsigned) = packed(None);
    refused(&unsigned, &trusted, &["signature", "found nothing"]);
    let (_folder, by_another) = packed(Some(&foreign));
    refused(&by_another, &trusted, &["signature", "which is not listed"]);
    let (_folder, changed) = packed(Some(&mine));
    let mut all = entries(&changed);
    all[0].2.push(b'\n');
    write(&changed, &all);
    refused(&changed, &trusted, &["signature", "of other bytes"]);
}

#[test]
fn a_skill_that_this_host_could_not_load_any_more_is_still_removed() {
    let (_folder, bundle) = packed(None);
    let (fixture, installation) = bare();
    install(&installation, &bundle, &[]).expect("installed");
    fixture.alter("skills/hold/bundle.lock", "interface = ", "interface = 9");
    remove(&installation, "hold").expect("removed");
    assert!(!fixture.root().join("skills/hold").exists());
    assert!(!fixture.root().join("manifests/skills/hold.toml").exists());
}

#[test]
fn only_what_a_bundle_has_brought_is_removed() {
    let (fixture, installation) = bare();
    fixture.add_skill("own", "none", 0.97, 0.3);
    let line = remove(&installation, "own").expect_err("not from a bundle").to_string();
    assert!(line.contains("skills/own/bundle.lock"), "{line}");
    remove(&installation, "../manifests").expect_err("no name");

    let (_folder, bundle) = packed(None);
    install(&installation, &bundle, &[]).expect("installed");
    fixture.write("skills/hold/measurements.csv", b"a month of work");
    let before = snapshot(fixture.root());
    let line = remove(&installation, "hold").expect_err("more than the bundle's").to_string();
    assert!(line.contains("measurements.csv") && line.contains("its bundle has brought"), "{line}");
    assert_eq!(before, snapshot(fixture.root()));
}
