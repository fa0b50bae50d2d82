//! What can be wrong with a data set.

use std::path::{Path, PathBuf};

use thiserror::Error;

/// A data set that cannot be read, written or continued.
#[derive(Debug, Error)]
pub enum DatasetError {
    /// The file system would not.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A shard is not the Parquet that it should be.
    #[error("{}: {source}", path.display())]
    Parquet {
        /// The file.
        path: PathBuf,
        /// Why.
        source: parquet::errors::ParquetError,
    },
    /// Something in a file is not as it should be.
    #[error("{}: {field}: found {found}, wanted {wanted}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// The field or column.
        field: String,
        /// What it holds.
        found: String,
        /// What it should hold.
        wanted: String,
    },
    /// Rows are missing: the collection has not ended.
    #[error("{}: {missing} of {wanted} shards are missing, the first is {first}; `collect --resume` makes them", path.display())]
    Incomplete {
        /// The folder.
        path: PathBuf,
        /// Number of missing shards.
        missing: usize,
        /// Number of shards that there should be.
        wanted: usize,
        /// File name of the first missing one.
        first: String,
    },
}

impl DatasetError {
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |source| Self::Io { path: path.to_owned(), source }
    }

    pub(crate) fn parquet(path: &Path) -> impl FnOnce(parquet::errors::ParquetError) -> Self + '_ {
        |source| Self::Parquet { path: path.to_owned(), source }
    }

    pub(crate) fn content(
        path: &Path,
        field: &str,
        found: impl std::fmt::Display,
        wanted: impl std::fmt::Display,
    ) -> Self {
        Self::Content {
            path: path.to_owned(),
            field: field.to_owned(),
            found: found.to_string(),
            wanted: wanted.to_string(),
        }
    }
}
