//! A plugin in a process of its own: `isolation = "process"`.
//!
//! The child is this program over again under a hidden verb. It loads the library, makes one instance
//! and answers calls; states and targets go through shared memory, the call's number on a socket wakes the
//! other side. Whatever ends the child, or keeps it from answering, is an error like any other. It is a fence
//! against faults, not against malice: the child may do what this user may.

mod child;
mod frame;
mod host;
mod limits;
mod memory;
mod message;
mod wire;

pub use child::isolate_with;
pub(crate) use child::try_skill;
pub(super) use child::{ChildInstance, Program};
pub use host::serve;
