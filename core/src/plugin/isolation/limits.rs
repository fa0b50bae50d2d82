//! What a child may take of the machine.

#![allow(unsafe_code, reason = "asks the system by its C interface")]

use std::io;
use std::os::fd::AsRawFd;

/// Address space for loading: the library, a policy network, a model runtime.
pub(super) const LOADING_BYTES: u64 = 4 << 30;
/// Address space that an instance may come to need more than when it was made.
pub(super) const GROWTH_BYTES: u64 = 256 << 20;

/// Allows this process `bytes` of address space more than it has now; an allocation beyond fails, and
/// ends it.
pub(super) fn allow_growth(bytes: u64) -> io::Result<()> {
    let wanted = address_space_bytes()? + bytes;
    let mut now = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: writes one `rlimit`, which lives here.
    checked(unsafe { libc::getrlimit(libc::RLIMIT_AS, &raw mut now) })?;
    limit(libc::RLIMIT_AS, wanted.min(now.rlim_max))
}

/// A crash of this process writes no core file: that would keep the host waiting.
pub(super) fn leave_no_core() -> io::Result<()> {
    limit(libc::RLIMIT_CORE, 0)?;
    let none: libc::c_ulong = 0;
    // SAFETY: sets a flag of this process.
    checked(unsafe { libc::prctl(libc::PR_SET_DUMPABLE, none, none, none, none) })
}

fn limit(resource: libc::__rlimit_resource_t, most: u64) -> io::Result<()> {
    let limit = libc::rlimit { rlim_cur: most, rlim_max: most };
    // SAFETY: reads one `rlimit`, which lives here.
    checked(unsafe { libc::setrlimit(resource, &raw const limit) })
}

/// Waits until the other end of a socket is gone.
pub(super) fn wait_for_hang_up(socket: &impl AsRawFd) {
    let mut watched = libc::pollfd { fd: socket.as_raw_fd(), events: libc::POLLRDHUP, revents: 0 };
    // SAFETY: one `pollfd`, which lives here; -1 waits for as long as it takes.
    while unsafe { libc::poll(&raw mut watched, 1, -1) } != 1 {}
}

fn checked(result: libc::c_int) -> io::Result<()> {
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

fn address_space_bytes() -> io::Result<u64> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmSize:"));
    let kilobytes = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
    kilobytes.map(|it| it << 10).ok_or_else(|| io::Error::other("/proc/self/status without VmSize"))
}
