//! Memory that host and child both see.
#![allow(unsafe_code, reason = "maps memory that another process writes to")]

use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::ptr::{self, NonNull};

use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, memfd_create};

/// Room for a call, and as much again for its answer: the largest terrain patch is 1.4 MB.
pub(super) const HALF_BYTES: usize = 2 << 20;

/// A mapped file, read and written by copies only: what the other side does meanwhile can spoil
/// values, which are checked after they are copied, and nothing else.
pub(super) struct SharedMemory {
    start: NonNull<u8>,
}

// SAFETY: the mapping belongs to this value alone within the process.
unsafe impl Send for SharedMemory {}

impl SharedMemory {
    /// New memory, zero throughout, and the file that the other side finds it in.
    pub(super) fn new() -> io::Result<(Self, File)> {
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let file = File::from(memfd_create("vocaloco-call", flags)?);
        file.set_len(2 * HALF_BYTES as u64)?;
        // Memory that the other side cuts short would end this process at the next read.
        fcntl_add_seals(&file, SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL)?;
        Ok((Self::map(&file)?, file))
    }

    /// The memory that another process has made.
    pub(super) fn of(file: &File) -> io::Result<Self> {
        if file.metadata()?.len() != 2 * HALF_BYTES as u64 {
            return Err(io::Error::other("memory of another size"));
        }
        Self::map(file)
    }

    fn map(file: &File) -> io::Result<Self> {
        // SAFETY: a new mapping of a file of this length, at an address of the system's choice.
        let start = unsafe {
            let access = libc::PROT_READ | libc::PROT_WRITE;
            libc::mmap(ptr::null_mut(), 2 * HALF_BYTES, access, libc::MAP_SHARED, file.as_raw_fd(), 0)
        };
        if start == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        let start = NonNull::new(start.cast()).ok_or_else(|| io::Error::other("no address"))?;
        Ok(Self { start })
    }

    /// Writes a length and `bytes` to one half, 0 or 1; `false` when they do not fit.
    pub(super) fn write(&mut self, half: usize, bytes: &[u8]) -> bool {
        if bytes.len() > HALF_BYTES - 8 {
            return false;
        }
        let length = (bytes.len() as u64).to_le_bytes();
        // SAFETY: `half` is 0 or 1 and the length was checked: all of it is inside the mapping.
        unsafe {
            let at = self.start.as_ptr().add((half & 1) * HALF_BYTES);
            at.copy_from_nonoverlapping(length.as_ptr(), 8);
            at.add(8).copy_from_nonoverlapping(bytes.as_ptr(), bytes.len());
        }
        true
    }

    /// Copies what was written to one half into `bytes`; no more than fits there, whatever it says.
    pub(super) fn read(&self, half: usize, bytes: &mut Vec<u8>) {
        let mut length = [0; 8];
        bytes.clear();
        // SAFETY: as in `write`; the length is bounded before it is used.
        unsafe {
            let at = self.start.as_ptr().add((half & 1) * HALF_BYTES);
            at.copy_to_nonoverlapping(length.as_mut_ptr(), 8);
            let length = usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX);
            bytes.resize(length.min(HALF_BYTES - 8), 0);
            at.add(8).copy_to_nonoverlapping(bytes.as_mut_ptr(), bytes.len());
        }
    }
}

impl Drop for SharedMemory {
    fn drop(&mut self) {
        // SAFETY: mapped by `map` with this length, and never used again.
        unsafe { libc::munmap(self.start.as_ptr().cast(), 2 * HALF_BYTES) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_one_side_writes_the_other_reads_and_the_halves_are_apart() {
        let (mut ours, file) = SharedMemory::new().unwrap();
        let mut theirs = SharedMemory::of(&file).unwrap();
        assert!(ours.write(0, b"call") && theirs.write(1, b"an answer"));
        let mut bytes = Vec::new();
        theirs.read(0, &mut bytes);
        assert_eq!(bytes, b"call");
        ours.read(1, &mut bytes);
        assert_eq!(bytes, b"an answer");
    }

    #[test]
    fn the_other_side_cannot_cut_it_short() {
        let (ours, file) = SharedMemory::new().unwrap();
        assert!(file.set_len(0).is_err());
        ours.read(1, &mut Vec::new());
    }

    #[test]
    fn too_much_is_not_written_and_a_length_that_lies_is_cut() {
        let (mut memory, _) = SharedMemory::new().unwrap();
        assert!(!memory.write(0, &vec![1; HALF_BYTES - 7]));
        assert!(memory.write(1, &vec![1; HALF_BYTES - 8]));
        // SAFETY: the first bytes of the mapping.
        unsafe { memory.start.as_ptr().write_bytes(0xff, 8) };
        let mut bytes = Vec::new();
        memory.read(0, &mut bytes);
        assert_eq!(bytes.len(), HALF_BYTES - 8);
    }
}
