//! `runs.jsonl`: one line for each run that worked on a data set; what differs between runs and
//! machines without changing a row.

use std::{fs::OpenOptions, io::Write, path::Path};

use serde::Serialize;

use crate::dataset::DatasetError;

/// One run.
#[derive(Clone, Debug, Serialize)]
pub struct RunLog {
    /// The command that repeats it.
    pub command: String,
    /// This run's part, `i/n`.
    pub shard: String,
    /// Threads asked for; 0 for as many as there are processors.
    pub threads: usize,
    /// Version of the program.
    pub version: String,
    /// SHA-256 of the plugin's library.
    pub plugin_sha256: String,
}

impl RunLog {
    /// Adds the line to a data set's folder, which is made if need be.
    ///
    /// # Errors
    /// The file system would not.
    pub fn append(&self, folder: &Path) -> Result<(), DatasetError> {
        std::fs::create_dir_all(folder).map_err(DatasetError::io(folder))?;
        let path = folder.join("runs.jsonl");
        let write = || {
            let mut line = serde_json::to_string(self)?;
            line.push('\n');
            OpenOptions::new().create(true).append(true).open(&path)?.write_all(line.as_bytes())
        };
        write().map_err(DatasetError::io(&path))
    }
}
