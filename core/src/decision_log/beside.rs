//! A log that is written beside the loop: a disk that stalls holds up no tick.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;

use super::{LogError, LogWriter};
use crate::decision::Decision;
use crate::runtime::give_way;

/// Decisions that may wait for the disk: ten seconds at 50 Hz, some 50 MB at most.
const WAITING: usize = 500;

/// A [`LogWriter`] on a thread of its own, which gives way to the loop.
///
/// Dropped, it goes on writing what waits for as long as the process lasts; [`finish`](Self::finish) waits for that.
#[derive(Debug)]
pub struct LogBeside {
    file: PathBuf,
    decisions: Option<SyncSender<Decision>>,
    writer: Option<JoinHandle<Result<(), LogError>>>,
    waits: bool,
}

impl LogBeside {
    /// Starts the thread. With `waits` the loop waits for a disk that does not keep up, where time is not of the essence;
    /// without, such a log ends.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn start(log: LogWriter, waits: bool) -> Result<Self, LogError> {
        let (decisions, received) = sync_channel(WAITING);
        let file = log.file.clone();
        let write = move || {
            give_way();
            write_all(log, &received)
        };
        let writer = std::thread::Builder::new()
            .name("log".to_owned())
            .spawn(write)
            .map_err(|source| LogError::Io { file: file.clone(), source })?;
        Ok(Self { file, decisions: Some(decisions), writer: Some(writer), waits })
    }

    /// Hands one tick over; after an error the log ends with what was handed over before.
    ///
    /// # Errors
    /// An earlier tick could not be written, or too many wait to be.
    pub fn write(&mut self, decision: &Decision) -> Result<(), LogError> {
        let Some(decisions) = &self.decisions else { return Ok(()) };
        let sent = if self.waits {
            decisions.send(decision.clone()).map_err(|error| TrySendError::Disconnected(error.0))
        } else {
            decisions.try_send(decision.clone())
        };
        match sent {
            Ok(()) => Ok(()),
            Err(TrySendError::Full(_)) => {
                self.decisions = None;
                Err(LogError::Behind { file: self.file.clone(), ticks: WAITING })
            }
            // The thread has ended: it will not be waited for long.
            Err(TrySendError::Disconnected(_)) => self.end(),
        }
    }

    /// Waits until all is written, and the index and the file's end with it.
    ///
    /// # Errors
    /// When the system does not take it, unless [`write`](Self::write) has said so.
    pub fn finish(mut self) -> Result<(), LogError> {
        self.end()
    }

    fn end(&mut self) -> Result<(), LogError> {
        self.decisions = None;
        let Some(writer) = self.writer.take() else { return Ok(()) };
        writer.join().unwrap_or_else(|_| {
            let source = std::io::Error::other("the thread that writes it panicked");
            Err(LogError::Io { file: self.file.clone(), source })
        })
    }
}

fn write_all(mut log: LogWriter, received: &Receiver<Decision>) -> Result<(), LogError> {
    for decision in received {
        log.write(&decision)?;
    }
    log.finish()
}
