//! What was measured, kept on disk: a file a result, found again by everything that it depends on, so
//! that a killed evaluation goes on where it was and one that stands is not measured twice.

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use vocaloco_sim::identity::sha256_hex;

/// Where results are kept and how they are measured, as the flags of every verb that keeps them.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct StoreArgs {
    /// Folder of what was measured: a killed run goes on, and what stands is not measured twice
    #[arg(long, default_value = "out/measured", value_name = "DIR")]
    store: PathBuf,
    /// Measure even what stands
    #[arg(long)]
    fresh: bool,
    /// Threads; 0 for as many as there are processors
    #[arg(long, default_value_t = 0, value_name = "N")]
    threads: usize,
}

impl StoreArgs {
    /// The store, and the threads to measure with.
    pub(super) fn open(&self) -> anyhow::Result<(Store, usize)> {
        Ok((Store::open(&self.store, self.fresh)?, self.threads))
    }
}

/// A folder of results.
#[derive(Clone, Debug)]
pub(super) struct Store {
    folder: PathBuf,
    /// Measure even what stands.
    fresh: bool,
}

#[derive(Serialize, Deserialize)]
struct Entry {
    /// Of the key's text, since numbers may come back from text a bit off.
    key_sha256: String,
    key: Value,
    result: Value,
}

impl Store {
    /// The store in `folder`, made when it is not there.
    pub(super) fn open(folder: &Path, fresh: bool) -> anyhow::Result<Self> {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        Ok(Self { folder: folder.to_owned(), fresh })
    }

    /// The result that stands under `key`, else what `measure` gives, on disk before it is returned.
    ///
    /// Both ways the result has been through JSON, so that a run that goes on ends with the bytes of one
    /// that was never stopped. `standing` is called when nothing was measured.
    pub(super) fn result<T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        key: &impl Serialize,
        standing: impl FnOnce(),
        measure: impl FnOnce() -> anyhow::Result<T>,
    ) -> anyhow::Result<T> {
        let key = serde_json::to_value(key)?;
        let digest = sha256_hex(key.to_string().as_bytes());
        let path = self.folder.join(format!("{name}-{}.json", &digest[..12]));
        if !self.fresh
            && let Some(result) = read(&path, &digest)
        {
            standing();
            return Ok(result);
        }
        let result = as_written(&measure()?)?;
        let entry = Entry { key_sha256: digest, key, result };
        let text = serde_json::to_string_pretty(&entry)?;
        let unfinished = path.with_extension("part");
        std::fs::write(&unfinished, text + "\n")
            .and_then(|()| std::fs::rename(&unfinished, &path))
            .with_context(|| format!("cannot write {}", path.display()))?;
        read(&path, &entry.key_sha256)
            .with_context(|| format!("{} does not hold what was written", path.display()))
    }
}

/// A value as its text reads: 0.1 in single precision stays 0.1, and is not written out in double.
pub(super) fn as_written(value: &impl Serialize) -> serde_json::Result<Value> {
    serde_json::from_str(&serde_json::to_string(value)?)
}

/// The result of a file whose key has this hash; none when there is no such file, or it holds another.
fn read<T: DeserializeOwned>(path: &Path, key_sha256: &str) -> Option<T> {
    let text = std::fs::read_to_string(path).ok()?;
    let entry: Entry = serde_json::from_str(&text).ok()?;
    (entry.key_sha256 == key_sha256).then(|| serde_json::from_value(entry.result).ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn measured(store: &Store, key: &Value, result: f64) -> (f64, bool) {
        let mut stood = false;
        let found = store.result("row", key, || stood = true, || Ok(result)).unwrap();
        (found, stood)
    }

    #[test]
    fn what_stands_is_not_measured_again_until_anything_it_depends_on_changes() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), false).unwrap();
        let key = json!({ "size_m": 0.1_f32, "model": "ab" });
        assert_eq!(measured(&store, &key, 1.5), (1.5, false));
        assert_eq!(measured(&store, &key, 9.0), (1.5, true));
        assert_eq!(measured(&store, &json!({ "size_m": 0.1_f32, "model": "ac" }), 2.0), (2.0, false));
        let fresh = Store::open(folder.path(), true).unwrap();
        assert_eq!(measured(&fresh, &key, 3.0), (3.0, false));
        assert_eq!(measured(&store, &key, 9.0), (3.0, true));
    }

    #[test]
    fn single_precision_is_written_as_it_is_read() {
        assert_eq!(as_written(&json!([1])).unwrap(), json!([1]));
        assert_eq!(as_written(&0.95_f32).unwrap().to_string(), "0.95");
    }

    #[test]
    fn a_file_cut_short_is_measured_again() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), false).unwrap();
        let key = json!({ "n": 1 });
        measured(&store, &key, 1.5);
        let file = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        std::fs::write(&file, "{\"key\": {\"n\"").unwrap();
        assert_eq!(measured(&store, &key, 2.5), (2.5, false));
    }

    #[test]
    fn a_measurement_that_fails_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), false).unwrap();
        let failed = store.result::<f64>("row", &json!(1), || (), || anyhow::bail!("no pose"));
        assert!(failed.is_err());
        assert_eq!(measured(&store, &json!(1), 4.0), (4.0, false));
    }
}
