//! While `run` drives a robot, skills are installed, spoiled and removed: each takes part, or does not, and no line
//! stays without an answer.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

use serde_json::{Value, json};
use vocaloco_core::bundle::{install, pack, remove};
use vocaloco_core::decision_log::DecisionLog;
use vocaloco_core::lock::SecretKey;
use vocaloco_core::registry::lock_deployment;
use vocaloco_tests::{Fixture, plugin_folder, standing_line};

/// A running loop in lock-step.
struct Session {
    child: Child,
    stdin: ChildStdin,
    stdout: BufReader<ChildStdout>,
    tick: u32,
}

impl Session {
    fn start(fixture: &Fixture, more: &[&str]) -> Self {
        Self::of(&mut Command::new(program()), fixture.root(), more)
    }

    fn of(program: &mut Command, root: &Path, more: &[&str]) -> Self {
        let mut child = program
            .args(["run", "--deployment", "stairs", "--source", "stdio"])
            .args(more)
            .env("VOCALOCO_ROOT", root)
            .env("VOCALOCO_PLUGIN_PATH", plugin_folder())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let stdin = child.stdin.take().expect("a pipe");
        let stdout = BufReader::new(child.stdout.take().expect("a pipe"));
        let mut session = Self { child, stdin, stdout, tick: 0 };
        assert!(session.read()["skills"].is_array(), "a greeting");
        session
    }

    fn read(&mut self) -> Value {
        let mut line = String::new();
        self.stdout.read_line(&mut line).expect("a line");
        serde_json::from_str(&line).expect("one JSON object a line")
    }

    fn tick(&mut self) -> Value {
        writeln!(self.stdin, "{}", standing_line(self.tick)).expect("a line is taken");
        self.tick += 1;
        let answer = self.read();
        assert!(answer.get("error").is_none(), "{answer}");
        answer
    }

    /// Ticks at the robot's pace until an answer is as `wanted` says, the last answer.
    fn until(&mut self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        // Half a minute, since other tests want the machine too.
        for _ in 0..1500 {
            let answer = self.tick();
            if wanted(&answer) {
                return answer;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        panic!("{what} within 1500 ticks");
    }

    fn end(mut self) {
        drop(self.stdin);
        assert!(self.child.wait().expect("it ends").success(), "no line was answered with an error");
    }
}

fn program() -> PathBuf {
    plugin_folder().join("vocaloco")
}

fn fixture() -> Fixture {
    let fixture = Fixture::new();
    fixture.add_skill("walk", "none", 0.99, 0.3);
    fixture.add_deployment("stairs", &["walk"]);
    fixture
}

fn active(name: &'static str) -> impl Fn(&Value) -> bool {
    move |answer| answer["active"] == name
}

fn knows(answer: &Value, skill: &str) -> bool {
    answer["skills"].get(skill).is_some()
}

#[test]
fn a_bundle_installed_while_the_robot_walks_takes_part_and_removed_while_active_ends_in_the_stand() {
    let source = Fixture::new();
    source.add_skill("trot", "none", 0.99, 0.2);
    let bundle = source.root().join("trot.skill");
    pack(&source.installation(), "trot", &bundle, None).expect("packed");

    let fixture = fixture();
    let mut session = Session::start(&fixture, &[]);
    session.until("walk drives", active("walk"));
    install(&fixture.installation(), &bundle, &[]).expect("installed");
    fixture.add_deployment("stairs", &["walk", "trot"]);
    let answer = session.until("trot is known", |answer| knows(answer, "trot"));
    assert_eq!(answer["active"], "walk", "nothing is disturbed");
    session.until("trot drives", active("trot"));
    remove(&fixture.installation(), "trot").expect("removed");
    let answer = session.until("trot is gone", |answer| !knows(answer, "trot"));
    assert_eq!(answer["active"], "stand");
    session.until("walk drives again", active("walk"));
    session.end();
}

#[test]
fn what_is_not_sound_changes_nothing_until_it_is() {
    let fixture = fixture();
    let mut session = Session::start(&fixture, &[]);
    session.until("walk drives", active("walk"));
    fixture.write("manifests/deployments/stairs.toml", b"schema = 1\nrobot = ");
    fixture.add_skill("trot", "none", 0.99, 0.2);
    fixture.write("skills/trot/cot.onnx", b"nonsense");
    for _ in 0..40 {
        assert_eq!(session.tick()["active"], "walk");
        std::thread::sleep(Duration::from_millis(20));
    }
    fixture.add_deployment("stairs", &["walk", "trot"]);
    for _ in 0..40 {
        let answer = session.tick();
        assert!(answer["active"] == "walk" && !knows(&answer, "trot"), "{answer}");
        std::thread::sleep(Duration::from_millis(20));
    }
    fixture.add_skill("trot", "none", 0.99, 0.2);
    session.until("trot drives once it is sound", active("trot"));
    fixture.alter("manifests/skills/trot.toml", "0.9", "1.0");
    let answer = session.until("trot is held to its new threshold", active("stand"));
    assert_eq!(answer["skills"]["trot"]["viable"], json!(false));
    session.until("walk drives", active("walk"));
    session.end();
}

/// Not even the order in which the skills stand, which decides between two of equal cost.
#[test]
fn a_deployment_that_cannot_be_read_or_is_of_another_rate_changes_no_skill() {
    let fixture = fixture();
    fixture.add_skill("ascend", "none", 0.5, 0.4);
    fixture.add_skill("trot", "none", 0.99, 0.2);
    fixture.add_deployment("stairs", &["walk", "ascend"]);
    let log = fixture.root().join("decisions.mcap");
    let mut session = Session::start(&fixture, &["--log", &log.to_string_lossy()]);
    session.until("walk drives", active("walk"));
    let says = |what: &'static str| {
        move |answer: &Value| {
            answer["events"].as_array().expect("events").iter().any(|event| event.to_string().contains(what))
        }
    };
    fixture.write("manifests/deployments/stairs.toml", b"schema = 1\nrobot = ");
    session.until("it says so", says("the skills go on as they were"));
    fixture.add_deployment("stairs", &["walk", "ascend", "trot"]);
    fixture.alter("manifests/deployments/stairs.toml", "skills", "rate_hz = 25\nskills");
    session.until("it says so", says("rate_hz: found 25, wanted 50, until the next start"));
    for _ in 0..20 {
        assert_eq!(session.tick()["active"], "walk");
    }
    session.end();
    let recorded = DecisionLog::read(&log).expect("a log");
    assert!(
        recorded.decisions.iter().all(|decision| decision.roster.is_none()),
        "the same skills throughout"
    );
}

#[test]
fn files_that_are_touched_or_changed_and_changed_back_disturb_nothing() {
    let fixture = fixture();
    let mut session = Session::start(&fixture, &[]);
    session.until("walk drives", active("walk"));
    let manifest = "manifests/skills/walk.toml";
    let text = std::fs::read(fixture.root().join(manifest)).expect("a manifest");
    for bytes in [text.clone(), b"nonsense".to_vec(), text] {
        fixture.write(manifest, &bytes);
        for _ in 0..30 {
            let answer = session.tick();
            let spoiled = bytes == b"nonsense" && answer["events"][0].as_str().is_some();
            assert!(answer["active"] == "walk" && (spoiled || answer["events"] == json!([])), "{answer}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
    session.end();
}

#[test]
fn under_a_lock_a_skill_comes_with_a_new_lock_of_a_trusted_key_alone() {
    let fixture = fixture();
    let installation = fixture.installation();
    let [key, foreign] = [(); 2].map(|()| SecretKey::generate().expect("randomness"));
    let relock = |key: &SecretKey| {
        lock_deployment(&installation, "stairs").expect("sound").write(Some(key)).expect("a lock");
    };
    relock(&key);
    let mut session = Session::start(&fixture, &["--locked", "--trust", &key.public().to_string()]);
    session.until("walk drives", active("walk"));
    fixture.add_skill("trot", "none", 0.99, 0.2);
    fixture.add_deployment("stairs", &["walk", "trot"]);
    for relocked in [false, true] {
        if relocked {
            relock(&foreign);
        }
        for _ in 0..40 {
            let answer = session.tick();
            assert!(answer["active"] == "walk" && !knows(&answer, "trot"), "{answer}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
    relock(&key);
    session.until("trot drives", active("trot"));
    session.end();
}

#[test]
fn a_deployment_that_demands_a_signature_goes_on_demanding_it() {
    let fixture = fixture();
    let installation = fixture.installation();
    let key = SecretKey::generate().expect("randomness");
    let manifest = "manifests/deployments/stairs.toml";
    let demands = format!("schema = 1\ntrusted_keys = [\"{}\"]\n", key.public());
    fixture.alter(manifest, "schema = 1\n", &demands);
    lock_deployment(&installation, "stairs").expect("sound").write(Some(&key)).expect("a lock");
    let mut session = Session::start(&fixture, &["--locked"]);
    session.until("walk drives", active("walk"));
    fixture.add_skill("trot", "none", 0.99, 0.2);
    fixture.add_deployment("stairs", &["walk", "trot"]);
    lock_deployment(&installation, "stairs").expect("sound").write(None).expect("a lock");
    let answer = session.until("it is refused", |answer| answer["events"] != json!([]));
    assert!(answer["events"][0].as_str().is_some_and(|event| event.contains("signature")), "{answer}");
    for _ in 0..40 {
        let answer = session.tick();
        assert!(answer["active"] == "walk" && !knows(&answer, "trot"), "{answer}");
    }
    session.end();
}

/// The change that comes before its lock is refused by the old one, and taken under the new.
#[test]
fn under_a_lock_a_changed_skill_is_taken_up_with_the_lock_that_comes_after_it() {
    let fixture = fixture();
    let relock = || {
        lock_deployment(&fixture.installation(), "stairs").expect("sound").write(None).expect("a lock");
    };
    relock();
    let mut session = Session::start(&fixture, &["--locked"]);
    session.until("walk drives", active("walk"));
    fixture.alter("manifests/skills/walk.toml", "0.9", "1.0");
    let refused = |answer: &Value| answer["events"].to_string().contains("it goes on as it was");
    assert_eq!(session.until("its bytes are not the lock's", refused)["active"], "walk");
    relock();
    let held = |answer: &Value| answer["skills"]["walk"]["viable"] == json!(false);
    session.until("it is held to its new threshold", held);
    session.end();
}

#[test]
fn a_skill_refused_for_a_threshold_of_the_deployment_comes_when_that_is_mended() {
    let fixture = fixture();
    let mut session = Session::start(&fixture, &[]);
    session.until("walk drives", active("walk"));
    fixture.add_skill("trot", "none", 0.99, 0.2);
    fixture.add_deployment("stairs", &["walk", "trot"]);
    let file = "manifests/deployments/stairs.toml";
    let text = std::fs::read_to_string(fixture.root().join(file)).expect("a deployment");
    fixture.write(file, format!("{text}\n[hold_thresholds]\ntrot = 0.95\n").as_bytes());
    let refused = |answer: &Value| answer["events"].to_string().contains("hold_thresholds.trot");
    let answer = session.until("its threshold to go on is above that to begin", refused);
    assert!(answer["active"] == "walk" && !knows(&answer, "trot"), "{answer}");
    fixture.write(file, format!("{text}\n[hold_thresholds]\ntrot = 0.85\n").as_bytes());
    session.until("it drives once that is mended", active("trot"));
    session.end();
}

/// What drives goes on as it was, and is not what its file says until the threshold fits that.
#[test]
fn a_change_refused_for_a_threshold_of_the_deployment_comes_when_that_is_mended() {
    let fixture = fixture();
    let file = "manifests/deployments/stairs.toml";
    let text = std::fs::read_to_string(fixture.root().join(file)).expect("a deployment");
    let hold =
        |least: f32| fixture.write(file, format!("{text}\n[hold_thresholds]\nwalk = {least}\n").as_bytes());
    hold(0.9);
    let mut session = Session::start(&fixture, &[]);
    session.until("walk drives", active("walk"));
    fixture.alter("manifests/skills/walk.toml", "viability_threshold = 0.9", "viability_threshold = 0.85");
    let refused = |answer: &Value| answer["events"].to_string().contains("hold_thresholds.walk");
    assert_eq!(session.until("its threshold to begin is below that to go on", refused)["active"], "walk");
    hold(0.8);
    let taken = |answer: &Value| answer["events"].to_string().contains("skill walk");
    let answer = session.until("it is taken once that is mended", taken);
    assert!(!refused(&answer), "{answer}");
    session.end();
}

/// It would have ended the loop: the library is sound and here already, its instance is not.
#[cfg(target_os = "linux")]
#[test]
fn a_skill_that_ends_the_process_that_makes_it_does_not_end_the_loop() {
    let fixture = fixture();
    let mut session = Session::start(&fixture, &[]);
    session.until("walk drives", active("walk"));
    fixture.add_skill("trot", "abort_in_create", 0.99, 0.2);
    fixture.add_deployment("stairs", &["walk", "trot"]);
    let answer = session.until("it is refused", |answer| answer["events"] != json!([]));
    let event = answer["events"][0].as_str().expect("a line");
    assert!(event.contains("skill trot is refused") && event.contains("ended by signal 6"), "{event}");
    fixture.add_skill("trot", "none", 0.99, 0.2);
    session.until("it drives once it is mended", active("trot"));
    session.end();
}

/// Without the right to look into other processes, as on a robot where the loop is no root's, and in a folder whose name
/// is no text.
#[cfg(target_os = "linux")]
#[test]
fn isolated_skills_come_to_a_loop_without_privileges_in_a_folder_of_any_name() {
    use std::os::unix::ffi::OsStrExt;
    let fixture = fixture();
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join(std::ffi::OsStr::from_bytes(b"r\xffbot"));
    std::os::unix::fs::symlink(fixture.root(), &root).expect("a link");
    let isolated = |name: &str, parameters: &str| {
        fixture.add_skill(name, parameters, 0.99, 0.2);
        fixture.alter(
            &format!("manifests/skills/{name}.toml"),
            "plugin =",
            "isolation = \"process\"\nplugin =",
        );
    };
    // Where that does not go, the tests have none themselves.
    let without = Command::new("setpriv").args(["--bounding-set=-all", "true"]).status();
    let mut command = if without.is_ok_and(|status| status.success()) {
        let mut setpriv = Command::new("setpriv");
        setpriv.arg("--bounding-set=-all").arg(program());
        setpriv
    } else {
        Command::new(program())
    };
    let mut session = Session::of(&mut command, &root, &[]);
    session.until("walk drives", active("walk"));
    isolated("amble", "abort_in_create");
    isolated("trot", "none");
    fixture.add_deployment("stairs", &["walk", "amble", "trot"]);
    let answer = session.until("one is refused, the other known", |answer| knows(answer, "trot"));
    let events = answer["events"].to_string();
    assert!(events.contains("skill amble is refused") && events.contains("ended by signal 6"), "{events}");
    session.until("it drives", active("trot"));
    session.end();
}

/// The plugin's library with one bit changed, where that ends the process that loads it.
#[cfg(target_os = "linux")]
fn deadly() -> Vec<u8> {
    use vocaloco_core::plugin::PluginLibrary;
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = std::fs::read(plugin_folder().join("libgait.so")).expect("a library");
    let file = folder.path().join("libgait.so");
    let path = [folder.path().to_owned(), plugin_folder().to_owned()];
    // Beginning with the second program header, whose first fields the loader believes.
    for (byte, bit) in (120..900).step_by(3).map(|byte| (byte, byte % 8)) {
        let mut spoiled = bytes.clone();
        spoiled[byte] ^= 1 << bit;
        std::fs::write(&file, &spoiled).expect("a written file");
        let tried = PluginLibrary::open_isolated(&path, "gait", &|_, _| Ok(()));
        if tried.is_err_and(|error| error.to_string().contains("ended by signal")) {
            return spoiled;
        }
    }
    panic!("no changed bit ends a process");
}

#[cfg(target_os = "linux")]
#[test]
fn a_library_that_ends_the_process_that_loads_it_does_not_end_the_loop() {
    let fixture = fixture();
    let mut session = Session::start(&fixture, &[]);
    session.until("walk drives", active("walk"));
    fixture.add_skill("trot", "none", 0.99, 0.2);
    fixture.alter("manifests/skills/trot.toml", "plugin = \"faulty\"", "plugin = \"gait\"");
    fixture.write("skills/trot/libgait.so", &deadly());
    fixture.add_deployment("stairs", &["walk", "trot"]);
    let answer = session.until("it is refused", |answer| answer["events"] != json!([]));
    let event = answer["events"][0].as_str().expect("a line");
    assert!(event.contains("trot") && event.contains("ended by signal"), "{event}");
    for _ in 0..40 {
        let answer = session.tick();
        assert!(answer["active"] == "walk" && !knows(&answer, "trot"), "{answer}");
    }
    session.end();
}
