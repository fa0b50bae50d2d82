//! The one door to stdout: results only, and a reader that hangs up is an error, never a panic.

use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::process::Stdio;
use std::sync::OnceLock;

/// Stdout as this program was given it, once it keeps it for itself.
static OWN: OnceLock<File> = OnceLock::new();

/// Keeps stdout for results: what else in this process prints there, a plugin or a library, goes to stderr from now on,
/// not between two lines of a result.
///
/// # Errors
/// The system gives no other descriptor for it.
#[cfg(unix)]
pub(crate) fn keep_for_results() -> io::Result<()> {
    use std::os::fd::AsFd;
    let own = io::stdout().as_fd().try_clone_to_owned()?;
    rustix::stdio::dup2_stdout(io::stderr())?;
    let _ = OWN.set(own.into());
    Ok(())
}

/// Elsewhere stdout is everyone's.
///
/// # Errors
/// Never.
#[cfg(not(unix))]
pub(crate) fn keep_for_results() -> io::Result<()> {
    Ok(())
}

/// Stdout, for lines that are flushed one by one.
pub(crate) fn results() -> Box<dyn Write> {
    match OWN.get() {
        Some(own) => Box::new(io::BufWriter::with_capacity(64 << 10, own)),
        None => Box::new(io::stdout().lock()),
    }
}

/// Stdout for another program whose results are this one's.
///
/// # Errors
/// The system gives no other descriptor for it.
pub(crate) fn handed_on() -> io::Result<Stdio> {
    OWN.get().map_or_else(|| Ok(Stdio::inherit()), |own| own.try_clone().map(Stdio::from))
}

/// Says a line to people. A stderr that takes nothing, a full disk's or one that nobody reads, ends nothing else.
pub(crate) fn narrate(line: impl std::fmt::Display) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// Writes one line of result.
///
/// # Errors
/// When stdout does not take it; `main` treats a closed pipe as a quiet end.
pub(crate) fn line(text: &str) -> io::Result<()> {
    let mut stdout = results();
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
