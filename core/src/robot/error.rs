//! What can be wrong with a robot's files.

use std::path::{Path, PathBuf};

use crate::manifest::{FIELD_CHARS, Finding, WORDS_CHARS, readable};

/// Why a robot was refused.
#[derive(Debug, thiserror::Error)]
pub enum RobotError {
    /// The file is not the one that was locked.
    #[error("{0}")]
    Refused(Finding),
    /// The file is not TOML of the right form, or not MJCF.
    #[error("{}: {message}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What the parser says: field, found, expected.
        message: String,
    },
    /// A field holds what the project does not take.
    #[error("{}: {field}: found {found}, wanted {wanted}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// The field, such as `LF_HAA.range`.
        field: String,
        /// What stands there.
        found: String,
        /// What would be right.
        wanted: String,
    },
}

impl RobotError {
    pub(super) fn field(
        path: &Path,
        field: impl Into<String>,
        found: impl Into<String>,
        wanted: impl Into<String>,
    ) -> Self {
        let words = |text: String| readable(&text, WORDS_CHARS);
        Self::Field {
            path: path.to_owned(),
            field: readable(&field.into(), FIELD_CHARS),
            found: words(found.into()),
            wanted: words(wanted.into()),
        }
    }

    pub(super) fn malformed(path: &Path, message: &dyn std::fmt::Display) -> Self {
        Self::Malformed { path: path.to_owned(), message: readable(&message.to_string(), WORDS_CHARS) }
    }
}
