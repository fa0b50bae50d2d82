//! A skill of this installation into one file.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use flate2::{Compression, GzBuilder};
use vocaloco_plugin_api::INTERFACE_VERSION;

use super::content::{Content, platform};
use super::{LOCK, MAX_BUNDLE_BYTES, SIGNATURE, unpack, unsound};
use crate::installation::Installation;
use crate::lock::{SecretKey, sha256_hex};
use crate::manifest::{Finding, SkillManifest, bytes_of, is_snake_case};
use crate::plugin::{PluginError, PluginLibrary, library_file_name};
use crate::staging::failed;

/// A bundle that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packed {
    /// The bundle.
    pub file: PathBuf,
    /// Its size.
    pub bytes: usize,
    /// What is in it, with hashes, by path below an installation's root.
    pub files: BTreeMap<String, String>,
}

/// Packs a sound skill into `file`, its lock signed by `key` where one is given. The same skill gives
/// the same bytes.
///
/// # Errors
/// The skill is not sound on any robot of the installation, is too large, or a file cannot be read or
/// written.
pub fn pack(
    installation: &Installation,
    name: &str,
    file: &Path,
    key: Option<&SecretKey>,
) -> Result<Packed, Finding> {
    let root = &installation.root;
    let files = files_of(installation, name).map_err(|finding| finding.relative_to(root))?;
    unsound(installation, name, installation)?;
    let content = Content {
        schema: 1,
        skill: name.to_owned(),
        platform: platform(),
        interface: INTERFACE_VERSION,
        files: files.iter().map(|(path, bytes)| (path.clone(), sha256_hex(bytes))).collect(),
    };
    let text = toml::to_string(&content)
        .map_err(|error| Finding::new(file, LOCK, error, "a lock that can be written out"))?;
    let signature = key.map(|key| key.sign(text.as_bytes()).to_string());
    let bytes = archive(&text, signature.as_deref(), &files).map_err(failed(file, "archive"))?;
    if bytes.len() as u64 > MAX_BUNDLE_BYTES {
        let wanted = format!("at most {MAX_BUNDLE_BYTES} bytes");
        return Err(Finding::new(file, "file", format!("{} bytes", bytes.len()), wanted));
    }
    // What nobody could install is not written.
    unpack(file, &bytes)?;
    crate::lock::replace(file, &bytes).map_err(failed(file, "write"))?;
    Ok(Packed { file: file.to_owned(), bytes: bytes.len(), files: content.files })
}

/// The skill's files by their path below a root.
fn files_of(installation: &Installation, name: &str) -> Result<BTreeMap<String, Vec<u8>>, Finding> {
    let manifest_file = installation.skill_file(name);
    if !is_snake_case(name) {
        return Err(Finding::new(
            &manifest_file,
            "name",
            format!("{name:?}"),
            "a skill's name in snake_case",
        ));
    }
    let manifest = SkillManifest::read(&manifest_file)?;
    let folder = installation.skill_folder(name);
    let library = PluginLibrary::find(&installation.plugin_path_of(name), &manifest.plugin)
        .map_err(PluginError::into_finding)?;
    let models = &manifest.models;
    let named =
        [models.policy.as_ref(), models.parameters.as_ref(), Some(&models.viability), Some(&models.cot)];
    let card = PathBuf::from("CARD.md");
    let card = Some(&card).filter(|card| folder.join(card).is_file());
    let mut places = vec![
        (format!("manifests/skills/{name}.toml"), manifest_file.clone()),
        (format!("skills/{name}/{}", library_file_name(&manifest.plugin)), library),
    ];
    for path in named.into_iter().chain([card]).flatten() {
        let parts: Vec<_> = path.iter().map(|part| part.to_string_lossy()).collect();
        places.push((format!("skills/{name}/{}", parts.join("/")), folder.join(path)));
    }
    let mut files = BTreeMap::new();
    for (place, path) in places {
        let bytes = bytes_of(&path, MAX_BUNDLE_BYTES)
            .map_err(|found| Finding::new(&path, "file", found, "a readable file"))?;
        files.insert(place, bytes);
    }
    Ok(files)
}

/// The tar in gzip, with no name, time or owner in it.
fn archive(
    lock: &str,
    signature: Option<&str>,
    files: &BTreeMap<String, Vec<u8>>,
) -> std::io::Result<Vec<u8>> {
    let mut tar = tar::Builder::new(GzBuilder::new().mtime(0).write(Vec::new(), Compression::default()));
    let mut add = |path: &str, bytes: &[u8]| {
        let mut header = tar::Header::new_ustar();
        header.set_entry_type(tar::EntryType::Regular);
        header.set_size(bytes.len() as u64);
        header.set_mode(0o644);
        header.set_mtime(0);
        tar.append_data(&mut header, path, bytes)
    };
    add(LOCK, lock.as_bytes())?;
    if let Some(signature) = signature {
        add(SIGNATURE, signature.as_bytes())?;
    }
    for (path, bytes) in files {
        add(path, bytes)?;
    }
    let mut bytes = tar.into_inner()?.finish()?;
    bytes.flush()?;
    Ok(bytes)
}
