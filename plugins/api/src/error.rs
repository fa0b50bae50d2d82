//! Errors as they cross the plugin boundary.

use abi_stable::{StableAbi, std_types::RString};

/// What kind of failure a plugin reports.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorCode {
    /// The parameter text does not parse, or names something the plugin does not know.
    Parameters,
    /// The robot lacks something that the plugin needs, such as a joint or a foot.
    Robot,
    /// The state or command of this tick cannot be acted on.
    Input,
    /// The plugin panicked; the panic was stopped at its border.
    Panic,
    /// Any other failure inside the plugin.
    Internal,
}

/// A failure inside a plugin, in one line that says where, what was found and what would be right.
#[repr(C)]
#[derive(StableAbi, Clone, Debug, PartialEq, Eq)]
pub struct SkillError {
    /// What kind of failure it is.
    pub code: ErrorCode,
    /// One line for a person.
    pub message: RString,
}

impl SkillError {
    /// An error of the given kind.
    pub fn new(code: ErrorCode, message: impl Into<String>) -> Self {
        Self { code, message: message.into().into() }
    }
}

impl std::fmt::Display for SkillError {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&self.message)
    }
}

impl std::error::Error for SkillError {}
