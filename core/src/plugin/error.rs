//! Why a plugin was refused.

use crate::manifest::Finding;

/// Why a plugin was refused; each holds the one line for people.
#[derive(Clone, Debug, thiserror::Error)]
pub enum PluginError {
    /// No library of that name on the plugin path, or it cannot be read.
    #[error("{0}")]
    NotFound(Finding),
    /// The library is not the one that was locked.
    #[error("{0}")]
    Unlocked(Finding),
    /// The file is no loadable library: truncated, for another machine, not a library at all.
    #[error("{0}")]
    NotALibrary(Finding),
    /// It is a library, but not one of this interface.
    #[error("{0}")]
    ForeignInterface(Finding),
    /// What it says of itself makes no sense.
    #[error("{0}")]
    Description(Finding),
    /// It refused the parameters or the robot.
    #[error("{0}")]
    Create(Finding),
}

impl PluginError {
    /// The line for people, in its parts.
    pub fn finding(&self) -> &Finding {
        match self {
            Self::NotFound(finding)
            | Self::Unlocked(finding)
            | Self::NotALibrary(finding)
            | Self::ForeignInterface(finding)
            | Self::Description(finding)
            | Self::Create(finding) => finding,
        }
    }

    /// The line for people, in its parts.
    pub fn into_finding(self) -> Finding {
        match self {
            Self::NotFound(finding)
            | Self::Unlocked(finding)
            | Self::NotALibrary(finding)
            | Self::ForeignInterface(finding)
            | Self::Description(finding)
            | Self::Create(finding) => finding,
        }
    }

    /// Whether it is of the moment, in which there was another file, no process, or no library that it asks for, and
    /// may be otherwise the next time.
    pub(super) fn may_pass(&self) -> bool {
        matches!(self, Self::NotFound(_) | Self::NotALibrary(_)) || self.finding().field == "isolation"
    }

    /// Its place among the kinds, for another process of this program.
    #[cfg(target_os = "linux")]
    pub(super) const fn kind(&self) -> u32 {
        match self {
            Self::NotFound(_) => 0,
            Self::NotALibrary(_) => 1,
            Self::ForeignInterface(_) => 2,
            Self::Description(_) => 3,
            Self::Create(_) => 4,
            Self::Unlocked(_) => 5,
        }
    }

    /// The error of a [`kind`](Self::kind).
    #[cfg(target_os = "linux")]
    pub(super) const fn of_kind(kind: u32, finding: Finding) -> Self {
        match kind {
            0 => Self::NotFound(finding),
            1 => Self::NotALibrary(finding),
            2 => Self::ForeignInterface(finding),
            3 => Self::Description(finding),
            5 => Self::Unlocked(finding),
            _ => Self::Create(finding),
        }
    }

    /// The same refusal of the same bytes under another file name.
    pub(super) fn about(mut self, file: &std::path::Path) -> Self {
        match &mut self {
            Self::NotFound(finding)
            | Self::Unlocked(finding)
            | Self::NotALibrary(finding)
            | Self::ForeignInterface(finding)
            | Self::Description(finding)
            | Self::Create(finding) => file.clone_into(&mut finding.file),
        }
        self
    }
}
