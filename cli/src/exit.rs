//! How a run ended, as the shell sees it.

use std::process::ExitCode;

/// The exit codes of every verb.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Exit {
    /// 0: it ran and all is as it should be.
    Fine,
    /// 1: it ran and found something: an unsound manifest, an unexpected outcome, a failed check.
    #[allow(dead_code, reason = "a robot's build has few verbs that find anything")]
    Finding,
    /// 2: it could not run.
    CouldNotRun,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        ExitCode::from(match exit {
            Exit::Fine => 0,
            Exit::Finding => 1,
            Exit::CouldNotRun => 2,
        })
    }
}
