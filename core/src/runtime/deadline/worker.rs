//! A thread that runs one kind of job, and a caller who waits no longer than it wants to.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::runtime::background::Beside;

/// Whose turn it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    /// The caller may fill in the job.
    Caller,
    /// The job is filled in; the thread has not taken it yet.
    Asked,
    /// The thread runs it.
    Runs,
    /// The job holds the answer.
    Answered,
}

struct Slot<J> {
    turn: Turn,
    /// With the thread while it runs.
    job: Option<Box<J>>,
    is_abandoned: bool,
}

struct Shared<J> {
    slot: Mutex<Slot<J>>,
    changed: Condvar,
    /// The thread.
    beside: Beside,
}

impl<J> Shared<J> {
    fn lock(&self) -> MutexGuard<'_, Slot<J>> {
        // Jobs run outside the lock: it is never poisoned half-way through a change.
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A thread that runs jobs of one kind, one at a time, in memory that both sides share.
///
/// Dropped while a job runs, it abandons the thread: that ends when, and if, the job does, and what
/// the job holds goes with it.
pub(super) struct Worker<J: Send + 'static> {
    shared: Arc<Shared<J>>,
}

/// The job was not done within its budget.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TooLate;

impl<J: Send + 'static> Worker<J> {
    /// Starts the thread. `run` does a job; what a panic in it says is handed to `panicked`.
    pub(super) fn start(
        name: String,
        job: J,
        mut run: impl FnMut(&mut J) + Send + 'static,
        panicked: fn(&mut J, &str),
    ) -> std::io::Result<Self> {
        let slot = Slot { turn: Turn::Caller, job: Some(Box::new(job)), is_abandoned: false };
        let shared =
            Arc::new(Shared { slot: Mutex::new(slot), changed: Condvar::new(), beside: Beside::default() });
        let theirs = Arc::clone(&shared);
        std::thread::Builder::new().name(name).spawn(move || {
            theirs.beside.follow_here();
            while let Some(mut job) = next(&theirs) {
                if let Err(panic) = catch_unwind(AssertUnwindSafe(|| run(&mut job))) {
                    panicked(&mut job, words(&*panic));
                }
                // Before the lock, which nothing slow must hold, and under it, since until then the job can be found late.
                theirs.beside.come_back();
                let mut slot = theirs.lock();
                theirs.beside.come_back();
                slot.job = Some(job);
                slot.turn = Turn::Answered;
                theirs.changed.notify_all();
            }
        })?;
        Ok(Self { shared })
    }

    /// Fills in a job, waits for it for at most `budget`, and reads the answer.
    ///
    /// While an earlier job still hangs nothing is asked and nothing waited for; its late answer is
    /// thrown away.
    pub(super) fn ask<A>(
        &mut self,
        budget: Duration,
        fill: impl FnOnce(&mut J),
        read: impl FnOnce(&J) -> A,
    ) -> Result<A, TooLate> {
        let mut slot = self.shared.lock();
        let (Turn::Caller | Turn::Answered, Some(job)) = (slot.turn, slot.job.as_mut()) else {
            self.shared.beside.give_way();
            return Err(TooLate);
        };
        fill(job);
        slot.turn = Turn::Asked;
        self.shared.changed.notify_all();
        let waits = |slot: &mut Slot<J>| slot.turn != Turn::Answered;
        let waited = self.shared.changed.wait_timeout_while(slot, budget, waits);
        let (mut slot, _) = waited.unwrap_or_else(PoisonError::into_inner);
        if slot.turn != Turn::Answered {
            self.shared.beside.give_way();
            return Err(TooLate);
        }
        slot.turn = Turn::Caller;
        slot.job.as_deref().map(read).ok_or(TooLate)
    }
}

/// The next job; none when nobody will ask again.
fn next<J>(shared: &Shared<J>) -> Option<Box<J>> {
    let waits = |slot: &mut Slot<J>| slot.turn != Turn::Asked && !slot.is_abandoned;
    let waited = shared.changed.wait_while(shared.lock(), waits);
    let mut slot = waited.unwrap_or_else(PoisonError::into_inner);
    if slot.is_abandoned {
        return None;
    }
    slot.turn = Turn::Runs;
    slot.job.take()
}

fn words(panic: &(dyn std::any::Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message")
}

impl<J: Send + 'static> Drop for Worker<J> {
    fn drop(&mut self) {
        self.shared.lock().is_abandoned = true;
        self.shared.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    const SOON: Duration = Duration::from_secs(20);
    const NOW: Duration = Duration::from_millis(5);

    /// Adds one, once it is let: a message for every job that may end.
    fn worker() -> (Worker<(u32, String)>, mpsc::Sender<()>) {
        let (may_end, ends) = mpsc::channel();
        let run = move |job: &mut (u32, String)| {
            ends.recv().unwrap();
            assert_ne!(job.0, 13, "out of luck");
            job.0 += 1;
        };
        let panicked = |job: &mut (u32, String), words: &str| words.clone_into(&mut job.1);
        (Worker::start("test".into(), (0, String::new()), run, panicked).unwrap(), may_end)
    }

    #[test]
    fn a_job_in_time_is_answered() {
        let (mut worker, may_end) = worker();
        may_end.send(()).unwrap();
        assert_eq!(worker.ask(SOON, |job| job.0 = 4, |job| job.0), Ok(5));
    }

    #[test]
    fn a_hanging_job_is_noticed_within_its_budget_and_its_late_answer_is_thrown_away() {
        let (mut worker, may_end) = worker();
        assert_eq!(worker.ask(NOW, |job| job.0 = 4, |job| job.0), Err(TooLate));
        // It hangs still: nothing is asked, and the budget is not waited for.
        assert_eq!(worker.ask(SOON, |_| unreachable!(), |job| job.0), Err(TooLate));
        may_end.send(()).unwrap();
        may_end.send(()).unwrap();
        let later = (0..2000).find_map(|_| {
            std::thread::sleep(Duration::from_millis(1));
            worker.ask(SOON, |job| job.0 = 20, |job| job.0).ok()
        });
        assert_eq!(later, Some(21), "never 5");
    }

    #[test]
    fn a_panic_is_an_answer() {
        let (mut worker, may_end) = worker();
        may_end.send(()).unwrap();
        let words = worker.ask(SOON, |job| job.0 = 13, |job| job.1.clone()).unwrap();
        assert!(words.contains("out of luck"), "{words}");
    }

    #[test]
    fn an_abandoned_thread_ends_with_its_job() {
        let (mut worker, may_end) = worker();
        assert_eq!(worker.ask(NOW, |job| job.0 = 4, |job| job.0), Err(TooLate));
        drop(worker);
        may_end.send(()).unwrap();
        // The thread's end of the channel is gone once the thread is.
        let ended = (0..20_000).any(|_| {
            std::thread::sleep(Duration::from_millis(1));
            may_end.send(()).is_err()
        });
        assert!(ended);
    }
}
