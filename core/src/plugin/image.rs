//! Loads a library from bytes in memory, so that nobody can swap the file between hash and `dlopen`.
#![allow(unsafe_code, reason = "loading a library runs its initialisers")]

use std::io::Write;

use libloading::Library;

/// Loads the library whose file holds `bytes`, for good.
///
/// On Linux from an anonymous file, elsewhere from a file in a folder of this user alone.
pub(super) fn load(bytes: &[u8]) -> Result<&'static Library, String> {
    let (path, keep) = place(bytes).map_err(|error| error.to_string())?;
    // SAFETY: the file is whole (checked before) and holds a plugin that the installation's owner
    // put on the plugin path: its initialisers are trusted as its code is.
    let library = unsafe { Library::new(&path) }.map_err(|error| cause(&error, &path))?;
    // The loader knows libraries by path and the path holds the descriptor's number: closing it would
    // let the next plugin take the number and get this library instead.
    std::mem::forget(keep);
    Ok(Box::leak(Box::new(library)))
}

/// The loader's own words, less the path that means nothing to people.
fn cause(error: &libloading::Error, path: &std::path::Path) -> String {
    let text = std::error::Error::source(error).map_or_else(|| error.to_string(), ToString::to_string);
    text.replace(&format!("{}: ", path.display()), "")
}

#[cfg(target_os = "linux")]
fn place(bytes: &[u8]) -> std::io::Result<(std::path::PathBuf, std::fs::File)> {
    use std::os::fd::AsRawFd;

    let descriptor = rustix::fs::memfd_create("vocaloco-plugin", rustix::fs::MemfdFlags::CLOEXEC)?;
    let mut file = std::fs::File::from(descriptor);
    file.write_all(bytes)?;
    Ok((format!("/proc/self/fd/{}", file.as_raw_fd()).into(), file))
}

#[cfg(not(target_os = "linux"))]
fn place(bytes: &[u8]) -> std::io::Result<(std::path::PathBuf, tempfile::TempDir)> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join(super::library_file_name("plugin"));
    std::fs::File::create_new(&path)?.write_all(bytes)?;
    Ok((path, folder))
}
