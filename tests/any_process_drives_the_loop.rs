//! `vocaloco run --source stdio`, as a bridge sees it: greeting, lock-step, exit codes, and a log that
//! explains and replays itself.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use serde_json::{Value, json};
use vocaloco_core::decision_log::DecisionLog;
use vocaloco_tests::{Fixture, plugin_folder, shipped, standing_line};

fn start(root: &Path, arguments: &[&str]) -> Child {
    let mut program = Command::new(plugin_folder().join("vocaloco"));
    spawn(program.args(arguments).stderr(Stdio::piped()), root)
}

/// Whatever starts the program, for this installation and with pipes to it.
fn spawn(command: &mut Command, root: &Path) -> Child {
    let command = command.env("VOCALOCO_ROOT", root).env("VOCALOCO_PLUGIN_PATH", plugin_folder());
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("the program starts")
}

fn vocaloco(root: &Path, arguments: &[&str], input: &str) -> Output {
    let mut child = start(root, arguments);
    let mut stdin = child.stdin.take().expect("a pipe");
    let input = input.to_owned();
    // From a thread of its own: both pipes fill up in a long session. A program that ends early closes
    // its end, which is for its exit code to say.
    let bridge = std::thread::spawn(move || drop(stdin.write_all(input.as_bytes())));
    let output = child.wait_with_output().expect("the program ends");
    bridge.join().expect("the input is written");
    output
}

fn lines(output: &Output) -> Vec<Value> {
    let text = String::from_utf8(output.stdout.clone()).expect("UTF-8");
    text.lines().map(|line| serde_json::from_str(line).expect("one JSON object a line")).collect()
}

fn session(ticks: std::ops::Range<u32>) -> String {
    ticks.map(|tick| standing_line(tick).to_string() + "\n").collect()
}

fn fixture() -> Fixture {
    let fixture = Fixture::new();
    fixture.add_skill("walk", "none", 0.99, 0.2);
    fixture.add_skill("ascend", "none", 0.5, 0.4);
    fixture.add_deployment("stairs", &["walk", "ascend"]);
    fixture
}

const RUN: [&str; 5] = ["run", "--deployment", "stairs", "--source", "stdio"];

#[test]
fn a_greeting_then_one_line_out_per_line_in_and_a_clean_stop() {
    let output = vocaloco(fixture().root(), &RUN, &session(0..15));
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let lines = lines(&output);
    assert_eq!(lines.len(), 16);
    assert_eq!(lines[0]["robot"], "anymal_d");
    assert_eq!(lines[0]["skills"], json!(["walk", "ascend"]));
    assert_eq!((&lines[9]["active"], &lines[10]["active"]), (&json!("stand"), &json!("walk")));
    assert_eq!(lines[15]["t_s"], 0.28);
    assert_eq!(lines[15]["skills"]["ascend"]["viable"], false);
    assert_eq!(lines[15]["joints"].as_object().map(serde_json::Map::len), Some(12));
}

#[test]
fn a_malformed_line_is_answered_with_the_stand_and_the_exit_code_is_1() {
    let mut spoiled = standing_line(12);
    spoiled["joint_position_rad"].as_object_mut().expect("an object").remove("RH_KFE");
    let input = format!("{}{spoiled}\nnonsense\n{}", session(0..12), session(14..60));
    let output = vocaloco(fixture().root(), &RUN, &input);
    assert_eq!(output.status.code(), Some(1));
    let lines = lines(&output);
    assert_eq!(lines.len(), 1 + 60);
    assert_eq!(lines[12]["active"], "walk");
    let wanted = json!({"field": "joint_position_rad.RH_KFE", "found": "nothing", "wanted": "a value"});
    assert_eq!(lines[13]["error"], wanted);
    let stiffness = lines[13]["joints"]["LF_KFE"]["stiffness_nm_per_rad"].as_f64();
    assert!(stiffness.is_some_and(|stiffness| stiffness >= 120.0), "the stand's joints: {}", lines[13]);
    assert_eq!(lines[14]["error"]["field"], "line");
    assert_eq!(lines[60]["active"], "walk", "the loop went on");
}

#[test]
fn nothing_to_run_is_exit_code_2_and_one_line_of_why() {
    let fixture = fixture();
    for skill in ["walk", "ascend"] {
        fixture.write(&format!("skills/{skill}/cot.onnx"), b"nonsense");
    }
    let output = vocaloco(fixture.root(), &RUN, &session(0..3));
    assert_eq!(output.status.code(), Some(2));
    assert!(output.stdout.is_empty(), "no greeting of a loop that does not run");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(error.contains("cot.onnx") && error.lines().count() == 1, "{error}");
}

#[test]
fn a_refused_skill_is_named_in_the_greeting_and_the_other_runs() {
    let fixture = fixture();
    fixture.write("skills/ascend/viability.onnx", b"nonsense");
    let output = vocaloco(fixture.root(), &RUN, &session(0..12));
    assert_eq!(output.status.code(), Some(0));
    let lines = lines(&output);
    assert_eq!(lines[0]["skills"], json!(["walk"]));
    assert!(lines[0]["refused"][0].as_str().is_some_and(|line| line.contains("viability.onnx")));
    assert_eq!(lines[12]["active"], "walk");
}

#[test]
fn a_log_explains_and_replays_itself() {
    let fixture = fixture();
    let log = fixture.root().join("decisions.mcap");
    let file = log.to_str().expect("UTF-8");
    let mut arguments = RUN.to_vec();
    arguments.extend(["--log", file]);
    assert_eq!(vocaloco(fixture.root(), &arguments, &session(0..120)).status.code(), Some(0));

    let explained = vocaloco(fixture.root(), &["explain", file, "--tick", "40", "--json"], "");
    let explained: Value = serde_json::from_slice(&explained.stdout).expect("one JSON object");
    assert_eq!(explained["ticks"], 120);
    assert_eq!(explained["decision"]["active"], "walk");
    assert_eq!(explained["changes"][0]["tick"], 9);
    let words = vocaloco(fixture.root(), &["explain", file], "");
    let words = String::from_utf8_lossy(&words.stdout).into_owned();
    assert!(words.contains("stand → walk: the only viable skill"), "{words}");
    assert!(
        words.contains("ascend: viability 0.500, cost of transport 0.400: viability below 0.9"),
        "{words}"
    );

    let what_if =
        ["explain", file, "--what-if", "threshold.walk=0.995,threshold.ascend=0.4,window=5", "--json"];
    let what_if = vocaloco(fixture.root(), &what_if, "");
    let what_if: Value = serde_json::from_slice(&what_if.stdout).expect("one JSON object");
    assert_eq!(what_if["what_if"]["stretches"][1]["active"], "ascend");
    assert_eq!(what_if["what_if"]["stretches"][0]["ticks"], 4);

    let source = format!("replay:{file}");
    let replay = ["run", "--deployment", "stairs", "--source", &source, "--json"];
    let output = vocaloco(fixture.root(), &replay, "");
    let replayed: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!((output.status.code(), &replayed["differing_ticks"]), (Some(0), &json!(0)), "{replayed}");

    fixture.write("skills/walk/viability.onnx", &vocaloco_tests::constant_model("viability", 0.2));
    let output = vocaloco(fixture.root(), &replay, "");
    let replayed: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(output.status.code(), Some(1), "another model is a finding: {replayed}");
    assert!(replayed["differing_ticks"].as_u64().is_some_and(|ticks| ticks > 100), "{replayed}");
}

#[test]
fn a_signal_to_end_is_a_clean_stop() {
    let fixture = fixture();
    let log = fixture.root().join("decisions.mcap");
    let mut runs = 0;
    for signal in ["INT", "TERM", "HUP"] {
        if ignored_here(signal) {
            continue;
        }
        runs += 1;
        let mut child = start(fixture.root(), &[&RUN[..], &["--log", &log.to_string_lossy()]].concat());
        // Held to the end: to wait for a child closes what it reads from.
        let mut stdin = child.stdin.take().expect("a pipe");
        stdin.write_all(session(0..15).as_bytes()).expect("the input is taken");
        let mut answers = BufReader::new(child.stdout.as_mut().expect("a pipe")).lines();
        assert_eq!(answers.by_ref().take(16).count(), 16, "the greeting and 15 lines");
        // It waits for the rest of a line now, and its input stays open.
        stdin.write_all(b"{\"t_s\": ").expect("the input is taken");
        send_signal(&child, signal);
        let output = child.wait_with_output().expect("it ends");
        let narration = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{signal}: {narration}");
        assert!(narration.contains("15 lines answered, 0 of them with an error"), "{narration}");
        assert!(narration.contains("p99"), "how long ticks took: {narration}");
        let written = DecisionLog::read(&log).expect("a log");
        assert_eq!((written.decisions.len(), written.truncated), (15, None), "{signal}");
        drop(stdin);
    }
    let aside = |number: &u32| fixture.root().join(format!("decisions.{number}.mcap")).exists();
    assert_eq!((1..9).filter(aside).count() + 1, runs.max(1), "no log replaces another");
}

/// In a plugin that prints, nothing of it is between two answers, and it takes no line away.
#[test]
fn what_a_plugin_prints_is_no_answer_and_what_it_reads_is_no_line() {
    let fixture = fixture();
    fixture.add_skill("walk", "prints", 0.99, 0.2);
    for pace in [&[][..], &["--real-time"]] {
        let output = vocaloco(fixture.root(), &[&RUN[..], pace].concat(), &session(0..40));
        let narration = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{narration}");
        let lines = lines(&output);
        assert_eq!(lines.len(), 1 + 40, "one answer a line");
        for (tick, line) in (0..).zip(&lines[1..]) {
            assert_eq!(line["t_s"], standing_line(tick)["t_s"]);
        }
        // In real time a busy machine may let it be late, and never act.
        let acts = lines.iter().any(|line| line["active"] == "walk");
        assert!(acts || !pace.is_empty(), "{lines:?}");
        assert!(!acts || narration.contains("where do my words end up?"), "{narration}");
    }
}

/// A log may have so many bytes and no more, and what is narrated goes to a full disk.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_log_and_nothing_else() {
    let fixture = fixture();
    let log = fixture.root().join("decisions.mcap");
    for pace in ["", "--real-time"] {
        let program = plugin_folder().join("vocaloco");
        let words = format!("{} {} --log {} {pace}", program.display(), RUN.join(" "), log.display());
        let mut child = Command::new("sh")
            .args(["-c", &format!("trap '' XFSZ; exec {words}")])
            .env("VOCALOCO_ROOT", fixture.root())
            .env("VOCALOCO_PLUGIN_PATH", plugin_folder())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(std::fs::File::options().write(true).open("/dev/full").expect("a full disk"))
            .spawn()
            .expect("the program starts");
        let mut answers = BufReader::new(child.stdout.take().expect("a pipe")).lines();
        answers.next().expect("the greeting").expect("UTF-8");
        let process = child.id().to_string();
        let limited = Command::new("prlimit").args(["--pid", &process, "--fsize=400000"]).status();
        assert!(limited.expect("prlimit runs").success());
        let mut stdin = child.stdin.take().expect("a pipe");
        let bridge = std::thread::spawn(move || drop(stdin.write_all(session(0..300).as_bytes())));
        assert_eq!(answers.count(), 300, "{pace:?}: every line is answered");
        bridge.join().expect("the input is written");
        let output = child.wait_with_output().expect("the program ends");
        assert_eq!(output.status.code(), Some(1), "{pace:?}: that the log is not whole is a finding");
        let written = DecisionLog::read(&log).expect("what there was room for");
        assert!((1..300).contains(&written.decisions.len()), "{pace:?}: {}", written.decisions.len());
    }
}

#[test]
fn when_nobody_reads_the_answers_the_run_ends_with_its_log_and_its_timing() {
    let fixture = fixture();
    let log = fixture.root().join("decisions.mcap");
    let mut child = start(fixture.root(), &[&RUN[..], &["--log", &log.to_string_lossy()]].concat());
    let mut stdin = child.stdin.take().expect("a pipe");
    stdin.write_all(session(0..5).as_bytes()).expect("the input is taken");
    let mut answers = BufReader::new(child.stdout.take().expect("a pipe")).lines();
    assert_eq!(answers.by_ref().take(6).count(), 6);
    drop(answers);
    // Whether all of it is taken depends on when the other side has seen it.
    drop(stdin.write_all(session(5..50).as_bytes()));
    let output = child.wait_with_output().expect("it ends");
    let narration = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{narration}");
    for wanted in ["nobody who reads the answers", "5 lines answered", "p99"] {
        assert!(narration.contains(wanted), "{wanted}: {narration}");
    }
    let written = DecisionLog::read(&log).expect("a log");
    assert_eq!((written.decisions.len(), written.truncated), (6, None), "the one nobody has heard included");
}

/// A plugin that never returns keeps the loop from its clean stop.
#[test]
fn a_second_signal_ends_what_the_first_could_not() {
    if ignored_here("TERM") {
        return;
    }
    let fixture = fixture();
    fixture.add_skill("walk", "hang", 0.99, 0.2);
    let mut child = start(fixture.root(), &RUN);
    let mut stdin = child.stdin.take().expect("a pipe");
    stdin.write_all(session(0..15).as_bytes()).expect("the input is taken");
    let mut answers = BufReader::new(child.stdout.as_mut().expect("a pipe")).lines();
    assert_eq!(
        answers.by_ref().take(10).count(),
        10,
        "the greeting, and the lines before the plugin is called"
    );
    let pause = || std::thread::sleep(std::time::Duration::from_millis(300));
    pause();
    send_signal(&child, "TERM");
    pause();
    assert!(child.try_wait().expect("a process").is_none(), "it waits for the plugin");
    send_signal(&child, "TERM");
    let ended = child.wait().expect("it ends");
    assert!(!ended.success(), "{ended}: not the clean stop");
    drop(stdin);
}

/// A terminal that is closed sends SIGHUP twice, and whoever ends what is left SIGTERM.
#[test]
fn what_comes_after_a_hangup_does_not_cut_its_clean_stop_short() {
    if ignored_here("HUP") {
        return;
    }
    for second in ["HUP", "TERM"] {
        let fixture = fixture();
        // Each call takes 1.5 s.
        fixture.add_skill("walk", "slow", 0.99, 0.2);
        let mut child = start(fixture.root(), &RUN);
        let mut stdin = child.stdin.take().expect("a pipe");
        stdin.write_all(session(0..10).as_bytes()).expect("the input is taken");
        let mut answers = BufReader::new(child.stdout.as_mut().expect("a pipe")).lines();
        assert_eq!(answers.by_ref().take(10).count(), 10, "up to the line that the plugin is called in");
        for signal in ["HUP", second] {
            std::thread::sleep(std::time::Duration::from_millis(300));
            send_signal(&child, signal);
        }
        let output = child.wait_with_output().expect("it ends");
        let narration = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{second}: {narration}");
        assert!(narration.contains("10 lines answered"), "{second}: {narration}");
        drop(stdin);
    }
}

/// As under `nohup`, or in the background of a shell.
#[cfg(target_os = "linux")]
#[test]
fn signals_that_are_ignored_from_the_start_end_nothing() {
    for ignored in [&["HUP"][..], &["HUP", "INT", "TERM"]] {
        let fixture = fixture();
        let trap = format!("trap '' {}; exec \"$@\"", ignored.join(" "));
        let mut shell = Command::new("sh");
        let program = plugin_folder().join("vocaloco");
        let mut child = spawn(shell.args(["-c", &trap, "sh"]).arg(program).args(RUN), fixture.root());
        let mut stdin = child.stdin.take().expect("a pipe");
        let mut answers = BufReader::new(child.stdout.take().expect("a pipe")).lines();
        answers.next().expect("the greeting").expect("UTF-8");
        for tick in 0..6 {
            send_signal(&child, ignored[tick as usize % ignored.len()]);
            std::thread::sleep(std::time::Duration::from_millis(20));
            writeln!(stdin, "{}", standing_line(tick)).expect("a line is taken");
            answers.next().expect("an answer").expect("UTF-8");
        }
        drop(stdin);
        assert_eq!(child.wait().expect("it ends").code(), Some(0), "{ignored:?}: with its input");
    }
}

/// Whether the tests were started to ignore a signal, and the program with them.
fn ignored_here(signal: &str) -> bool {
    let number = [("HUP", 1), ("INT", 2), ("TERM", 15)]
        .iter()
        .find(|(name, _)| *name == signal)
        .expect("one of them")
        .1;
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.map_or(0, |digits| u64::from_str_radix(digits.trim(), 16).expect("hex"));
    let is_ignored = mask >> (number - 1) & 1 == 1;
    if is_ignored {
        eprintln!("SIG{signal} is ignored here");
    }
    is_ignored
}

/// Numbers of the processes that a process has started and that are still there.
#[cfg(target_os = "linux")]
fn children(process: u32) -> Vec<String> {
    let tasks = std::fs::read_dir(format!("/proc/{process}/task")).expect("a process");
    let started = |task: std::io::Result<std::fs::DirEntry>| {
        // A thread may have ended meanwhile; what it has started is another's then.
        let list = task.and_then(|task| std::fs::read_to_string(task.path().join("children")));
        list.unwrap_or_default().split_whitespace().map(str::to_owned).collect::<Vec<_>>()
    };
    tasks.flat_map(started).collect()
}

/// Takes the 30 s that loading a skill is given.
#[cfg(target_os = "linux")]
#[test]
fn a_skill_that_hangs_when_created_is_given_up_after_30_s_that_no_line_waits_for() {
    let fixture = fixture();
    let mut child = start(fixture.root(), &RUN);
    let mut stdin = child.stdin.take().expect("a pipe");
    let mut answers = BufReader::new(child.stdout.take().expect("a pipe")).lines();
    answers.next().expect("the greeting").expect("UTF-8");
    let mut answer_to = |tick: u32| {
        writeln!(stdin, "{}", standing_line(tick)).expect("a line is taken");
        let answer = answers.next().expect("an answer").expect("UTF-8");
        serde_json::from_str::<Value>(&answer).expect("JSON")
    };
    for tick in 0..15 {
        answer_to(tick);
    }
    fixture.add_skill("trot", "hang_in_create", 0.99, 0.1);
    fixture.add_deployment("stairs", &["walk", "ascend", "trot"]);
    let (mut most_children, mut event) = (0, String::new());
    // For twice as long, since other tests want the machine too.
    for tick in 15..15 + 1200 {
        std::thread::sleep(std::time::Duration::from_millis(50));
        most_children = most_children.max(children(child.id()).len());
        let answer = answer_to(tick);
        assert_eq!(answer["active"], "walk", "{answer}");
        if let Some(line) = answer["events"][0].as_str() {
            line.clone_into(&mut event);
            break;
        }
    }
    assert!(event.starts_with("skill trot is refused: "), "{event:?}");
    assert!(event.contains("found no answer for 30 s from its process, which was ended"), "{event}");
    // Not every kernel lists them.
    if Path::new("/proc/thread-self/children").exists() {
        assert_eq!(most_children, 1, "the process that it was tried in");
    }
    assert!(children(child.id()).is_empty(), "which is gone");
    drop(stdin);
    let output = child.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
}

fn send_signal(child: &Child, signal: &str) {
    let killed = Command::new("kill").args(["-s", signal, &child.id().to_string()]).status();
    assert!(killed.expect("kill runs").success());
}

#[test]
fn a_replay_writes_no_log_and_says_so_with_exit_code_2() {
    let fixture = fixture();
    let [log, other] = ["decisions.mcap", "other.mcap"].map(|name| fixture.root().join(name));
    let (file, again) = (log.to_str().expect("UTF-8"), other.to_str().expect("UTF-8"));
    let mut arguments = RUN.to_vec();
    arguments.extend(["--log", file]);
    assert_eq!(vocaloco(fixture.root(), &arguments, &session(0..3)).status.code(), Some(0));
    let source = format!("replay:{file}");
    let arguments = ["run", "--deployment", "stairs", "--source", &source, "--log", again];
    let output = vocaloco(fixture.root(), &arguments, "");
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(error.contains("--log: found ") && error.contains("wanted nothing with"), "{error}");
    assert!(!other.exists());
}

#[test]
fn a_tick_or_a_file_that_is_not_there_is_exit_code_2() {
    let root = shipped().root;
    let output = vocaloco(&root, &["explain", "no/such.mcap"], "");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("no/such.mcap"));
}

#[test]
fn the_simulator_is_a_source_like_any_other() {
    let fixture = fixture();
    let log = fixture.root().join("sim.mcap");
    let file = log.to_str().expect("UTF-8");
    let arguments = ["run", "--deployment", "stairs", "--source", "sim", "--log", file, "--json"];
    let output = vocaloco(fixture.root(), &arguments, "");
    let report: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    // The skill holds the stand, so the robot stays where it is until the time is up.
    assert_eq!(report["outcome"], "stuck", "{report}");
    assert_eq!(report["switches"], json!([{"t_s": 0.18, "from": "stand", "to": "walk"}]));

    let source = format!("replay:{file}");
    let replay = ["run", "--deployment", "stairs", "--source", &source, "--json"];
    let replayed = vocaloco(fixture.root(), &replay, "");
    let replayed: Value = serde_json::from_slice(&replayed.stdout).expect("one JSON object");
    assert_eq!(replayed["differing_ticks"], 0, "{replayed}");
    let mut again: Value =
        serde_json::from_slice(&vocaloco(fixture.root(), &arguments, "").stdout).expect("one JSON object");
    // What ticks took is of the machine and the moment.
    assert_eq!(again["timing"]["ticks"], report["timing"]["ticks"]);
    again["timing"] = report["timing"].clone();
    assert_eq!(again, report, "and it repeats exactly");
}

/// On one core, the loop at a real-time priority: what spins in its process must neither keep the sound skill's
/// predictions from that core nor go on for ever. Where priorities are refused, nothing is looked at.
#[cfg(target_os = "linux")]
#[test]
fn at_a_real_time_priority_an_isolated_plugin_that_spins_keeps_nobody_from_the_core() {
    let permitted = Command::new("taskset").args(["-c", "0", "chrt", "-f", "20", "true"]).status();
    if !permitted.is_ok_and(|status| status.success()) {
        eprintln!("no real-time priorities here");
        return;
    }
    let fixture = fixture();
    fixture.add_skill("spinning", "spin", 0.99, 0.1);
    fixture.alter("manifests/skills/spinning.toml", "plugin =", "isolation = \"process\"\nplugin =");
    fixture.add_deployment("stairs", &["spinning", "walk"]);
    let mut on_one_core = Command::new("taskset");
    on_one_core.args(["-c", "0", "chrt", "-f", "20"]).arg(plugin_folder().join("vocaloco"));
    let mut child = spawn(on_one_core.args(RUN).arg("--real-time"), fixture.root());
    let mut stdin = child.stdin.take().expect("a pipe");
    let mut answers = BufReader::new(child.stdout.take().expect("a pipe")).lines();
    let mut answer = || answers.next().expect("an answer").expect("UTF-8");
    answer();
    let (mut events, mut drives) = (String::new(), 0);
    // At the robot's pace, for longer than a call that hangs is given.
    for tick in 0..200 {
        writeln!(stdin, "{}", standing_line(tick)).expect("a line is taken");
        let answer: Value = serde_json::from_str(&answer()).expect("JSON");
        events += &answer["events"].to_string();
        drives += usize::from(answer["active"] == "walk");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let children = format!("/proc/{0}/task/{0}/children", child.id());
    let left = std::fs::read_to_string(children).unwrap_or_default();
    // Whatever is found below: nothing may spin on at such a priority.
    for process in left.split_whitespace() {
        drop(Command::new("kill").args(["-s", "KILL", process]).status());
    }
    assert!(events.contains("skill spinning is taken out of service: "), "{events}");
    assert!(!events.contains("skill walk is "), "the sound one is never late: {events}");
    assert!(drives > 100, "{drives} ticks of 200: {events}");
    assert!(left.trim().is_empty(), "its process has ended: {left}");
    drop(stdin);
    child.wait().expect("it ends");
}
