//! A plugin crate from `plugins/template`, a manifest and a skill folder, and the crate's name among the
//! workspace's members.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};

use super::Args;
use crate::exit::Exit;

macro_rules! template {
    ($file:literal) => {
        include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../plugins/template/", $file))
    };
}

pub(super) fn make(args: &Args, root: &Path) -> anyhow::Result<Exit> {
    let name = args.name.as_str();
    ensure!(!is_keyword(name), "NAME: found {name:?}, a word of Rust or of cargo, wanted another name");
    let dir = &args.dir;
    ensure!(
        dir.components().all(|part| matches!(part, std::path::Component::Normal(_))),
        "--dir: found {}, wanted a folder inside {}",
        dir.display(),
        root.display()
    );
    let workspace = root.join("Cargo.toml");
    let members = with_member(&workspace, &dir.join(name))?;

    let plugin = dir.join(name);
    let files = [
        (plugin.join("Cargo.toml"), template!("Cargo.toml.template")),
        (plugin.join("src/lib.rs"), template!("lib.rs")),
        (plugin.join("tests/contract.rs"), template!("contract.rs")),
        (PathBuf::from(format!("manifests/skills/{name}.toml")), template!("manifest.toml")),
        (PathBuf::from(format!("skills/{name}/{name}.toml")), template!("parameters.toml")),
    ];
    for (path, _) in &files {
        let there = root.join(path).try_exists().with_context(|| path.display().to_string())?;
        ensure!(!there, "{}: found a file of that name, wanted none: nothing is overwritten", path.display());
    }
    for (path, text) in &files {
        write_new(&root.join(path), &named(text, name))?;
    }
    fs::write(&workspace, members).with_context(|| workspace.display().to_string())?;

    let mut written: Vec<String> = files.iter().map(|(path, _)| path.display().to_string()).collect();
    written.push("Cargo.toml (a member)".to_owned());
    let package = package(name);
    let next = vec![
        format!("cargo test --package {package}"),
        format!("cargo build --package {package}"),
        format!("vocaloco collect --skill {name} --kind viability --samples 20000 --repeats 1 --plant fast"),
        format!("vocaloco collect --skill {name} --kind cot --samples 8000 --plant fast"),
        format!("vocaloco train --skill {name}"),
        format!("vocaloco skills check {name}"),
    ];
    args.report(written, next, None)
}

/// A template's text with the skill's name in its three spellings.
fn named(template: &str, name: &str) -> String {
    let camel: String = name.split('_').map(capitalised).collect();
    template
        .replace("vocaloco-template-skill", &package(name))
        .replace("template_skill", name)
        .replace("TemplateSkill", &camel)
}

fn package(name: &str) -> String {
    format!("vocaloco-{}", name.replace('_', "-"))
}

fn capitalised(word: &str) -> String {
    let mut letters = word.chars();
    letters.next().map(|first| first.to_ascii_uppercase().to_string() + letters.as_str()).unwrap_or_default()
}

/// Names that cargo or rustc refuse for a crate, or that the workspace has.
fn is_keyword(name: &str) -> bool {
    const WORDS: [&str; 45] = [
        "abstract", "api", "as", "async", "await", "become", "box", "break", "const", "continue", "core",
        "crate", "do", "dyn", "else", "enum", "extern", "false", "final", "fn", "for", "if", "impl", "in",
        "let", "loop", "match", "mod", "move", "mut", "pub", "ref", "return", "self", "static", "std",
        "struct", "super", "template", "test", "true", "type", "use", "where", "while",
    ];
    WORDS.contains(&name)
}

/// The workspace's `Cargo.toml` with `member` added, comments and order kept.
fn with_member(workspace: &Path, member: &Path) -> anyhow::Result<String> {
    let member = member.to_string_lossy().replace('\\', "/");
    let text = fs::read_to_string(workspace).with_context(|| {
        format!("{}: found no workspace, wanted the source tree: a plugin is a crate", workspace.display())
    })?;
    let members = |text: &str| -> anyhow::Result<Vec<String>> {
        let table: toml::Table = text.parse().with_context(|| workspace.display().to_string())?;
        let list = table.get("workspace").and_then(|it| it.get("members")).and_then(toml::Value::as_array);
        let list = list.with_context(|| format!("{}: workspace.members: found none", workspace.display()))?;
        Ok(list.iter().filter_map(toml::Value::as_str).map(str::to_owned).collect())
    };
    let before = members(&text)?;
    ensure!(!before.contains(&member), "{}: {member:?} is a member already", workspace.display());
    let by_hand = || format!("{}: add {member:?} to workspace.members by hand", workspace.display());
    let start = text.find("\nmembers = [").with_context(by_hand)?;
    let end = start + text[start..].find(']').with_context(by_hand)?;
    let list = text[start..end].trim_end();
    let separator = match (list.ends_with(','), list.ends_with('['), list.contains("[\n")) {
        (_, _, true) => "\n    ",
        (false, false, false) => " ",
        (_, _, false) => "",
    };
    let comma = if list.ends_with([',', '[']) { "" } else { "," };
    let tail = if separator.starts_with('\n') { ",\n" } else { "" };
    let added = format!("{list}{comma}{separator}{member:?}{tail}");
    let edited = format!("{}{added}{}", &text[..start], &text[end..]);
    let mut wanted = before;
    wanted.push(member.clone());
    if members(&edited).ok() != Some(wanted) {
        bail!(by_hand());
    }
    Ok(edited)
}

fn write_new(path: &Path, text: &str) -> anyhow::Result<()> {
    let written = || -> std::io::Result<()> {
        fs::create_dir_all(path.parent().unwrap_or(Path::new(".")))?;
        let mut file = fs::File::create_new(path)?;
        std::io::Write::write_all(&mut file, text.as_bytes())
    };
    written().map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists => anyhow::anyhow!("{}: exists, nothing is overwritten", path.display()),
        _ => anyhow::Error::new(error).context(path.display().to_string()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn added(text: &str) -> anyhow::Result<String> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("Cargo.toml");
        fs::write(&path, text).expect("written");
        with_member(&path, Path::new("plugins/side_step"))
    }

    #[test]
    fn a_member_is_added_to_a_list_of_any_form_and_the_rest_stays() {
        for (before, after) in [
            (
                "[workspace]\nmembers = [\"a\"]\n# b\n",
                "[workspace]\nmembers = [\"a\", \"plugins/side_step\"]\n# b\n",
            ),
            ("[workspace]\nmembers = []\n", "[workspace]\nmembers = [\"plugins/side_step\"]\n"),
            (
                "[workspace]\nmembers = [\n    \"a\",\n    \"b\",\n]\n",
                "[workspace]\nmembers = [\n    \"a\",\n    \"b\",\n    \"plugins/side_step\",\n]\n",
            ),
        ] {
            assert_eq!(added(before).expect("added"), after);
        }
    }

    #[test]
    fn a_list_that_cannot_be_edited_is_left_with_an_instruction() {
        let error = added("[workspace]\nmembers=[\"a\"]\n").expect_err("refused").to_string();
        assert!(error.contains("by hand") && error.contains("plugins/side_step"), "{error}");
        added("[workspace]\nmembers = [\"plugins/side_step\"]\n").expect_err("there already");
    }

    #[test]
    fn a_name_is_spelled_in_all_three_ways() {
        let text = named("vocaloco-template-skill template_skill TemplateSkill", "side_step");
        assert_eq!(text, "vocaloco-side-step side_step SideStep");
    }
}
