//! A library that cannot be a plugin of this host is refused with one line that says what it is and
//! what would be right; it never ends the process, and one that is sound loads beside any other.

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use vocaloco_core::plugin::{PluginError, PluginLibrary, library_file_name};
use vocaloco_core::robot::RobotModel;
use vocaloco_tests::{plugin_folder, shipped};

/// The refusal of a library called `name` with these bytes.
fn refusal(name: &str, bytes: &[u8]) -> PluginError {
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::write(folder.path().join(library_file_name(name)), bytes).expect("a written file");
    let error = PluginLibrary::open(&[folder.path().to_owned()], name).expect_err("a refusal");
    let line = error.to_string();
    assert!(!line.contains('\n') && line.len() < 400, "one readable line: {line}");
    assert!(line.contains(&library_file_name(name)), "names the file: {line}");
    eprintln!("{line}");
    error
}

fn built(name: &str) -> Vec<u8> {
    fs::read(plugin_folder().join(library_file_name(name))).expect("a built plugin")
}

fn path() -> Vec<PathBuf> {
    vec![plugin_folder().to_owned()]
}

#[test]
fn two_plugins_load_side_by_side_and_stay_themselves() {
    let gait = PluginLibrary::open(&path(), "gait").expect("gait loads");
    let faulty = PluginLibrary::open(&path(), "faulty").expect("faulty loads");
    assert_eq!(gait.description().name, "gait");
    assert_eq!(faulty.description().name, "faulty");
    assert!(!gait.description().parameters.is_empty() && faulty.description().parameters.is_empty());
    let robot = RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the shipped robot");
    gait.create("", &robot.description).expect("a gait");
    faulty.create("none", &robot.description).expect("a faulty one");
    let error = faulty.create("period_s = 0.5", &robot.description).expect_err("not gait's parameters");
    assert!(error.to_string().contains("period_s"), "{error}");
}

#[test]
fn the_same_bytes_are_loaded_once_wherever_they_lie() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::write(folder.path().join(library_file_name("faulty")), built("faulty")).expect("a copy");
    let first = PluginLibrary::open(&path(), "faulty").expect("loads");
    let copy = PluginLibrary::open(&[folder.path().to_owned()], "faulty").expect("loads");
    assert!(Arc::ptr_eq(&first, &copy));
    assert_eq!(first.sha256().len(), 64);
}

/// Two bundles bring the same plugin along; a child loads its library from where its own skill has it.
#[cfg(target_os = "linux")]
#[test]
fn the_same_bytes_serve_an_isolated_skill_when_those_of_another_are_gone() {
    let robot = RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the shipped robot");
    let folders = [(); 2].map(|()| tempfile::tempdir().expect("a temporary folder"));
    let [first, second] = folders.each_ref().map(|folder| {
        fs::write(folder.path().join(library_file_name("faulty")), built("faulty")).expect("a written file");
        let search_path = [folder.path().to_owned(), plugin_folder().to_owned()];
        PluginLibrary::open_isolated(&search_path, "faulty", &|_, _| Ok(())).expect("it describes itself")
    });
    let [gone, _left] = folders;
    gone.close().expect("a folder that is gone");
    second.create("", &robot.description).expect("its own file is there");
    let error = first.create("", &robot.description).expect_err("nothing to load").to_string();
    assert!(error.contains(&library_file_name("faulty")) && error.contains("No such file"), "{error}");
}

#[test]
fn a_missing_plugin_names_the_folders_searched() {
    let error = PluginLibrary::open(&path(), "no_such_plugin").expect_err("a refusal");
    let line = error.to_string();
    assert!(matches!(error, PluginError::NotFound(_)), "{line}");
    assert!(line.contains("no_such_plugin") && line.contains(&path()[0].display().to_string()), "{line}");
}

#[test]
fn a_truncated_library_is_refused_and_the_process_lives() {
    let bytes = built("faulty");
    for share in [0.0, 0.001, 0.3, 0.7, 0.99] {
        let cut = (bytes.len() as f64 * share) as usize;
        let error = refusal("faulty", &bytes[..cut]);
        assert!(matches!(error, PluginError::NotALibrary(_)), "{error}");
    }
}

#[test]
fn a_text_file_is_no_library() {
    let error = refusal("faulty", b"#!/bin/sh\necho a script that was given the wrong name\n");
    assert!(matches!(error, PluginError::NotALibrary(_)), "{error}");
}

#[test]
fn a_program_is_no_library() {
    let program = fs::read(std::env::current_exe().expect("a path")).expect("this program");
    let error = refusal("faulty", &program);
    assert!(matches!(error, PluginError::NotALibrary(_)), "{error}");
}

#[test]
fn a_library_that_exports_no_skill_is_told_how_to() {
    let mut bytes = built("faulty");
    let symbol = b"vocaloco_skill_library";
    let places: Vec<usize> =
        (0..bytes.len() - symbol.len()).filter(|at| bytes[*at..].starts_with(symbol)).collect();
    assert!(!places.is_empty());
    for at in places {
        bytes[at] = b'x';
    }
    let error = refusal("faulty", &bytes);
    assert!(matches!(error, PluginError::ForeignInterface(_)), "{error}");
    assert!(error.to_string().contains("export_skill!"), "{error}");
}

#[test]
fn another_layout_of_the_interface_is_refused_in_one_line() {
    let error = refusal("foreign_layout", &built("foreign_layout"));
    assert!(matches!(error, PluginError::ForeignInterface(_)), "{error}");
    assert!(error.to_string().contains("skill interface 2"), "{error}");
}

#[test]
fn another_version_of_the_interface_is_refused_naming_both() {
    let error = refusal("foreign_version", &built("foreign_version"));
    assert!(matches!(error, PluginError::ForeignInterface(_)), "{error}");
    let line = error.to_string();
    assert!(line.contains("found skill interface 3") && line.contains("skill interface 2"), "{line}");
}

#[test]
fn a_plugin_under_another_name_is_refused() {
    let error = refusal("renamed", &built("faulty"));
    assert!(matches!(error, PluginError::Description(_)), "{error}");
}

#[test]
fn a_panic_in_create_is_an_error() {
    let robot = RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the shipped robot");
    let faulty = PluginLibrary::open(&path(), "faulty").expect("loads");
    let error = faulty.create("panic_in_create", &robot.description).expect_err("an error");
    assert!(error.to_string().contains("create panicked: asked for a panic in create"), "{error}");
}
