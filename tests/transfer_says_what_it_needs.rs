//! `evaluate transfer` without what it needs ends with exit code 2 and a line that says how to get it.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

use vocaloco_tests::{plugin_folder, repository};

/// Exit code and narration with this interpreter.
fn transfer(python: &Path) -> (Option<i32>, String) {
    let output = Command::new(plugin_folder().join("vocaloco"))
        .args(["evaluate", "transfer", "--skill", "walk", "--terrain", "flat", "--samples", "1", "--python"])
        .arg(python)
        .env("VOCALOCO_ROOT", repository())
        .env("VOCALOCO_PLUGIN_PATH", plugin_folder())
        .output()
        .expect("the program starts");
    assert!(output.stdout.is_empty(), "nothing on stdout without a result");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

/// An interpreter that does what a line of shell says.
fn interpreter(folder: &Path, line: &str) -> std::path::PathBuf {
    let path = folder.join("python");
    std::fs::write(&path, format!("#!/bin/sh\n{line}\n")).expect("the script is written");
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).expect("it may run");
    path
}

#[test]
fn a_missing_interpreter_is_exit_2_and_names_what_was_tried() {
    let (code, narration) = transfer(Path::new("/nowhere/python3"));
    assert_eq!(code, Some(2), "{narration}");
    for wanted in ["--python", "/nowhere/python3", "install mujoco"] {
        assert!(narration.contains(wanted), "{wanted} in {narration}");
    }
}

#[test]
fn a_missing_package_is_exit_2_and_says_how_to_install_it() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let python = interpreter(folder.path(), r#"echo "{\"missing\": \"No module named 'mujoco'\"}""#);
    let (code, narration) = transfer(&python);
    assert_eq!(code, Some(2), "{narration}");
    let install = format!("{} -m pip install mujoco", python.display());
    assert!(narration.contains("No module named 'mujoco'") && narration.contains(&install), "{narration}");
}

#[test]
fn an_interpreter_that_is_none_is_exit_2() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (line, wanted) in [("true", "its end"), ("echo hello", "hello")] {
        let (code, narration) = transfer(&interpreter(folder.path(), line));
        assert_eq!(code, Some(2), "{narration}");
        assert!(narration.contains("open the robot's file") && narration.contains(wanted), "{narration}");
    }
}
