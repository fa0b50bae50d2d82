//! What a check found wrong, in one line.

use std::fmt::{self, Display};
use std::path::{Path, PathBuf};

/// A defect of a file: where, what was found and what would be right.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The file at fault.
    pub file: PathBuf,
    /// Line in it, counted from 1, where it is known.
    pub line: Option<usize>,
    /// The field, such as `selection.viability_threshold`.
    pub field: String,
    /// What stands there.
    pub found: String,
    /// What would be right.
    pub wanted: String,
}

impl Finding {
    /// A finding without a line. Line breaks become spaces, other control characters vanish, and what is longer than
    /// anybody reads is cut: fields, too, may come from a hostile file.
    pub fn new(file: &Path, field: impl Into<String>, found: impl Display, wanted: impl Display) -> Self {
        Self {
            file: file.to_owned(),
            line: None,
            field: readable(&field.into(), FIELD_CHARS),
            found: readable(&found.to_string(), WORDS_CHARS),
            wanted: readable(&wanted.to_string(), WORDS_CHARS),
        }
    }

    /// The same finding with its file named relative to `root`, where it lies inside.
    #[must_use]
    pub fn relative_to(mut self, root: &Path) -> Self {
        if let Ok(inside) = self.file.strip_prefix(root) {
            self.file = inside.to_owned();
        }
        self
    }
}

/// Longest field, characters.
pub(crate) const FIELD_CHARS: usize = 120;
/// Longest of the other words, characters.
pub(crate) const WORDS_CHARS: usize = 2000;

/// A text in one line of at most so many characters, without anything that a terminal would act on.
pub(crate) fn readable(text: &str, most: usize) -> String {
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut clean: String = words.chars().filter(|it| !it.is_control()).take(most + 1).collect();
    if clean.chars().count() > most {
        clean = clean.chars().take(most - 3).chain("...".chars()).collect();
    }
    clean
}

impl Display for Finding {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}", self.file.display())?;
        if let Some(line) = self.line {
            write!(formatter, ":{line}")?;
        }
        write!(formatter, ": {}: found {}, wanted {}", self.field, self.found, self.wanted)
    }
}

impl std::error::Error for Finding {}
