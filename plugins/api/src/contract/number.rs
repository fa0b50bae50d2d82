//! Numbers that are written once for all, or one by one.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::{Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::{ContractError, MAX_TERMS};

/// A number for every joint, or one for each by name.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum PerJoint {
    /// The same for all.
    All(f64),
    /// One for each.
    Each(BTreeMap<String, f64>),
}

impl PerJoint {
    /// The numbers in the order of `joints`.
    ///
    /// # Errors
    /// A joint has none, or a name is not among `joints`.
    pub fn in_order(&self, field: &str, joints: &[String]) -> Result<Vec<f64>, ContractError> {
        match self {
            Self::All(value) => Ok(vec![*value; joints.len()]),
            Self::Each(values) => by_name(field, values, joints),
        }
    }
}

/// The numbers of `values` in the order of `joints`.
pub(crate) fn by_name(
    field: &str,
    values: &BTreeMap<String, f64>,
    joints: &[String],
) -> Result<Vec<f64>, ContractError> {
    if let Some(stranger) = values.keys().find(|name| !joints.contains(name)) {
        let wanted = format!("one of joints: {}", joints.join(", "));
        return Err(ContractError::new(format!("{field}.{stranger}"), format!("{stranger:?}"), wanted));
    }
    let value = |joint: &String| {
        let missing =
            || ContractError::new(format!("{field}.{joint}"), "nothing", "a number for every joint");
        values.get(joint).copied().ok_or_else(missing)
    };
    joints.iter().map(value).collect()
}

/// A factor on every component of a term, or one for each.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Factor {
    /// The same for all.
    All(f64),
    /// One for each component, in order.
    Each(Vec<f64>),
}

impl Default for Factor {
    fn default() -> Self {
        Self::All(1.0)
    }
}

impl Factor {
    /// The factors of a term of `width` components.
    ///
    /// # Errors
    /// Another number of factors than components, or one that is not within ±1000.
    pub(crate) fn in_order(&self, field: &str, width: usize) -> Result<Vec<f32>, ContractError> {
        let factors = match self {
            Self::All(factor) => vec![*factor; width],
            Self::Each(factors) => factors.clone(),
        };
        if factors.len() != width {
            let found = format!("{} factors", factors.len());
            return Err(ContractError::new(field, found, format!("one, or {width}")));
        }
        factors.iter().map(|factor| Ok(super::inside(field, *factor, -1e3..=1e3)? as f32)).collect()
    }
}

impl<'de> Deserialize<'de> for PerJoint {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Reader;
        impl<'de> Visitor<'de> for Reader {
            type Value = PerJoint;

            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("a number, or a table of numbers by joint")
            }

            fn visit_f64<E: Error>(self, value: f64) -> Result<PerJoint, E> {
                Ok(PerJoint::All(value))
            }

            fn visit_i64<E: Error>(self, value: i64) -> Result<PerJoint, E> {
                Ok(PerJoint::All(value as f64))
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<PerJoint, A::Error> {
                let mut values = BTreeMap::new();
                while let Some((joint, value)) = map.next_entry::<String, f64>()? {
                    values.insert(joint, value);
                }
                Ok(PerJoint::Each(values))
            }
        }
        deserializer.deserialize_any(Reader)
    }
}

impl<'de> Deserialize<'de> for Factor {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Reader;
        impl<'de> Visitor<'de> for Reader {
            type Value = Factor;

            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("a number, or a list of numbers")
            }

            fn visit_f64<E: Error>(self, value: f64) -> Result<Factor, E> {
                Ok(Factor::All(value))
            }

            fn visit_i64<E: Error>(self, value: i64) -> Result<Factor, E> {
                Ok(Factor::All(value as f64))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Factor, A::Error> {
                let mut factors = Vec::with_capacity(MAX_TERMS);
                while let Some(factor) = list.next_element()? {
                    factors.push(factor);
                }
                Ok(Factor::Each(factors))
            }
        }
        deserializer.deserialize_any(Reader)
    }
}
