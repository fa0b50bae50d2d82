//! Every command of docs/add-a-skill.md is run as it stands there, by a shell, in a temporary installation; only
//! the numbers that the page itself lists are smaller. With an exported policy nothing is compiled.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use vocaloco_core::lock::sha256_hex;
use vocaloco_tests::{Fixture, plugin_folder, repository};

const RUST: &str = "A controller in Rust";

/// The page, cut at its headings, with the small numbers in place.
fn sections() -> Vec<(String, String)> {
    let page = fs::read_to_string(repository().join("docs/add-a-skill.md")).expect("the page");
    let (_, rest) = page.split_once("<!--").expect("the list of smaller numbers");
    let (list, text) = rest.split_once("-->").expect("its end");
    let mut text = text.to_owned();
    for line in list.lines().filter(|line| line.starts_with('`')) {
        let pieces: Vec<&str> = line.split('`').filter(|piece| !piece.trim().is_empty()).collect();
        let [from, to] = pieces[..] else { panic!("{line:?} is no pair") };
        assert!(text.contains(from), "{from:?} stands on the page");
        text = text.replace(from, to);
    }
    let headed = text.split("\n## ").skip(1);
    headed
        .map(|section| {
            let (heading, body) = section.split_once('\n').expect("a body");
            (heading.to_owned(), body.to_owned())
        })
        .collect()
}

/// The lines that a reader types, of a section.
fn commands(body: &str) -> Vec<String> {
    let blocks = body.split("```sh\n").skip(1).map(|block| block.split("```").next().expect("its end"));
    blocks.flat_map(str::lines).map(str::to_owned).collect()
}

/// Runs a section's commands in one shell that ends at the first that fails.
fn follow(root: &Path, heading: &str, commands: &[String], path: &str) {
    let mut shell = Command::new("sh");
    shell.args(["-eu", "-c", &commands.join("\n")]).current_dir(root);
    shell.env_remove("VOCALOCO_ROOT").env_remove("VOCALOCO_PLUGIN_PATH").env("PATH", path);
    let output = shell.output().expect("a shell");
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    assert!(output.status.success(), "{heading}: {}\n{}", commands.join("\n"), said.concat());
}

/// A folder of programs that stand before all others.
fn before_all(folder: &Path, programs: &[(&str, String)]) -> String {
    for (name, text) in programs {
        let file = folder.join(name);
        fs::write(&file, format!("#!/bin/sh\n{text}\n")).expect("written");
        let status = Command::new("chmod").arg("+x").arg(&file).status().expect("chmod");
        assert!(status.success());
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut folders = vec![folder.to_owned(), plugin_folder().to_owned()];
    folders.extend(std::env::split_paths(&path));
    std::env::join_paths(folders).expect("a path").into_string().expect("text")
}

/// Hashes of what is built.
fn built() -> Vec<(PathBuf, String)> {
    let named = |name: &str| format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let libraries = ["gait", "onnx"].map(vocaloco_core::plugin::library_file_name);
    let names = [named("vocaloco"), named("vocaloco-train")].into_iter().chain(libraries);
    let path = |name| plugin_folder().join(name);
    names.map(|name| (path(name.clone()), sha256_hex(&fs::read(path(name)).expect("built")))).collect()
}

#[test]
fn an_exported_policy_comes_to_a_locked_run_and_to_another_machine_without_a_compiler() {
    vocaloco_dev::build_plugins(&[], &["vocaloco-train"]).expect("vocaloco-train builds");
    let fixture = Fixture::new();
    fixture.add_shipped(&["walk", "walk_network", "ascend_network", "descend_network"]);
    let deployment = "manifests/deployments/anymal_stairs.toml";
    fixture.write(deployment, &fs::read(repository().join(deployment)).expect("the shipped deployment"));
    let tools = tempfile::tempdir().expect("a folder");
    let called = tools.path().join("called");
    let refuse = format!("echo \"$0 $*\" >> {}; exit 1", called.display());
    let path = before_all(tools.path(), &["cargo", "rustc", "cc"].map(|name| (name, refuse.clone())));
    let before = built();

    let mut to_the_locked_run = 0;
    #[expect(clippy::disallowed_methods, reason = "says how long the commands took")]
    let began = Instant::now();
    for (heading, body) in sections().iter().filter(|(heading, _)| heading != RUST) {
        let commands = commands(body);
        follow(fixture.root(), heading, &commands, &path);
        if heading != "To another machine" {
            to_the_locked_run += commands.len();
        }
    }
    eprintln!(
        "{to_the_locked_run} commands and those to another machine: {:.1} s",
        began.elapsed().as_secs_f64()
    );

    assert!(!called.exists(), "called: {}", fs::read_to_string(&called).unwrap_or_default());
    assert!(before == built(), "nothing that exists was built again");
    let (_, takes) =
        sections().into_iter().find(|(heading, _)| heading == "What it takes").expect("a section");
    assert!(
        takes.contains(&format!(": {to_the_locked_run} commands")),
        "the page counts {to_the_locked_run}: {takes}"
    );
    for made in ["out/look.html", "out/decisions.mcap", "out/course/report.html", "out/stroll.skill"] {
        assert!(fixture.root().join(made).is_file(), "{made}");
    }
    assert!(!fixture.root().join("out/robot/skills/stroll").exists(), "it was removed again");
}

#[test]
fn a_controller_in_rust_is_built_tested_and_looked_at() {
    let fixture = Fixture::workspace();
    let tools = tempfile::tempdir().expect("a folder");
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let target = plugin_folder().parent().expect("the target folder").display();
    // The interface is compiled anew at its new place; what it depends on is there.
    let offline = format!("CARGO_TARGET_DIR='{target}' exec '{cargo}' \"$@\" --offline");
    let path = before_all(tools.path(), &[("cargo", offline)]);
    let (heading, body) = sections().into_iter().find(|(heading, _)| heading == RUST).expect("a section");
    follow(fixture.root(), &heading, &commands(&body), &path);
    assert!(fixture.root().join("out/tiptoe.html").is_file());
}
