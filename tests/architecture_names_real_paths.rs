//! Every path that a document names in backticks exists, and ARCHITECTURE.md stays readable in one go.

use std::fs;
use std::path::Path;

const DOCUMENTS: [&str; 5] =
    ["ARCHITECTURE.md", "README.md", "docs/method.md", "docs/reproduce.md", "docs/safety.md"];

/// A name with a slash and one of these is a path, wherever it leads.
const EXTENSIONS: [&str; 6] = ["rs", "toml", "md", "xml", "py", "onnx"];

/// Folders and files at the top of the repository; what starts with one of them is a path.
fn tops() -> Vec<String> {
    let entries = fs::read_dir(vocaloco_tests::repository()).expect("the repository");
    entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned()).collect()
}

/// The words in backticks outside code blocks that look like a path of this repository.
fn paths(text: &str, tops: &[String]) -> Vec<String> {
    let mut found = Vec::new();
    for (index, block) in text.split("```").enumerate() {
        if index % 2 == 1 {
            continue;
        }
        for (index, span) in block.split('`').enumerate() {
            let is_pattern = span.contains(['*', '<', '{', '…', ' ']);
            let top = span.split('/').next().unwrap_or_default();
            let is_file =
                Path::new(span).extension().is_some_and(|it| EXTENSIONS.iter().any(|known| it == *known));
            let is_path = match (span.contains('/'), tops.iter().any(|it| it == top)) {
                (true, known) => known || is_file,
                (false, known) => known && is_file,
            };
            if index % 2 == 1 && is_path && !is_pattern {
                found.push(span.trim_end_matches('/').to_owned());
            }
        }
    }
    found
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
