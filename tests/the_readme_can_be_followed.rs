//! What the documents tell a reader to type is accepted, what they show is shipped, and nothing waits
//! to be filled in.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use vocaloco_core::manifest::{Deployment, Finding, SkillManifest};
use vocaloco_tests::repository;

const DOCUMENTS: [&str; 12] = [
    "README.md",
    "docs/data.md",
    "docs/reproduce.md",
    "docs/method.md",
    "docs/locks.md",
    "docs/bridge.md",
    "docs/switching.md",
    "docs/paper.md",
    "docs/predictors.md",
    "docs/novelty.md",
    "docs/manifests.md",
    "docs/add-a-robot.md",
];

/// Lines of the code blocks of one language.
fn blocks(text: &str, language: &str) -> Vec<String> {
    let opening = format!("{language}\n");
    let inside = text.split("```").skip(1).step_by(2);
    inside.filter_map(|block| block.strip_prefix(opening.as_str())).map(str::to_owned).collect()
}

/// The folder of `vocaloco` and `vocaloco-train`.
static PROGRAMS: LazyLock<PathBuf> = LazyLock::new(|| {
    vocaloco_dev::build_plugins(&[], &["vocaloco", "vocaloco-train"]).expect("vocaloco builds")
});

/// Whether `vocaloco` takes these arguments: asked for help after them, it complains about them first.
fn is_accepted(arguments: &[&str]) -> Result<(), String> {
    let mut command = Command::new(PROGRAMS.join("vocaloco"));
    let output = command.args(arguments).arg("--help").current_dir(repository()).output().expect("it starts");
    let narration = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.success() { Ok(()) } else { Err(narration) }
}

#[test]
fn every_command_line_is_accepted() {
    let (mut count, mut refused) = (0, Vec::new());
    for document in DOCUMENTS {
        let text = fs::read_to_string(repository().join(document)).expect(document);
        for line in blocks(&text, "sh").iter().flat_map(|block| block.lines()) {
            let typed = line.split('#').next().unwrap_or_default();
            let words: Vec<&str> = typed.split_whitespace().collect();
            let arguments = match words.as_slice() {
                [] | ["cargo", "test"] => continue,
                ["cargo", "vocaloco", arguments @ ..] => arguments.to_vec(),
                [root, "cargo", "vocaloco", arguments @ ..] if root.starts_with("VOCALOCO_ROOT=") => {
                    arguments.to_vec()
                }
                ["cargo", "demo", arguments @ ..] => [&["demo"], arguments].concat(),
                _ => panic!("{document}: {line:?} is no command that this test knows"),
            };
            if let Err(error) = is_accepted(&arguments) {
                refused.push(format!("{document}: {line}\n{error}"));
            }
            count += 1;
        }
    }
    assert!(refused.is_empty(), "{}", refused.join("\n"));
    assert!(count >= 10, "only {count} command lines found");
    // The look itself works: what is wrong is complained about, in either program.
    for wrong in [&["demo", "--no-such-flag"][..], &["train", "--no-such-flag"], &["no-such-verb"]] {
        assert!(is_accepted(wrong).is_err(), "{wrong:?}");
    }
}

#[test]
fn the_manifest_shown_is_the_one_shipped() {
    let readme = fs::read_to_string(repository().join("README.md")).expect("README.md");
    let shown = blocks(&readme, "toml");
    let shipped = repository().join("manifests/skills/ascend.toml");
    assert_eq!(shown, [fs::read_to_string(shipped).expect("the manifest")]);
}

/// The names in backticks that a refusal of a field `unknown` offers in its place.
fn known_fields(finding: Option<Finding>) -> Vec<String> {
    let wanted = finding.expect("a field that nobody knows is refused").wanted;
    wanted.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

#[test]
fn every_field_of_a_manifest_is_listed_and_the_example_is_read() {
    let text = fs::read_to_string(repository().join("docs/manifests.md")).expect("docs/manifests.md");
    let [example] = blocks(&text, "toml").try_into().expect("one example");
    let deployment = |text: String| Deployment::parse(Path::new("manifests/deployments/one.toml"), text);
    deployment(example.clone()).expect("the example is sound");
    let shipped = fs::read_to_string(repository().join("manifests/skills/ascend.toml")).expect("a manifest");
    let skill = |text: String| SkillManifest::parse(Path::new("manifests/skills/ascend.toml"), text).err();
    let mut listed = 0;
    for table in ["", "[heightfield]\n", "[measurement]\n", "[deadlines]\n", "[switching]\n"] {
        let spoiled = if table.is_empty() {
            format!("unknown = 1\n{example}")
        } else {
            format!("{example}\n{table}unknown = 1\n")
        };
        for field in known_fields(deployment(spoiled).err()) {
            assert!(text.contains(&field), "{table}{field} of a deployment is not in docs/manifests.md");
            listed += 1;
        }
    }
    for table in ["", "[models]\n", "[selection]\n", "[command]\n", "[rollout]\n"] {
        let spoiled = match table {
            "" => format!("unknown = 1\n{shipped}"),
            "[rollout]\n" => format!("{shipped}\n[rollout]\nunknown = 1\n"),
            table => shipped.replace(table, &format!("{table}unknown = 1\n")),
        };
        for field in known_fields(skill(spoiled)) {
            assert!(text.contains(&field), "{table}{field} of a skill is not in docs/manifests.md");
            listed += 1;
        }
    }
    assert!(listed > 30, "only {listed} fields were looked for");
}

#[test]
fn nothing_waits_to_be_filled_in() {
    for document in DOCUMENTS {
        let text = fs::read_to_string(repository().join(document)).expect(document);
        let waiting: Vec<&str> = text.lines().filter(|line| line.contains(concat!("TO ", "FILL"))).collect();
        assert!(waiting.is_empty(), "{document}: {waiting:#?}");
    }
}
