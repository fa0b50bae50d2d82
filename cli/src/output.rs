//! The one door to stdout: results only, and a reader that hangs up is an error, never a panic.

use std::io::{self, ErrorKind, Write};

/// Writes one line of result.
///
/// # Errors
/// When stdout does not take it; `main` treats a closed pipe as a quiet end.
pub(crate) fn line(text: &str) -> io::Result<()> {
    let mut stdout = io::stdout().lock();
    stdout.write_all(text.as_bytes())?;
    stdout.write_all(b"\n")?;
    stdout.flush()
}

/// Writes one JSON object, indented, for machines and people alike.
///
/// # Errors
/// As [`line()`], or when `value` does not serialise.
pub(crate) fn json(value: &impl serde::Serialize) -> io::Result<()> {
    line(&serde_json::to_string_pretty(value)?)
}

/// Whether somewhere in the chain stdout's reader has gone (`vocaloco … | head -1`).
pub(crate) fn reader_is_gone(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|cause| cause.kind() == ErrorKind::BrokenPipe)
}
