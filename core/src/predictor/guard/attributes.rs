//! A node's attributes: each must be known to its operator and inside sane bounds.

use tract_onnx::pb;

use super::Fault;

/// The attributes of one node, read by name; those never asked for are refused at the end.
pub(super) struct Attributes<'a> {
    node: &'a pb::NodeProto,
    known: Vec<&'static str>,
}

impl<'a> Attributes<'a> {
    pub(super) fn of(node: &'a pb::NodeProto) -> Self {
        Self { node, known: Vec::new() }
    }

    pub(super) fn get(&mut self, name: &'static str) -> Option<&'a pb::AttributeProto> {
        self.known.push(name);
        self.node.attribute.iter().find(|attribute| attribute.name == name)
    }

    pub(super) fn fault(&self, name: &str, found: impl std::fmt::Debug, wanted: &str) -> Fault {
        Fault::new(format!("{}.{name}", self.node.op_type), format!("{found:?}"), wanted)
    }

    /// An integer that may only be `wanted`, whether given or by default.
    pub(super) fn only(&mut self, name: &'static str, default: i64, wanted: i64) -> Result<(), Fault> {
        let found = self.get(name).map_or(default, |attribute| attribute.i);
        if found == wanted { Ok(()) } else { Err(self.fault(name, found, &wanted.to_string())) }
    }

    /// A flag, 0 or 1.
    pub(super) fn flag(&mut self, name: &'static str) -> Result<bool, Fault> {
        match self.get(name).map_or(0, |attribute| attribute.i) {
            0 => Ok(false),
            1 => Ok(true),
            found => Err(self.fault(name, found, "0 or 1")),
        }
    }

    /// A list of `N` small integers, `default` when it is left out.
    pub(super) fn list<const N: usize>(
        &mut self,
        name: &'static str,
        default: Option<usize>,
        range: std::ops::RangeInclusive<i64>,
    ) -> Result<[usize; N], Fault> {
        let wanted = format!("{N} of {} to {}", range.start(), range.end());
        match (self.get(name), default) {
            (Some(attribute), _) => {
                let inside = attribute.ints.iter().all(|value| range.contains(value));
                let list: Result<[i64; N], _> = attribute.ints.as_slice().try_into();
                match list {
                    Ok(list) if inside => Ok(list.map(|value| value as usize)),
                    _ => {
                        let some: Vec<_> = attribute.ints.iter().take(8).collect();
                        Err(self.fault(name, some, &wanted))
                    }
                }
            }
            (None, Some(default)) => Ok([default; N]),
            (None, None) => Err(self.fault(name, "nothing", &wanted)),
        }
    }

    /// No implicit padding.
    pub(super) fn no_auto_pad(&mut self) -> Result<(), Fault> {
        let found = self.get("auto_pad").map_or(&b"NOTSET"[..], |attribute| attribute.s.as_slice());
        if found == b"NOTSET" {
            return Ok(());
        }
        Err(self.fault("auto_pad", String::from_utf8_lossy(found), "NOTSET, with pads"))
    }

    /// Refuses what nobody asked for, and what is there twice: only the first was looked at, and a
    /// model runtime may take the last.
    pub(super) fn finish(self) -> Result<(), Fault> {
        for (index, attribute) in self.node.attribute.iter().enumerate() {
            if !self.known.contains(&attribute.name.as_str()) || !attribute.ref_attr_name.is_empty() {
                return Err(self.fault(&attribute.name, "an attribute", "none of that name"));
            }
            // Known and distinct so far, so this looks at no more than the few known names.
            if self.node.attribute[..index].iter().any(|earlier| earlier.name == attribute.name) {
                return Err(self.fault(&attribute.name, "two of that name", "one"));
            }
        }
        Ok(())
    }
}
