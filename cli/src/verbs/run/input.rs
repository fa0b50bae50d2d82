//! Standard input, until it ends or this process is asked to end.

use std::io::{self, BufRead};

/// What `run --source stdio` reads: SIGINT, SIGTERM and SIGHUP end it as the other side's hanging up does, before the next
/// line. A second SIGINT or SIGTERM ends the process as it would without this, for a plugin that never returns; SIGHUP
/// comes more than once, and another signal after it, when a terminal goes. What this process was started to ignore it
/// ignores, as under `nohup`; asked for on Linux alone.
///
/// # Errors
/// Standard input cannot be read, or the system watches no signals.
#[cfg(unix)]
pub(super) fn until_asked_to_end() -> io::Result<impl BufRead> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    use signal_hook::flag;
    use signal_hook::low_level::pipe;
    use std::fs::File;
    use std::os::fd::AsFd;
    use std::os::unix::net::UnixStream;
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;

    let is_asked = Arc::new(AtomicBool::new(false));
    let (asked, asks) = UnixStream::pair()?;
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        if is_ignored(signal) {
            continue;
        }
        // First, so that one which comes in between is not lost.
        pipe::register(signal, asks.try_clone()?)?;
        if signal != SIGHUP {
            flag::register_conditional_default(signal, Arc::clone(&is_asked))?;
            flag::register(signal, Arc::clone(&is_asked))?;
        }
    }
    let stdin = File::from(io::stdin().as_fd().try_clone_to_owned()?);
    // What else in this process reads there, a plugin or a library, takes no line away.
    rustix::stdio::dup2_stdin(File::open("/dev/null")?)?;
    Ok(io::BufReader::with_capacity(64 << 10, unix::Until { stdin, asked, _asks: asks }))
}

/// Whether this process was started to ignore a signal; where the system does not say, no.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|digits| u64::from_str_radix(digits.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

#[cfg(not(unix))]
pub(super) fn until_asked_to_end() -> io::Result<impl BufRead> {
    Ok(io::stdin().lock())
}

#[cfg(unix)]
mod unix {
    use std::fs::File;
    use std::io::{self, Read};
    use std::os::unix::net::UnixStream;

    use rustix::event::{PollFd, PollFlags, poll};

    pub(super) struct Until {
        pub(super) stdin: File,
        pub(super) asked: UnixStream,
        /// Open as long as this is: where no signal is watched nobody else holds it.
        pub(super) _asks: UnixStream,
    }

    impl Read for Until {
        fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
            loop {
                let mut watched =
                    [PollFd::new(&self.stdin, PollFlags::IN), PollFd::new(&self.asked, PollFlags::IN)];
                match poll(&mut watched, None) {
                    // The signal itself: the next look finds what it has written.
                    Err(rustix::io::Errno::INTR) => {}
                    Err(error) => return Err(error.into()),
                    Ok(_) if !watched[1].revents().is_empty() => {
                        return Err(io::ErrorKind::ConnectionAborted.into());
                    }
                    Ok(_) => return self.stdin.read(into),
                }
            }
        }
    }
}
