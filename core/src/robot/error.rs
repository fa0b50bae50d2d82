//! What can be wrong with a robot's files.

use std::path::{Path, PathBuf};

use crate::manifest::Finding;

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
        Self::Field { path: path.to_owned(), field: field.into(), found: found.into(), wanted: wanted.into() }
    }

    pub(super) fn malformed(path: &Path, message: &dyn std::fmt::Display) -> Self {
        Self::Malformed { path: path.to_owned(), message: message.to_string().trim_end().replace('\n', " ") }
    }
}
