//! The host's side of `plugins/api`: finds a plugin's library, makes sure that it can be loaded,
//! and wraps its instances.
//!
//! A library is read once, hashed, and loaded from the very bytes that were hashed; one whose hash
//! is loaded is reused; none is ever unloaded, since unwinding, thread locals and buffers of a
//! plugin may outlive every handle to it.

mod description;
#[cfg(any(test, all(target_os = "linux", target_pointer_width = "64")))]
mod elf;
mod error;
mod image;
mod instance;
#[cfg(target_os = "linux")]
mod isolation;
mod library;
pub(crate) mod repeats;
mod state_buffer;

pub use error::PluginError;
pub use instance::PluginInstance;
#[cfg(target_os = "linux")]
pub(crate) use isolation::try_skill;
#[cfg(target_os = "linux")]
pub use isolation::{isolate_with, serve};
pub use library::{Admit, PluginLibrary, library_file_name};
pub(crate) use state_buffer::StateBuffer;
