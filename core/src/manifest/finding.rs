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
    /// A finding without a line. Line breaks in `found` and `wanted` become spaces.
    pub fn new(file: &Path, field: impl Into<String>, found: impl Display, wanted: impl Display) -> Self {
        Self {
            file: file.to_owned(),
            line: None,
            field: field.into(),
            found: one_line(&found.to_string()),
            wanted: one_line(&wanted.to_string()),
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

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
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
