//! How many threads work on rows. Results never depend on it.

use thiserror::Error;

/// The threads would not start.
#[derive(Debug, Error)]
#[error("threads: {0} could not be started: {1}")]
pub struct NoThreads(usize, String);

/// Runs `work` on a pool of its own; 0 threads are as many as there are processors.
///
/// # Errors
/// The threads would not start.
pub fn with_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> Result<R, NoThreads> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    Ok(pool.map_err(|error| NoThreads(threads, error.to_string()))?.install(work))
}
