//! Runtimes that rollouts take turns with, so that a deployment is loaded once for each thread and not
//! once for each rollout.

use std::sync::{Arc, Mutex, PoisonError};

use vocaloco_core::runtime::Runtime;

use super::{CourseError, Ground};

/// A runtime, and where it is told what lies under the field if it asks an oracle.
pub struct Crew {
    /// The runtime.
    pub runtime: Runtime,
    /// What its oracle looks at.
    pub ground: Option<Arc<Ground>>,
}

impl From<Runtime> for Crew {
    fn from(runtime: Runtime) -> Self {
        Self { runtime, ground: None }
    }
}

type Make<'a> = Box<dyn Fn() -> Result<Crew, CourseError> + Send + Sync + 'a>;

/// Runtimes of one deployment, made as threads ask for them.
pub struct Runtimes<'a> {
    name: String,
    make: Make<'a>,
    idle: Mutex<Vec<Crew>>,
}

impl<'a> Runtimes<'a> {
    /// Runtimes that `make` makes; `name` is what rows call their selector.
    pub fn new(name: &str, make: impl Fn() -> Result<Crew, CourseError> + Send + Sync + 'a) -> Self {
        Self { name: name.to_owned(), make: Box::new(make), idle: Mutex::new(Vec::new()) }
    }

    /// What rows call their selector.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Lets `work` have a runtime that stands at the start of its loop.
    ///
    /// # Errors
    /// No runtime can be made, or what `work` reports.
    pub fn with<R>(&self, work: impl FnOnce(&mut Crew) -> Result<R, CourseError>) -> Result<R, CourseError> {
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let waiting = idle().pop();
        let mut crew = waiting.map_or_else(|| (self.make)(), Ok)?;
        crew.runtime.restart();
        let done = work(&mut crew)?;
        idle().push(crew);
        Ok(done)
    }
}
