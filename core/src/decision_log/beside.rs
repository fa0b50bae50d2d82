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
        let file = log.file.clone();
        Self::start_with(file, waits, move |received| write_all(log, received))
    }

    /// Starts the thread with `write` for what it does.
    fn start_with(
        file: PathBuf,
        waits: bool,
        write: impl FnOnce(&Receiver<Decision>) -> Result<(), LogError> + Send + 'static,
    ) -> Result<Self, LogError> {
        let (decisions, received) = sync_channel(WAITING);
        let write = move || {
            give_way();
            write(&received)
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

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::mpsc::{Sender, channel};
    use std::time::Duration;

    use super::*;
    use crate::decision_log::{DecisionLog, Setup};
    use crate::runtime::fixture::{Loop, fake, skill};

    /// Longer than a thread waits for its turn, on a machine that is busy.
    const LONG: Duration = Duration::from_secs(30);

    /// More decisions than may wait, and a log whose disk stalls until the sender is dropped.
    fn stalled(file: &Path, waits: bool) -> (Vec<Decision>, LogBeside, Sender<()>) {
        let mut it = Loop::new(vec![skill("walk", &fake(0.99, 0.2))]);
        let log = LogWriter::create(file, &Setup::of(&it.runtime, "test")).unwrap();
        let decisions = (0..WAITING + 100).map(|_| it.tick()).collect();
        let (disk, stalls) = channel::<()>();
        let write = move |received: &Receiver<Decision>| {
            let _ = stalls.recv();
            write_all(log, received)
        };
        (decisions, LogBeside::start_with(file.to_owned(), waits, write).unwrap(), disk)
    }

    /// What comes of handing all of them over, one after the other, and of the end; from a thread of its own, so that a
    /// caller that is held up fails a test instead of hanging it.
    fn handed_over(mut log: LogBeside, decisions: Vec<Decision>) -> Receiver<Result<(), LogError>> {
        let (says, said) = channel();
        std::thread::spawn(move || {
            for decision in &decisions {
                drop(says.send(log.write(decision)));
            }
            drop(says.send(log.finish()));
        });
        said
    }

    #[test]
    fn in_real_time_a_disk_that_stalls_ends_the_log_and_holds_nobody_up() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("decisions.mcap");
        let (decisions, log, disk) = stalled(&file, false);
        let said = handed_over(log, decisions.clone());
        let next = |what: &str| said.recv_timeout(LONG).expect(what);
        for decision in &decisions[..WAITING] {
            next("no tick is held up").unwrap_or_else(|error| panic!("tick {}: {error}", decision.tick));
        }
        let error = next("nor the one that is too many").unwrap_err();
        assert!(matches!(error, LogError::Behind { ticks: WAITING, .. }), "{error}");
        for decision in &decisions[WAITING + 1..] {
            next("nor those after it").unwrap_or_else(|error| panic!("tick {}: {error}", decision.tick));
        }
        drop(disk);
        next("the disk is back").unwrap();
        let read = DecisionLog::read(&file).unwrap();
        assert_eq!(read.truncated, None);
        assert!(read.decisions == decisions[..WAITING], "{} ticks", read.decisions.len());
    }

    #[test]
    fn where_time_is_not_of_the_essence_a_disk_that_stalls_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("decisions.mcap");
        let (decisions, log, disk) = stalled(&file, true);
        let said = handed_over(log, decisions.clone());
        for decision in &decisions[..WAITING] {
            let taken = said.recv_timeout(LONG).expect("there is room");
            taken.unwrap_or_else(|error| panic!("tick {}: {error}", decision.tick));
        }
        let more = said.recv_timeout(Duration::from_millis(200));
        assert!(more.is_err(), "one more waits for the disk: {more:?}");
        drop(disk);
        for _ in WAITING..=decisions.len() {
            said.recv_timeout(LONG).expect("the disk is back").unwrap();
        }
        let read = DecisionLog::read(&file).unwrap();
        assert!(read.decisions == decisions, "{} ticks", read.decisions.len());
    }
}
