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
