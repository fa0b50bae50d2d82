//! The lock of a deployment: the SHA-256 of every file that loading it reads.
//!
//! `vocaloco lock` loads the deployment and writes down what was read; a locked load takes no other
//! bytes. Files are read once, held against the lock, and parsed or run from that same memory. The lock
//! does not cover this program nor a library of ONNX Runtime.

mod intake;
mod signature;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

pub(crate) use intake::{Intake, Record};
pub use signature::{PublicKey, SecretKey, Signature};
pub(crate) use signature::{SIGNATURE_BYTES, demand};

use crate::installation::Installation;
use crate::manifest::{Finding, MAX_BYTES, bytes_of, read_bounded};

/// A lock, as it was written, with its signature where there is one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lock {
    file: PathBuf,
    text: String,
    content: Content,
    signature: Option<Signature>,
}

/// What a lock's file holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Content {
    schema: u32,
    deployment: String,
    files: BTreeMap<String, String>,
    plugins: BTreeMap<String, String>,
}

impl Lock {
    /// The lock of what loading `deployment` has read.
    pub(crate) fn of(installation: &Installation, deployment: &str, record: Record) -> Result<Self, Finding> {
        let file = lock_file(installation, deployment);
        let content = Content {
            schema: 1,
            deployment: deployment.to_owned(),
            files: record.files,
            plugins: record.plugins,
        };
        let text = toml::to_string(&content)
            .map_err(|error| Finding::new(&file, "file", error, "a lock that can be written out"))?;
        Ok(Self { file, text, content, signature: None })
    }

    /// Reads the lock of a deployment, and its signature if there is one.
    ///
    /// # Errors
    /// There is none, or it or its signature is not as `vocaloco lock` writes it.
    pub fn read(installation: &Installation, deployment: &str) -> Result<Self, Finding> {
        let file = lock_file(installation, deployment);
        let text = read_bounded(&file, MAX_BYTES, &file, "file").map_err(|finding| Finding {
            wanted: format!("the deployment's lock (`vocaloco lock --deployment {deployment}`)"),
            ..finding
        })?;
        let signature_file = signature_file(&file);
        let signature = match signature_file.try_exists() {
            Ok(false) => None,
            _ => Some(Signature::read(&signature_file)?),
        };
        Ok(Self { signature, ..Self::of_text(installation, deployment, text)? })
    }

    /// The lock of a deployment whose text this is, without a signature.
    ///
    /// # Errors
    /// It is not as `vocaloco lock` writes it.
    pub(crate) fn of_text(
        installation: &Installation,
        deployment: &str,
        text: String,
    ) -> Result<Self, Finding> {
        let file = lock_file(installation, deployment);
        let content: Content = toml::from_str(&text).map_err(|error| {
            Finding::new(&file, "file", error.message(), "a lock as `vocaloco lock` writes it")
        })?;
        if content.schema != 1 {
            return Err(Finding::new(&file, "schema", content.schema, 1));
        }
        if content.deployment != deployment {
            let found = format!("{:?}", content.deployment);
            return Err(Finding::new(&file, "deployment", found, format!("{deployment:?}")));
        }
        Ok(Self { file, text, content, signature: None })
    }

    /// The file it is kept in.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// Name of the deployment.
    #[cfg(target_os = "linux")]
    pub(crate) fn deployment(&self) -> &str {
        &self.content.deployment
    }

    /// Its text, which a signature is made of.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Hashes of files by their path below the installation's root.
    pub fn files(&self) -> &BTreeMap<String, String> {
        &self.content.files
    }

    /// Hashes of plugins' libraries by the skill that runs them.
    pub fn plugins(&self) -> &BTreeMap<String, String> {
        &self.content.plugins
    }

    /// Writes it, signed with `key` or with no signature, in place of what was there.
    ///
    /// # Errors
    /// A file cannot be written; the older lock is then without a signature or as it was.
    pub fn write(&self, key: Option<&SecretKey>) -> std::io::Result<()> {
        let signature = signature_file(&self.file);
        // An older signature beside a newer lock would be a foreign one.
        match std::fs::remove_file(&signature) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        replace(&self.file, self.text.as_bytes())?;
        match key {
            Some(key) => replace(&signature, key.sign(self.text.as_bytes()).to_string().as_bytes()),
            None => Ok(()),
        }
    }

    /// Whether one of `keys` has signed it; no keys demand nothing.
    ///
    /// # Errors
    /// There is no signature, it is by none of the keys, or it is not of these bytes.
    pub fn check_signature(&self, keys: &[PublicKey]) -> Result<(), Finding> {
        signature::demand(&self.file, self.text.as_bytes(), self.signature.as_ref(), keys)
    }

    /// Whether `found`, the hash of a file of the installation or of a skill's plugin, is the locked one.
    fn admit(&self, file: &Path, locked: Option<&String>, found: &str) -> Result<(), Finding> {
        let name = self.file.file_name().unwrap_or_default().display();
        let wanted = match locked {
            Some(hash) if hash == found => return Ok(()),
            Some(hash) => format!("{hash}, as {name} has it"),
            None => format!("a file that {name} has"),
        };
        Err(Finding::new(file, "sha256", found, wanted))
    }
}

/// SHA-256 in lowercase hex.
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

fn lock_file(installation: &Installation, deployment: &str) -> PathBuf {
    installation.deployment_file(deployment).with_extension("lock")
}

fn signature_file(lock: &Path) -> PathBuf {
    lock.with_extension("lock.sig")
}

/// Writes a file beside its place and renames it into it: it is there whole or not at all.
pub(crate) fn replace(file: &Path, bytes: &[u8]) -> std::io::Result<()> {
    use std::io::Write;
    let folder = file.parent().unwrap_or(Path::new("."));
    let mut staged = tempfile::NamedTempFile::new_in(folder)?;
    staged.write_all(bytes)?;
    staged.as_file().sync_all()?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        staged.as_file().set_permissions(std::fs::Permissions::from_mode(0o644))?;
    }
    staged.persist(file).map(drop).map_err(|error| error.error)
}
