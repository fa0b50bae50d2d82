//! Manifests: TOML files that bind a plugin to its models, and skills to a robot.
//!
//! Raw serde structs become checked types at this door; nothing behind it looks up strings. Every
//! refusal is a [`Finding`]: file, line, field, what was found, what would be right.

mod deadlines;
mod deployment;
mod finding;
mod reader;
mod skill;

pub use deadlines::Deadlines;
pub use deployment::{Deployment, HeightfieldLimits, MeasurementLimits};
pub use finding::Finding;
pub(crate) use finding::{FIELD_CHARS, WORDS_CHARS, readable};
pub use reader::read_bounded;
pub(crate) use reader::{MAX_BYTES, bytes_of};
pub use skill::{CommandRange, Isolation, Models, Rollout, Selection, SkillManifest};

/// The schema number that every manifest carries.
pub const SCHEMA: u32 = 1;

/// Whether `name` may name a skill, a plugin or a deployment: `snake_case` that begins with a letter.
pub fn is_snake_case(name: &str) -> bool {
    name.starts_with(|first: char| first.is_ascii_lowercase())
        && name.len() <= 64
        && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}

#[cfg(test)]
mod tests;
