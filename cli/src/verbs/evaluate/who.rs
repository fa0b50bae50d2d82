//! Who chooses on a course, by name.

use std::fmt;
use std::str::FromStr;

use serde::{Serialize, Serializer};

/// A selector as the command line names it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Who {
    /// The deployment, choosing by its predictors.
    Vocaloco,
    /// The deployment, choosing by what was collected.
    Oracle,
    /// One skill alone, with no stop.
    Skill(String),
}

impl Who {
    /// The skill that runs alone, if one does.
    pub(super) fn alone(&self) -> Option<&str> {
        match self {
            Self::Skill(name) => Some(name),
            Self::Vocaloco | Self::Oracle => None,
        }
    }
}

impl fmt::Display for Who {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Vocaloco => formatter.write_str("vocaloco"),
            Self::Oracle => formatter.write_str("oracle"),
            Self::Skill(name) => write!(formatter, "skill:{name}"),
        }
    }
}

impl FromStr for Who {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            None if text == "vocaloco" => Ok(Self::Vocaloco),
            None if text == "oracle" => Ok(Self::Oracle),
            Some(("skill", name)) if !name.is_empty() => Ok(Self::Skill(name.to_owned())),
            _ => Err(format!("found {text:?}, wanted vocaloco, oracle or skill:NAME")),
        }
    }
}

impl Serialize for Who {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_back_as_they_were_written() {
        for name in ["vocaloco", "oracle", "skill:trot"] {
            assert_eq!(name.parse::<Who>().unwrap().to_string(), name);
        }
        for name in ["", "skill:", "trot", "vocaloco:trot"] {
            assert!(name.parse::<Who>().is_err(), "{name}");
        }
    }
}
