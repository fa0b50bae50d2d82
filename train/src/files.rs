//! Files that are there whole or not at all.

use std::io::Write;
use std::path::Path;

use anyhow::Context;

/// Writes a file whole or not at all.
///
/// # Errors
/// The folder does not take it.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let context = || format!("{}: cannot be written", path.display());
    let folder = path.parent().with_context(context)?;
    std::fs::create_dir_all(folder).with_context(context)?;
    let mut name = path.file_name().with_context(context)?.to_owned();
    name.push(".part");
    let part = folder.join(name);
    let mut file = std::fs::File::create(&part).with_context(context)?;
    file.write_all(bytes).and_then(|()| file.sync_all()).with_context(context)?;
    std::fs::rename(&part, path).with_context(context)
}
