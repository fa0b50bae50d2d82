//! A folder beside an installation's own, laid out like it, in which a skill is written and tried before it
//! appears: whole, or not at all.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::installation::Installation;
use crate::manifest::Finding;

/// What stages are called; nothing else in an installation begins so.
const PREFIX: &str = ".staging-";

/// The folder; it vanishes with what is left in it. One whose process was killed goes when the next is made.
#[derive(Debug)]
pub struct Stage {
    installation: Installation,
    _folder: tempfile::TempDir,
    /// Locked for as long as the stage is in use.
    _in_use: Option<fs::File>,
}

/// Where a skill lies.
pub(crate) struct Places {
    pub(crate) manifest: PathBuf,
    pub(crate) folder: PathBuf,
}

impl Places {
    pub(crate) fn of(installation: &Installation, skill: &str) -> Self {
        Self { manifest: installation.skill_file(skill), folder: installation.skill_folder(skill) }
    }
}

/// What has the name `skill` in this installation, relative to its root: a manifest, a folder, or a link.
pub fn taken(installation: &Installation, skill: &str) -> Option<PathBuf> {
    let Places { manifest, folder } = Places::of(installation, skill);
    let taken = [manifest, folder].into_iter().find(|place| fs::symlink_metadata(place).is_ok())?;
    Some(taken.strip_prefix(&installation.root).unwrap_or(&taken).to_owned())
}

impl Stage {
    /// An empty stage in the folder `root`, whose skills find their plugins in their own folders and on
    /// `plugin_path`.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn new(root: &Path, plugin_path: Vec<PathBuf>) -> Result<Self, Finding> {
        sweep(root);
        let folder = tempfile::Builder::new().prefix(PREFIX).tempdir_in(root);
        let folder = folder.map_err(failed(root, "staging"))?;
        let in_use = unused(folder.path());
        for part in ["manifests/skills", "skills"] {
            fs::create_dir_all(folder.path().join(part)).map_err(failed(root, "staging"))?;
        }
        let installation = Installation { root: folder.path().to_owned(), plugin_path };
        Ok(Self { installation, _folder: folder, _in_use: in_use })
    }

    /// What is staged, as an installation of its own.
    pub fn installation(&self) -> &Installation {
        &self.installation
    }

    /// Writes a new file, with the folders it needs; `path` is relative to a root.
    ///
    /// # Errors
    /// It is there, or cannot be written.
    pub fn file(&self, path: &str, bytes: &[u8]) -> Result<(), Finding> {
        let path = self.installation.root.join(path);
        let write = || {
            fs::create_dir_all(path.parent().unwrap_or(&self.installation.root))?;
            let mut file = fs::File::create_new(&path)?;
            file.write_all(bytes)?;
            file.sync_all()
        };
        write().map_err(failed(&path, "write"))
    }

    /// Lets the staged skill appear in `installation`: its folder first, its manifest last.
    ///
    /// # Errors
    /// One of them is there, or the system does not rename; the installation is then as it was.
    pub fn publish(&self, installation: &Installation, skill: &str) -> Result<(), Finding> {
        let (places, staged) = (Places::of(installation, skill), Places::of(&self.installation, skill));
        for folder in [places.folder.parent(), places.manifest.parent()].into_iter().flatten() {
            fs::create_dir_all(folder).map_err(failed(folder, "folder"))?;
        }
        rename_new(&staged.folder, &places.folder).map_err(failed(&places.folder, "rename"))?;
        if let Err(error) = rename_new(&staged.manifest, &places.manifest) {
            let back = fs::rename(&places.folder, &staged.folder);
            back.map_err(failed(&places.folder, "rename"))?;
            return Err(failed(&places.manifest, "rename")(error));
        }
        Ok(())
    }
}

/// Removes stages that nobody uses; what cannot be removed stays.
fn sweep(root: &Path) {
    for entry in fs::read_dir(root).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(PREFIX) && unused(&entry.path()).is_some() {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

/// The lock of a stage, unless another process or stage has it. Folders are locked on Unix alone.
fn unused(stage: &Path) -> Option<fs::File> {
    fs::File::open(stage).ok().filter(|folder| folder.try_lock().is_ok())
}

/// What a system that is called for a skill's files does not do.
pub(crate) fn failed(path: &Path, what: &str) -> impl Fn(io::Error) -> Finding {
    move |error| Finding::new(path, what, error, "a system that does it")
}

/// Renames, refusing to replace anything.
#[cfg(target_os = "linux")]
fn rename_new(from: &Path, to: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE)?)
}

/// Renames, refusing to replace anything that is there when it looks.
#[cfg(not(target_os = "linux"))]
fn rename_new(from: &Path, to: &Path) -> io::Result<()> {
    if fs::symlink_metadata(to).is_ok() {
        return Err(io::ErrorKind::AlreadyExists.into());
    }
    fs::rename(from, to)
}
