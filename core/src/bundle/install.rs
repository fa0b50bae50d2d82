//! A bundle into an installation, and out of it again: staged, tried, then renamed into place.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::content::Content;
use super::{Bundle, LOCK, MAX_BUNDLE_BYTES, SIGNATURE, unpack, unsound};
use crate::installation::Installation;
use crate::lock::PublicKey;
use crate::manifest::{Finding, MAX_BYTES, bytes_of, is_snake_case, read_bounded};
use crate::staging::{Places, Stage, failed, taken};

/// A skill that was installed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Installed {
    /// Name of the skill.
    pub skill: String,
    /// Number of files of the bundle.
    pub files: usize,
    /// Whether the bundle carries a signature.
    pub signed: bool,
}

/// Installs the bundle `file`, which one of `keys` must have signed when there are any.
///
/// The skill appears whole or not at all.
///
/// # Errors
/// The bundle is refused, its name is taken, the skill is not sound on any robot of the installation,
/// or a file cannot be written. The installation is then as it was.
pub fn install(installation: &Installation, file: &Path, keys: &[PublicKey]) -> Result<Installed, Finding> {
    let bytes = bytes_of(file, MAX_BUNDLE_BYTES).map_err(|found| {
        Finding::new(file, "file", found, format!("a readable bundle of at most {MAX_BUNDLE_BYTES} bytes"))
    })?;
    let bundle = unpack(file, &bytes)?;
    bundle.check_signature(file, keys)?;
    let skill = bundle.skill();
    if let Some(taken) = taken(installation, skill) {
        let found = format!("{skill:?}, taken by {}", taken.display());
        return Err(Finding::new(file, "skill", found, "a name that is not taken (`skills remove`)"));
    }
    // It shall run where nothing else brings its plugin.
    let stage = Stage::new(&installation.root, Vec::new())?;
    write(&stage, &bundle)?;
    // Its plugin's initialisers run here for the first time: after the hashes and the signature.
    unsound(stage.installation(), skill, installation)?;
    stage.publish(installation, skill)?;
    Ok(Installed { skill: skill.to_owned(), files: bundle.files.len(), signed: bundle.signature.is_some() })
}

/// Removes a skill that a bundle has brought, and nothing that it has not.
///
/// # Errors
/// There is no such skill, it is not from a bundle, or its folder holds other files besides.
pub fn remove(installation: &Installation, skill: &str) -> Result<(), Finding> {
    let relative = |finding: Finding| finding.relative_to(&installation.root);
    let places = Places::of(installation, skill);
    if !is_snake_case(skill) {
        let found = format!("{skill:?}");
        return Err(Finding::new(&places.manifest, "skill", found, "a skill's name in snake_case"));
    }
    let lock = places.folder.join(LOCK);
    let text = read_bounded(&lock, MAX_BYTES, &lock, "file").map_err(|finding| {
        relative(Finding {
            wanted: "the lock of a skill that `skills install` has brought".into(),
            ..finding
        })
    })?;
    let content = Content::parse(&lock, &text).map_err(relative)?;
    if content.skill != skill {
        let found = format!("{:?}", content.skill);
        return Err(relative(Finding::new(&lock, "skill", found, format!("{skill:?}"))));
    }
    for found in files_in(&places.folder).map_err(failed(&places.folder, "folder"))? {
        let inside = found.strip_prefix(&installation.root).unwrap_or(&found);
        let parts: Vec<_> = inside.iter().map(|part| part.to_string_lossy()).collect();
        let is_its_lock = [LOCK, SIGNATURE].iter().any(|name| found == places.folder.join(name));
        if !is_its_lock && !content.files.contains_key(&parts.join("/")) {
            let wanted = "nothing but what its bundle has brought";
            return Err(Finding::new(&places.folder, "folder", inside.display(), wanted)
                .relative_to(&installation.root));
        }
    }
    let stage = Stage::new(&installation.root, Vec::new())?;
    let staged = Places::of(stage.installation(), skill);
    // Without its manifest there is no such skill: that goes first.
    let taken = match fs::rename(&places.manifest, &staged.manifest) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => false,
        renamed => renamed.map(|()| true).map_err(failed(&places.manifest, "rename"))?,
    };
    fs::rename(&places.folder, &staged.folder).map_err(|error| {
        if taken {
            // What cannot be removed whole stays whole.
            let _ = fs::rename(&staged.manifest, &places.manifest);
        }
        failed(&places.folder, "rename")(error)
    })
}

fn write(stage: &Stage, bundle: &Bundle) -> Result<(), Finding> {
    let folder = format!("skills/{}", bundle.skill());
    stage.file(&format!("{folder}/{LOCK}"), bundle.lock.as_bytes())?;
    if let Some((text, _)) = &bundle.signature {
        stage.file(&format!("{folder}/{SIGNATURE}"), text.as_bytes())?;
    }
    bundle.files.iter().try_for_each(|(path, bytes)| stage.file(path, bytes))
}

/// Every file below a folder; links are files.
fn files_in(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder)? {
            let entry = entry?;
            if entry.file_type()?.is_dir() { folders.push(entry.path()) } else { files.push(entry.path()) }
        }
    }
    files.sort();
    Ok(files)
}
