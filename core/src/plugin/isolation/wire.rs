//! Messages on the socket between host and child: a length, then that many bytes.

use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;

/// A robot and a parameter text are tens of kilobytes; more is no message.
const MAX_BYTES: u32 = 4 << 20;

pub(super) fn send(wire: &mut UnixStream, message: &impl prost::Message) -> io::Result<()> {
    let bytes = message.encode_to_vec();
    let length = u32::try_from(bytes.len()).map_err(io::Error::other)?;
    wire.write_all(&length.to_le_bytes())?;
    wire.write_all(&bytes)
}

pub(super) fn receive<M: prost::Message + Default>(wire: &mut UnixStream) -> io::Result<M> {
    let mut length = [0; 4];
    wire.read_exact(&mut length)?;
    let length = u32::from_le_bytes(length);
    if length > MAX_BYTES {
        return Err(io::Error::other(format!("a message of {length} bytes")));
    }
    let mut bytes = vec![0; length as usize];
    wire.read_exact(&mut bytes)?;
    M::decode(bytes.as_slice()).map_err(io::Error::other)
}
