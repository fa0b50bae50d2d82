//! A locked deployment takes no byte but those that were locked: one bit flipped in a plugin, a model
//! or a manifest is refused with file, field, found and wanted; so is a lock without the signature
//! that the deployment demands. What was checked is what is loaded, whatever becomes of the file.

use std::fs;

use vocaloco_core::lock::{Lock, SecretKey, sha256_hex};
use vocaloco_core::plugin::{PluginLibrary, library_file_name};
use vocaloco_core::registry::{
    LoadError, LoadedDeployment, Refusal, load_deployment, load_locked, lock_deployment,
};
use vocaloco_core::robot::RobotModel;
use vocaloco_tests::{Fixture, plugin_folder};

const DEPLOYMENT: &str = "manifests/deployments/two.toml";

/// An installation of two skills and its own copy of their plugin.
fn installation() -> Fixture {
    let mut fixture = Fixture::new();
    fixture.add_skill("first", "none", 0.97, 0.3);
    fixture.add_skill("second", "none", 0.97, 0.4);
    fixture.add_deployment("two", &["first", "second"]);
    let library = library_file_name("faulty");
    let bytes = fs::read(plugin_folder().join(&library)).expect("a built plugin");
    fixture.write(&format!("plugins/{library}"), &bytes);
    // The second skill has its own copy, as an installed bundle has.
    fixture.write(&format!("skills/second/{library}"), &bytes);
    fixture.search_first("plugins");
    fixture
}

fn locked(fixture: &Fixture, key: Option<&SecretKey>) -> Lock {
    let lock = lock_deployment(&fixture.installation(), "two").expect("sound");
    lock.write(key).expect("written");
    lock
}

fn load(fixture: &Fixture) -> Result<LoadedDeployment, LoadError> {
    let installation = fixture.installation();
    let lock = Lock::read(&installation, "two").map_err(LoadError::Lock)?;
    load_locked(&installation, "two", &lock)
}

/// Flips the lowest bit of the byte in the middle of a file.
fn flip(fixture: &Fixture, path: &str) {
    let mut bytes = fs::read(fixture.root().join(path)).expect("a file");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fixture.write(path, &bytes);
}

fn is_about(line: &str, path: &str) {
    eprintln!("{line}");
    for part in [path, "sha256: found ", ", wanted ", "as two.lock has it"] {
        assert!(line.contains(part), "{part:?} is not in: {line}");
    }
}

/// The one refusal after `path` is spoiled; the other skill goes on.
fn refusal(path: &str) -> Refusal {
    let fixture = installation();
    locked(&fixture, None);
    assert_eq!(load(&fixture).expect("as locked").skills.len(), 2);
    flip(&fixture, path);
    let loaded = load(&fixture).expect("one skill is left");
    let names: Vec<&str> = loaded.skills.iter().map(|skill| skill.manifest.name.as_str()).collect();
    assert_eq!(names, ["first"]);
    let [refusal] = loaded.refused.as_slice() else { panic!("one refusal, not {:?}", loaded.refused) };
    is_about(&refusal.to_string(), path);
    refusal.clone()
}

#[test]
fn a_bit_flipped_in_a_plugin_is_refused() {
    let library = format!("skills/second/{}", library_file_name("faulty"));
    assert_eq!(refusal(&library).skill, "second");
}

#[test]
fn a_bit_flipped_in_a_model_is_refused() {
    for model in ["viability.onnx", "cot.onnx", "fault.txt"] {
        assert_eq!(refusal(&format!("skills/second/{model}")).skill, "second");
    }
}

#[test]
fn a_bit_flipped_in_a_policy_is_refused() {
    let fixture = installation();
    fixture.add_shipped(&["ascend_network"]);
    fixture.add_deployment("two", &["first", "ascend_network"]);
    locked(&fixture, None);
    assert_eq!(load(&fixture).expect("as locked").skills.len(), 2);
    let policy = "skills/ascend_network/policy.onnx";
    flip(&fixture, policy);
    is_about(&load(&fixture).expect("one skill is left").refused[0].to_string(), policy);
}

#[test]
fn a_bit_flipped_in_a_skills_manifest_is_refused() {
    refusal("manifests/skills/second.toml");
}

#[test]
fn a_bit_flipped_in_the_deployment_or_the_robot_ends_the_run_before_it_starts() {
    for path in [DEPLOYMENT, "manifests/robots/anymal_d.toml", "manifests/robots/anymal_d.xml"] {
        let fixture = installation();
        locked(&fixture, None);
        flip(&fixture, path);
        is_about(&load(&fixture).expect_err("a refusal").to_string(), path);
    }
}

#[test]
fn a_plugin_put_before_the_locked_one_on_the_path_is_refused() {
    let mut fixture = installation();
    locked(&fixture, None);
    let library = library_file_name("faulty");
    let mut other = fs::read(plugin_folder().join(&library)).expect("a built plugin");
    other.push(0);
    fixture.write(&format!("earlier/{library}"), &other);
    fixture.search_first("earlier");
    let loaded = load(&fixture).expect("one skill is left");
    is_about(&loaded.refused[0].to_string(), "earlier");
    assert_eq!(loaded.refused[0].skill, "first");
}

#[test]
fn a_skill_that_the_lock_does_not_have_is_refused() {
    let fixture = installation();
    let lock = locked(&fixture, None);
    let text = fs::read_to_string(lock.file()).expect("the lock");
    let kept: Vec<&str> = text.lines().filter(|line| !line.contains("second.toml")).collect();
    let without = kept.join("\n");
    assert_ne!(text, without);
    fs::write(lock.file(), without).expect("written");
    let line = load(&fixture).expect("one is left").refused[0].to_string();
    assert!(
        line.contains("second.toml: sha256: found ") && line.contains("wanted a file that two.lock has"),
        "{line}"
    );
}

#[test]
fn an_unsound_skill_is_not_locked() {
    let fixture = installation();
    flip(&fixture, "skills/second/cot.onnx");
    fixture.write("skills/second/cot.onnx", b"no model");
    let error = lock_deployment(&fixture.installation(), "two").expect_err("unsound");
    assert!(matches!(&error, LoadError::Unsound(refusal) if refusal.skill == "second"), "{error}");
}

#[test]
fn a_missing_lock_says_how_to_make_one() {
    let line = load(&installation()).expect_err("no lock").to_string();
    assert!(line.contains("two.lock") && line.contains("vocaloco lock --deployment two"), "{line}");
}

/// A signed deployment that demands `keys`.
fn signed(keys: &[&SecretKey], by: Option<&SecretKey>) -> Fixture {
    let fixture = installation();
    let keys: Vec<String> = keys.iter().map(|key| key.public().to_string()).collect();
    fixture.alter(DEPLOYMENT, "schema = 1", &format!("schema = 1\ntrusted_keys = {keys:?}"));
    locked(&fixture, by);
    fixture
}

fn key() -> SecretKey {
    SecretKey::generate().expect("randomness")
}

#[test]
fn a_deployment_signed_by_a_listed_key_loads() {
    let (mine, other) = (key(), key());
    assert_eq!(load(&signed(&[&other, &mine], Some(&mine))).expect("signed").skills.len(), 2);
}

#[test]
fn a_missing_signature_is_refused() {
    let mine = key();
    let line = load(&signed(&[&mine], None)).expect_err("unsigned").to_string();
    assert!(line.contains("two.lock: signature: found nothing, wanted a signature by"), "{line}");
    let fixture = signed(&[&mine], Some(&mine));
    fs::remove_file(fixture.root().join("manifests/deployments/two.lock.sig")).expect("removed");
    load(&fixture).expect_err("removed");
}

#[test]
fn a_foreign_key_is_refused() {
    let (mine, foreign) = (key(), key());
    let line = load(&signed(&[&mine], Some(&foreign))).expect_err("foreign").to_string();
    assert!(line.contains("which is not listed") && line.contains(&mine.public().to_string()), "{line}");
}

#[test]
fn a_lock_changed_after_it_was_signed_is_refused() {
    let mine = key();
    let fixture = signed(&[&mine], Some(&mine));
    let file = "manifests/deployments/two.lock";
    let hash = lock_deployment(&fixture.installation(), "two").expect("sound").plugins()["second"].clone();
    fixture.alter(file, &hash, &hash.chars().rev().collect::<String>());
    let line = load(&fixture).expect_err("changed").to_string();
    assert!(line.contains("of other bytes"), "{line}");
}

#[test]
fn bits_flipped_under_a_signed_lock_are_refused() {
    let mine = key();
    let library = format!("skills/second/{}", library_file_name("faulty"));
    for path in [library.as_str(), "skills/second/viability.onnx", "manifests/skills/second.toml"] {
        let fixture = signed(&[&mine], Some(&mine));
        flip(&fixture, path);
        let loaded = load(&fixture).expect("one skill is left");
        is_about(&loaded.refused[0].to_string(), path);
    }
}

#[test]
fn what_is_read_is_what_is_locked() {
    let fixture = installation();
    let lock = locked(&fixture, None);
    let loaded = load_deployment(&fixture.installation(), "two").expect("sound");
    let skill = &loaded.skills[1];
    assert_eq!(lock.plugins()["second"], skill.library.sha256());
    assert_eq!(lock.files()["skills/second/cot.onnx"], skill.cot.as_ref().expect("a model").sha256());
    let names: Vec<&str> = lock.files().keys().map(String::as_str).collect();
    let skills = ["first", "second"];
    let of_skills = skills.iter().flat_map(|skill| {
        ["cot.onnx", "fault.txt", "viability.onnx"].map(|file| format!("skills/{skill}/{file}"))
    });
    let mut wanted: Vec<String> = of_skills.collect();
    wanted.extend(skills.map(|skill| format!("manifests/skills/{skill}.toml")));
    wanted.extend(
        [DEPLOYMENT, "manifests/robots/anymal_d.toml", "manifests/robots/anymal_d.xml"].map(String::from),
    );
    wanted.sort();
    assert_eq!(names, wanted);
}

fn built(name: &str) -> Vec<u8> {
    fs::read(plugin_folder().join(library_file_name(name))).expect("a built plugin")
}

fn robot(fixture: &Fixture) -> RobotModel {
    RobotModel::load(&fixture.installation().robots_folder(), "anymal_d").expect("the robot")
}

#[test]
fn a_plugin_swapped_once_its_bytes_were_checked_is_loaded_as_it_was_checked() {
    let fixture = Fixture::new();
    let path = format!("plugins/{}", library_file_name("faulty"));
    // A build of its own, which no other test has loaded already.
    let mut checked = built("faulty");
    checked.extend(b"swapped");
    fixture.write(&path, &checked);
    let search_path = [fixture.root().join("plugins")];
    let library = PluginLibrary::open_if(&search_path, "faulty", &|_, bytes| {
        assert!(bytes == checked, "all of its bytes are looked at");
        fixture.write(&path, &built("gait"));
        Ok(())
    });
    let library = library.expect("what was checked");
    assert_eq!(library.description().name, "faulty");
    assert_eq!(library.sha256(), sha256_hex(&checked));
    library.create("none", &robot(&fixture).description).expect("it runs");
}

/// That a plugin's process refused a file for other bytes than its host has read there.
#[cfg(target_os = "linux")]
fn is_not_as_read(line: &str, path: &str, found: &[u8], read: &[u8]) {
    eprintln!("{line}");
    let [found, read] = [found, read].map(sha256_hex);
    let wanted = format!("SHA-256 {read}, as it was when the host read it");
    assert!(line.ends_with(&format!("{path}: file: found {found}, wanted {wanted}")), "{line}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_plugin_swapped_before_its_process_loads_it_is_refused() {
    let mut fixture = Fixture::new();
    let path = format!("plugins/{}", library_file_name("faulty"));
    let read = built("faulty");
    fixture.write(&path, &read);
    fixture.search_first("plugins");
    let search_path = fixture.installation().plugin_path;
    let library = PluginLibrary::open_isolated(&search_path, "faulty", &|_, _| Ok(())).expect("sound");
    let robot = robot(&fixture);
    let create = || library.create("none", &robot.description);
    create().expect("as it was read");
    let mut longer = read.clone();
    longer.push(0);
    for swapped in [longer, built("gait"), b"no library".to_vec()] {
        fixture.write(&path, &swapped);
        is_not_as_read(&create().expect_err("other bytes").to_string(), &path, &swapped, &read);
    }
    fixture.write(&path, &read);
    create().expect("as it was read, again");
}

#[cfg(target_os = "linux")]
#[test]
fn a_policy_swapped_before_its_process_loads_it_is_refused() {
    use vocaloco_core::registry::{ModelPolicy, load_skill};
    let fixture = Fixture::new();
    fixture.add_shipped(&["ascend_network", "descend_network"]);
    let isolated = "isolation = \"process\"\nplugin =";
    fixture.alter("manifests/skills/ascend_network.toml", "plugin =", isolated);
    let robot = robot(&fixture);
    let skill =
        load_skill(&fixture.installation(), "ascend_network", &robot.description, ModelPolicy::Required);
    let skill = skill.expect("sound");
    let create = || skill.create(&robot.description);
    create().expect("as it was read");
    let [path, sound] = ["ascend", "descend"].map(|name| format!("skills/{name}_network/policy.onnx"));
    let [read, sound] = [&path, &sound].map(|path| fs::read(fixture.root().join(path)).expect("a policy"));
    for swapped in [sound, b"no model".to_vec()] {
        fixture.write(&path, &swapped);
        is_not_as_read(&create().expect_err("other bytes").to_string(), &path, &swapped, &read);
    }
    fixture.write(&path, &read);
    create().expect("as it was read, again");
}

/// Exit code and narration of a verb in this installation, with nothing on stdin.
fn vocaloco(fixture: &Fixture, arguments: &[&str]) -> (Option<i32>, String) {
    let program = plugin_folder().join(format!("vocaloco{}", std::env::consts::EXE_SUFFIX));
    let output = std::process::Command::new(program)
        .args(arguments)
        .env("VOCALOCO_ROOT", fixture.root())
        .env("VOCALOCO_PLUGIN_PATH", fixture.root().join("plugins"))
        .stdin(std::process::Stdio::null())
        .output()
        .expect("it starts");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn the_command_line_locks_signs_and_refuses() {
    let fixture = installation();
    let run = ["run", "--deployment", "two", "--source", "stdio", "--locked"];
    let (code, said) = vocaloco(&fixture, &run);
    assert!(code == Some(2) && said.contains("vocaloco lock --deployment two"), "{said}");

    let secret = fixture.root().join("robot.key");
    let secret = secret.to_str().expect("a plain path");
    let (code, said) = vocaloco(&fixture, &["skills", "key", secret]);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = vocaloco(&fixture, &["skills", "key", secret]);
    assert_eq!(code, Some(2), "a key is not written over: {said}");
    let public = SecretKey::read(secret.as_ref()).expect("a key").public();
    fixture.alter(DEPLOYMENT, "schema = 1", &format!("schema = 1\ntrusted_keys = [\"{public}\"]"));
    let (code, said) = vocaloco(&fixture, &["lock", "--deployment", "two"]);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = vocaloco(&fixture, &run);
    assert!(code == Some(2) && said.contains("signature: found nothing"), "{said}");
    let (code, said) = vocaloco(&fixture, &["lock", "--deployment", "two", "--key", secret]);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = vocaloco(&fixture, &run);
    assert_eq!(code, Some(0), "{said}");
    let trusting = |key: &str| vocaloco(&fixture, &[&run[..], &["--trust", key]].concat());
    assert_eq!(trusting(&public.to_string()).0, Some(0));
    let (code, said) = trusting(&key().public().to_string());
    assert!(code == Some(2) && said.contains("which is not listed"), "{said}");
    let (code, said) = vocaloco(&fixture, &run[..5]);
    assert!(code == Some(2) && said.contains("wanted --locked"), "{said}");

    flip(&fixture, "skills/second/cot.onnx");
    let (code, said) = vocaloco(&fixture, &run);
    assert!(code == Some(0) && said.contains("refused: skill second is refused"), "{said}");
    flip(&fixture, "manifests/robots/anymal_d.toml");
    let (code, said) = vocaloco(&fixture, &run);
    assert_eq!(code, Some(2), "{said}");
}
