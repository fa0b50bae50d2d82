//! [`Curves`] as a `TensorBoard` event file: records of a length, its checksum, a protobuf, its checksum.
//!
//! The clock of an event is its row, so that the same run writes the same bytes.

use prost::Message;

use super::curves::Curves;

/// `tensorflow.Event`, as far as scalars need it.
#[derive(Clone, PartialEq, Message)]
struct Event {
    #[prost(double, tag = "1")]
    wall_time: f64,
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(string, optional, tag = "3")]
    file_version: Option<String>,
    #[prost(message, optional, tag = "5")]
    summary: Option<Summary>,
}

/// `tensorflow.Summary`.
#[derive(Clone, PartialEq, Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    value: Vec<Scalar>,
}

/// `tensorflow.Summary.Value`.
#[derive(Clone, PartialEq, Message)]
struct Scalar {
    #[prost(string, tag = "1")]
    tag: String,
    #[prost(float, tag = "2")]
    simple_value: f32,
}

/// The file's bytes.
pub fn encode(curves: &Curves) -> Vec<u8> {
    let mut events = vec![Event { file_version: Some("brain.Event:2".to_owned()), ..Event::default() }];
    events.extend((1..=curves.rows()).map(|row| Event {
        wall_time: row as f64,
        step: row as i64,
        file_version: None,
        summary: Some(Summary::default()),
    }));
    for name in curves.columns() {
        // One group for the terms of the reward, one for the rest.
        let tag = if name.contains('/') { name.clone() } else { format!("train/{name}") };
        for (row, value) in curves.column(name) {
            if let Some(summary) = &mut events[row].summary {
                summary.value.push(Scalar { tag: tag.clone(), simple_value: value as f32 });
            }
        }
    }
    events.iter().flat_map(|event| record(&event.encode_to_vec())).collect()
}

fn record(data: &[u8]) -> Vec<u8> {
    let length = (data.len() as u64).to_le_bytes();
    let checksum = |bytes: &[u8]| masked(crc32c(bytes)).to_le_bytes();
    [&length[..], &checksum(&length), data, &checksum(data)].concat()
}

/// The format's rotation of a checksum.
fn masked(crc: u32) -> u32 {
    crc.rotate_right(15).wrapping_add(0xa282_ead8)
}

/// CRC-32C (Castagnoli), bit by bit.
fn crc32c(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0x82f6_3b78 & (crc & 1).wrapping_neg());
        }
    }
    !crc
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_castagnolis() {
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
    }

    #[test]
    fn every_number_of_the_table_is_in_the_file() {
        let curves = Curves::parse("row,reward,reward/speed\n1,0.5,\n2,0.75,2\n").unwrap();
        let bytes = encode(&curves);
        let (mut at, mut events) = (0, Vec::new());
        while at < bytes.len() {
            let length = u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
            assert_eq!(bytes[at + 8..at + 12], masked(crc32c(&bytes[at..at + 8])).to_le_bytes());
            events.push(Event::decode(&bytes[at + 12..at + 12 + length]).unwrap());
            at += length + 16;
        }
        assert_eq!(events[0].file_version.as_deref(), Some("brain.Event:2"));
        let told = |row: usize| -> Vec<(String, f32)> {
            let summary = events[row].summary.clone().unwrap();
            summary.value.into_iter().map(|scalar| (scalar.tag, scalar.simple_value)).collect()
        };
        assert_eq!(told(1), [("train/reward".to_owned(), 0.5)]);
        assert_eq!(told(2), [("train/reward".to_owned(), 0.75), ("reward/speed".to_owned(), 2.0)]);
        assert_eq!((events.len(), events[2].step), (3, 2));
    }
}
