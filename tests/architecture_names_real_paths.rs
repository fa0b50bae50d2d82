//! Every path that a document names in backticks exists, and every test that `docs/safety.md` does; ARCHITECTURE.md
//! stays readable in one go.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

const DOCUMENTS: [&str; 5] =
    ["ARCHITECTURE.md", "README.md", "docs/method.md", "docs/reproduce.md", "docs/safety.md"];

/// A name with a slash and one of these is a path, wherever it leads.
const EXTENSIONS: [&str; 6] = ["rs", "toml", "md", "xml", "py", "onnx"];

/// Folders and files at the top of the repository; what starts with one of them is a path.
fn tops() -> Vec<String> {
    let entries = fs::read_dir(vocaloco_tests::repository()).expect("the repository");
    entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned()).collect()
}

/// What stands in backticks outside code blocks.
fn quoted(text: &str) -> impl Iterator<Item = &str> {
    text.split("```").step_by(2).flat_map(|block| block.split('`').skip(1).step_by(2))
}

/// The words in backticks that look like a path of this repository.
fn paths(text: &str, tops: &[String]) -> Vec<String> {
    let is_path = |span: &&str| {
        let is_pattern = span.contains(['*', '<', '{', '…', ' ']);
        let top = span.split('/').next().unwrap_or_default();
        let is_file =
            Path::new(span).extension().is_some_and(|it| EXTENSIONS.iter().any(|known| it == *known));
        let is_path = match (span.contains('/'), tops.iter().any(|it| it == top)) {
            (true, known) => known || is_file,
            (false, known) => known && is_file,
        };
        is_path && !is_pattern
    };
    quoted(text).filter(is_path).map(|span| span.trim_end_matches('/').to_owned()).collect()
}

/// The words in backticks that are as long in snake case as only a test's name is.
fn tests_named(text: &str) -> Vec<&str> {
    let is_snake_case =
        |span: &&str| span.chars().all(|it| it == '_' || it.is_ascii_lowercase() || it.is_ascii_digit());
    quoted(text).filter(is_snake_case).filter(|span| span.matches('_').count() >= 4).collect()
}

/// Names of the functions below a folder that are private, as tests are.
fn functions(folder: &Path) -> Vec<String> {
    let name = |line: &str| {
        let rest = line.trim_start().strip_prefix("fn ")?;
        rest.split(['(', '<']).next().map(str::to_owned)
    };
    let inside = |path: PathBuf| {
        if path.is_dir() {
            return functions(&path);
        }
        let is_source = path.extension().is_some_and(|it| it == "rs");
        let text = if is_source { fs::read_to_string(&path).expect("a source file") } else { String::new() };
        text.lines().filter_map(name).collect()
    };
    let entries = fs::read_dir(folder).expect("a folder");
    entries.flat_map(|entry| inside(entry.expect("an entry").path())).collect()
}

#[test]
fn every_path_named_exists() {
    let root = vocaloco_tests::repository();
    let tops = tops();
    for document in DOCUMENTS {
        let text = fs::read_to_string(root.join(document)).expect(document);
        let named = paths(&text, &tops);
        let missing: Vec<_> = named.iter().filter(|path| !root.join(path).exists()).collect();
        assert!(missing.is_empty(), "{document} names {missing:?}");
    }
}

#[test]
fn the_architecture_names_many_paths_in_at_most_150_lines() {
    let text =
        fs::read_to_string(vocaloco_tests::repository().join("ARCHITECTURE.md")).expect("the document");
    assert!(text.lines().count() <= 150, "{} lines", text.lines().count());
    let named = paths(&text, &tops()).len();
    assert!(named >= 30, "the search finds only {named} paths");
}

#[test]
fn every_test_named_by_the_faults_it_guards_exists() {
    let root = vocaloco_tests::repository();
    let functions: BTreeSet<String> =
        ["tests", "core/src", "cli/src"].iter().flat_map(|folder| functions(&root.join(folder))).collect();
    let text = fs::read_to_string(root.join("docs/safety.md")).expect("the document");
    let named = tests_named(&text);
    assert!(named.len() >= 10, "the search finds only {named:?}");
    let missing: Vec<_> = named.iter().filter(|name| !functions.contains(**name)).collect();
    assert!(missing.is_empty(), "docs/safety.md names {missing:?}");
}

#[test]
fn links_between_documents_lead_somewhere() {
    let root = vocaloco_tests::repository();
    for document in DOCUMENTS {
        let text = fs::read_to_string(root.join(document)).expect(document);
        let folder = Path::new(document).parent().unwrap_or(Path::new(""));
        let targets = text.split("](").skip(1).filter_map(|rest| rest.split([')', '#']).next());
        for target in targets.filter(|it| !it.is_empty() && !it.starts_with("http")) {
            assert!(root.join(folder).join(target).exists(), "{document} links to {target}");
        }
    }
}

#[test]
fn a_word_in_backticks_that_is_no_path_is_left_alone() {
    let tops = ["core".to_owned(), "README.md".to_owned()];
    let text = "`core/src/lib.rs` `cargo test` `a/b` `core/*.rs` `README.md` `CARD.md` `gone/x.rs`\n```\n`core/in_block`\n```\n`core/x/`";
    assert_eq!(paths(text, &tops), ["core/src/lib.rs", "README.md", "gone/x.rs", "core/x"]);
}

#[test]
fn a_word_in_backticks_that_is_no_test_is_left_alone() {
    let text = "`a_fault_is_answered_so` `max_age_s` `A_name_in_other_letters` `a::b_c_d_e_f` a_b_c_d_e\n```\n`in_a_block_of_code`\n```\n`a_2_m_wall_is_met`";
    assert_eq!(tests_named(text), ["a_fault_is_answered_so", "a_2_m_wall_is_met"]);
}
