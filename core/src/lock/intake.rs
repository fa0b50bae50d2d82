//! The one way in for the files of a deployment: each is read once, and what was read is what is
//! recorded, held against the lock, parsed and run.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;

use super::{Lock, bytes_of, sha256_hex};
use crate::manifest::Finding;

/// Reads the files below a root.
pub(crate) struct Intake<'a> {
    root: &'a Path,
    mode: Mode<'a>,
}

enum Mode<'a> {
    /// Anything is taken.
    Open,
    /// Anything is taken and written down.
    Recording(RefCell<Record>),
    /// What the lock has is taken.
    Locked(&'a Lock),
}

/// Hashes of what was read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Record {
    pub(crate) files: BTreeMap<String, String>,
    pub(crate) plugins: BTreeMap<String, String>,
}

impl<'a> Intake<'a> {
    pub(crate) const fn open(root: &'a Path) -> Self {
        Self { root, mode: Mode::Open }
    }

    pub(crate) fn recording(root: &'a Path) -> Self {
        Self { root, mode: Mode::Recording(RefCell::default()) }
    }

    pub(crate) const fn locked(root: &'a Path, lock: &'a Lock) -> Self {
        Self { root, mode: Mode::Locked(lock) }
    }

    /// What a lock has, or anything where there is none.
    pub(crate) const fn of(root: &'a Path, lock: Option<&'a Lock>) -> Self {
        match lock {
            Some(lock) => Self::locked(root, lock),
            None => Self::open(root),
        }
    }

    /// What was read while recording.
    pub(crate) fn into_record(self) -> Record {
        match self.mode {
            Mode::Recording(record) => record.into_inner(),
            Mode::Open | Mode::Locked(_) => Record::default(),
        }
    }

    /// The bytes of a file of at most `max_bytes`; `named_by` and `field` say who named it.
    pub(crate) fn bytes(
        &self,
        path: &Path,
        max_bytes: u64,
        named_by: &Path,
        field: &str,
    ) -> Result<Vec<u8>, Finding> {
        let bytes = bytes_of(path, max_bytes).map_err(|found| {
            let found = if named_by == path { found } else { format!("{}: {found}", path.display()) };
            Finding::new(named_by, field, found, format!("a readable file of at most {max_bytes} bytes"))
        })?;
        let key = || {
            let inside = path.strip_prefix(self.root).unwrap_or(path);
            let parts: Vec<_> = inside.iter().map(|part| part.to_string_lossy()).collect();
            parts.join("/")
        };
        match &self.mode {
            Mode::Open => {}
            Mode::Recording(record) => {
                record.borrow_mut().files.insert(key(), sha256_hex(&bytes));
            }
            Mode::Locked(lock) => lock.admit(path, lock.files().get(&key()), &sha256_hex(&bytes))?,
        }
        Ok(bytes)
    }

    /// As [`bytes`](Self::bytes), as text.
    pub(crate) fn text(
        &self,
        path: &Path,
        max_bytes: u64,
        named_by: &Path,
        field: &str,
    ) -> Result<String, Finding> {
        let readable = |found: String| {
            let wanted = format!("a readable text file of at most {max_bytes} bytes");
            Finding::new(named_by, field, format!("{}: {found}", path.display()), wanted)
        };
        let bytes = self.bytes(path, max_bytes, named_by, field).map_err(|finding| {
            let wanted = finding.wanted.replace("a readable file", "a readable text file");
            Finding { wanted, ..finding }
        })?;
        String::from_utf8(bytes).map_err(|error| readable(error.to_string()))
    }

    /// Whether a library, the plugin of `skill`, may be loaded.
    pub(crate) fn plugin(&self, skill: &str, file: &Path, bytes: &[u8]) -> Result<(), Finding> {
        match &self.mode {
            Mode::Open => Ok(()),
            Mode::Recording(record) => {
                record.borrow_mut().plugins.insert(skill.to_owned(), sha256_hex(bytes));
                Ok(())
            }
            Mode::Locked(lock) => lock.admit(file, lock.plugins().get(skill), &sha256_hex(bytes)),
        }
    }
}
