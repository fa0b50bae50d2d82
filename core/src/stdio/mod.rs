//! `run --source stdio`: one JSON object a line, in and out, a tick each, so that any simulator or
//! robot bridge can drive the loop.
//!
//! Reads and writes whatever streams it is given. A line that cannot be used gets an error line with
//! the stand's joints, and the loop goes on.

mod input;
mod output;
#[cfg(test)]
mod tests;

use std::io::{self, BufRead, ErrorKind, Write};
use std::ops::ControlFlow;

pub use input::parse;
pub use output::{Greeting, TickLine};

use crate::decision::Decision;
use crate::observation::ObservationFault;
use crate::runtime::{Runtime, TickSummary, TickTimes};
use output::ErrorLine;

/// Longest line that is read, bytes: an elevation of 4 m by 2 m at 2 cm has about 200 kB.
pub const MAX_LINE_BYTES: usize = 4 << 20;

/// What a session came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Served {
    /// Lines answered.
    pub lines: u64,
    /// Those of them that could not be used.
    pub errors: u64,
    /// Whether `seen` gave up before the end.
    pub unseen: bool,
    /// Whether whoever reads the answers went away before the lines ended.
    pub unheard: bool,
    /// From a line's last byte until the loop is free for the next; of none where nothing measures ticks.
    pub times: TickSummary,
}

/// Answers every line of `reader` until it ends: the greeting first, then one line out per line in.
///
/// `seen` gets every decision, error lines' included, once it is answered. When it breaks off it is
/// not called again, and the loop goes on: a full disk must not leave a robot without targets. When nobody reads the
/// answers any more, that is the end too.
///
/// # Errors
/// When a stream fails; a malformed line is no such error.
pub fn serve(
    runtime: &mut Runtime,
    greeting: &Greeting,
    mut reader: impl BufRead,
    mut writer: impl Write,
    mut seen: impl FnMut(&Decision) -> ControlFlow<()>,
) -> io::Result<Served> {
    let robot = std::sync::Arc::clone(runtime.robot());
    let mut times = TickTimes::new(runtime.config().rate_hz);
    let mut served = Served { lines: 0, errors: 0, unseen: false, unheard: false, times: times.summary() };
    let mut line = Vec::new();
    let mut is_heard = heard(send(&mut writer, greeting))?;
    while is_heard && let Some(read) = read_line(&mut reader, &mut line)? {
        let began = runtime.now();
        let tick = match read.and_then(|()| parse(&line, &robot.description)) {
            Ok(observation) => runtime.tick(&observation),
            Err(fault) => runtime.fault_tick(&fault),
        };
        served.errors += u64::from(tick.fault.is_some());
        is_heard = heard(match &tick.fault {
            Some(fault) => send(&mut writer, &ErrorLine::of(&robot.description, fault, &tick)),
            None => send(&mut writer, &TickLine::of(&robot.description, &tick)),
        })?;
        served.lines += u64::from(is_heard);
        served.unseen = served.unseen || seen(tick.decision).is_break();
        if let Some((began, ended)) = began.zip(runtime.now()) {
            times.add(ended.saturating_sub(began));
        }
    }
    Ok(Served { unheard: !is_heard, times: times.summary(), ..served })
}

/// Whether somebody took what was sent.
fn heard(sent: io::Result<()>) -> io::Result<bool> {
    match sent {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
        sent => sent.map(|()| true),
    }
}

fn send(writer: &mut impl Write, line: &impl serde::Serialize) -> io::Result<()> {
    serde_json::to_writer(&mut *writer, line)?;
    writer.write_all(b"\n")?;
    writer.flush()
}

/// The next line without its end, `None` at the end of the stream or where that breaks off. A line that is too long is
/// skipped to its end and reported.
fn read_line(
    reader: &mut impl BufRead,
    line: &mut Vec<u8>,
) -> io::Result<Option<Result<(), ObservationFault>>> {
    line.clear();
    let mut length = 0_usize;
    loop {
        let available = match reader.fill_buf() {
            // The reader was asked to end: what it has of a line is none.
            Err(error) if error.kind() == ErrorKind::ConnectionAborted => return Ok(None),
            available => available?,
        };
        if available.is_empty() && length == 0 {
            return Ok(None);
        }
        let end = available.iter().position(|&byte| byte == b'\n');
        let taken = end.unwrap_or(available.len());
        let fits = taken.min(MAX_LINE_BYTES.saturating_sub(line.len()));
        line.extend_from_slice(&available[..fits]);
        length += taken;
        let ended = end.is_some() || available.is_empty();
        let consumed = taken + usize::from(end.is_some());
        reader.consume(consumed);
        if ended {
            break;
        }
    }
    if length > MAX_LINE_BYTES {
        let wanted = format!("at most {MAX_LINE_BYTES} bytes");
        return Ok(Some(Err(ObservationFault::new("line", format!("{length} bytes"), wanted))));
    }
    Ok(Some(Ok(())))
}
