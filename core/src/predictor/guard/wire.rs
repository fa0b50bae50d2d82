//! How much a model's protobuf decodes to, before it is decoded: an empty message takes two bytes in a
//! file and hundreds in memory, so that 8 MB of them would take more than a gigabyte.

use super::{Fault, at_most};

/// Most messages and texts directly in one message.
const MAX_FIELDS: usize = 1024;
/// Most messages and texts in all.
const MAX_FIELDS_IN_ALL: usize = 16_384;
/// Largest type, which nests without names here, bytes.
const MAX_TYPE_BYTES: usize = 4096;
/// Deepest nesting: a model's tensor in an attribute is four deep.
const MAX_DEPTH: usize = 16;

/// The messages of ONNX that hold messages.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Message {
    Model,
    Training,
    Function,
    Graph,
    Node,
    Attribute,
    Tensor,
    Sparse,
    Value,
    Type,
    Entry,
}

impl Message {
    /// What a field of this message holds; none for a number or a text.
    ///
    /// # Source
    /// `onnx.proto3`, IR version 10.
    fn field(self, number: u64) -> Option<Self> {
        Some(match (self, number) {
            (Self::Model, 7) | (Self::Training, 1 | 2) | (Self::Attribute, 6 | 11) => Self::Graph,
            (Self::Model, 20) => Self::Training,
            (Self::Model, 25) => Self::Function,
            (Self::Graph, 1) | (Self::Function, 7) => Self::Node,
            (Self::Node, 5) | (Self::Function, 11) => Self::Attribute,
            (Self::Graph, 5) | (Self::Attribute, 5 | 10) | (Self::Sparse, 1 | 2) => Self::Tensor,
            (Self::Graph, 15) | (Self::Attribute, 22 | 23) => Self::Sparse,
            (Self::Graph, 11..=13) => Self::Value,
            (Self::Attribute, 14 | 15) | (Self::Value, 2) => Self::Type,
            (Self::Model, 8 | 14) | (Self::Graph, 14 | 16) | (Self::Node, 9) | (Self::Tensor, 13 | 16) => {
                Self::Entry
            }
            _ => return None,
        })
    }
}

/// Checks that `bytes`, a model, decode to a bounded number of messages and texts.
///
/// # Errors
/// There are more, they nest too deep, or the bytes are no protobuf.
pub(super) fn check(bytes: &[u8]) -> Result<(), Fault> {
    let mut left = MAX_FIELDS_IN_ALL;
    message(bytes, Message::Model, MAX_DEPTH, &mut left)
}

fn message(mut rest: &[u8], kind: Message, depth: usize, left: &mut usize) -> Result<(), Fault> {
    let name = || format!("{kind:?}").to_lowercase();
    if depth == 0 {
        return Err(Fault::new(
            "file",
            format!("{} more than {MAX_DEPTH} deep", name()),
            at_most(MAX_DEPTH as u64, ""),
        ));
    }
    if kind == Message::Type && rest.len() > MAX_TYPE_BYTES {
        let wanted = at_most(MAX_TYPE_BYTES as u64, "bytes");
        return Err(Fault::new("file", format!("a type of {} bytes", rest.len()), wanted));
    }
    let mut fields = 0;
    while !rest.is_empty() {
        let key = varint(&mut rest)?;
        let skipped = match key & 7 {
            0 => {
                varint(&mut rest)?;
                continue;
            }
            1 => 8,
            5 => 4,
            2 => varint(&mut rest)?,
            _ => return Err(malformed()),
        };
        let content = take(&mut rest, skipped)?;
        if key & 7 != 2 {
            continue;
        }
        fields += 1;
        if fields > MAX_FIELDS {
            let found = format!("more than {MAX_FIELDS} messages and texts in a {}", name());
            return Err(Fault::new("file", found, at_most(MAX_FIELDS as u64, "")));
        }
        *left = left.checked_sub(1).ok_or_else(|| {
            let found = format!("more than {MAX_FIELDS_IN_ALL} messages and texts");
            Fault::new("file", found, at_most(MAX_FIELDS_IN_ALL as u64, ""))
        })?;
        if let Some(inner) = kind.field(key >> 3) {
            message(content, inner, depth - 1, left)?;
        }
    }
    Ok(())
}

fn take<'a>(rest: &mut &'a [u8], length: u64) -> Result<&'a [u8], Fault> {
    let length = usize::try_from(length).map_err(|_| malformed())?;
    let (content, after) = rest.split_at_checked(length).ok_or_else(malformed)?;
    *rest = after;
    Ok(content)
}

fn varint(rest: &mut &[u8]) -> Result<u64, Fault> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (&byte, after) = rest.split_first().ok_or_else(malformed)?;
        *rest = after;
        value |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Ok(value);
        }
    }
    Err(malformed())
}

fn malformed() -> Fault {
    Fault::new("file", "bytes that are no protobuf, or cut short", "a whole ONNX model in protobuf")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A length-delimited field.
    fn field(number: u8, content: &[u8]) -> Vec<u8> {
        let mut bytes = vec![number << 3 | 2];
        let mut length = content.len();
        while length >= 0x80 {
            bytes.push(length as u8 | 0x80);
            length >>= 7;
        }
        bytes.push(length as u8);
        bytes.extend(content);
        bytes
    }

    fn refusal(bytes: &[u8]) -> String {
        check(bytes).expect_err("a refusal").found
    }

    #[test]
    fn a_million_empty_messages_are_refused_before_they_are_decoded() {
        for (number, kind) in [(1, "graph"), (5, "graph"), (13, "graph")] {
            let graph = field(number, &[]).repeat(1 << 20);
            assert_eq!(refusal(&field(7, &graph)), format!("more than 1024 messages and texts in a {kind}"));
        }
        let attributes = field(5, &[]).repeat(1 << 20);
        assert!(refusal(&field(7, &field(1, &attributes))).ends_with("in a node"));
        assert!(refusal(&field(14, &[]).repeat(1 << 20)).ends_with("in a model"));
    }

    #[test]
    fn messages_spread_over_many_are_counted_in_all() {
        let node = field(1, &field(5, &[]).repeat(1000));
        assert_eq!(refusal(&field(7, &node.repeat(100))), "more than 16384 messages and texts");
        // The parts of one graph may come in pieces, which are merged.
        assert_eq!(
            refusal(&field(7, &field(1, &[]).repeat(1000)).repeat(100)),
            "more than 16384 messages and texts"
        );
    }

    #[test]
    fn a_graph_within_a_graph_without_end_is_refused() {
        let mut graph = Vec::new();
        for _ in 0..100 {
            graph = field(1, &field(5, &field(6, &graph)));
        }
        assert!(refusal(&field(7, &graph)).contains("deep"));
    }

    #[test]
    fn bytes_that_are_no_protobuf_are_refused() {
        for bytes in [
            &[0x3a][..],
            &[0x3a, 0x7f],
            &[0xff; 11],
            &[0x3b, 0x3c],
            &[0x3a, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01],
        ] {
            assert!(refusal(bytes).contains("no protobuf"), "{bytes:?}");
        }
        check(&[]).expect("an empty model is for the decoder to refuse");
    }
}
