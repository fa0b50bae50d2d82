//! A [`Learner`] as one file, in the safetensors format: 8 bytes that give the header's length, a JSON
//! header, raw little-endian values. Written whole or not at all.

use std::collections::BTreeMap;

use anyhow::{Context, anyhow, bail, ensure};
use serde::{Deserialize, Serialize};

use super::config::Plan;
use super::learner::{Learner, Widths};

/// A header longer than this is not ours.
const LONGEST_HEADER: u64 = 1 << 20;

#[derive(Serialize, Deserialize)]
struct Entry {
    dtype: String,
    shape: Vec<usize>,
    data_offsets: [usize; 2],
}

#[derive(Serialize, Deserialize)]
struct Header {
    #[serde(rename = "__metadata__")]
    metadata: BTreeMap<String, String>,
    #[serde(flatten)]
    tensors: BTreeMap<String, Entry>,
}

/// What a checkpoint says of the run that it belongs to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Run {
    /// The run's seed.
    pub seed: u64,
    /// The whole configuration, as JSON; a run resumes under the same one alone.
    pub config: String,
}

/// Lets `visit` see every array of a learner, by name, in an order that never changes.
fn arrays(
    learner: &mut Learner,
    mut visit: impl FnMut(&str, Array<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    visit("policy", Array::F32(&mut learner.policy))?;
    visit("policy.adam_mean", Array::F32(&mut learner.policy_adam.mean))?;
    visit("policy.adam_square", Array::F32(&mut learner.policy_adam.square))?;
    visit("value", Array::F32(&mut learner.value))?;
    visit("value.adam_mean", Array::F32(&mut learner.value_adam.mean))?;
    visit("value.adam_square", Array::F32(&mut learner.value_adam.square))?;
    visit("observation.mean", Array::F64(&mut learner.observation.mean))?;
    visit("observation.squares", Array::F64(&mut learner.observation.squares))?;
    visit("observation.count", Array::F64(std::slice::from_mut(&mut learner.observation.count)))?;
    visit("privileged.mean", Array::F64(&mut learner.privileged.mean))?;
    visit("privileged.squares", Array::F64(&mut learner.privileged.squares))?;
    visit("privileged.count", Array::F64(std::slice::from_mut(&mut learner.privileged.count)))?;
    visit("learning_rate", Array::F32(std::slice::from_mut(&mut learner.learning_rate)))?;
    let counts = [
        ("policy.adam_steps", &mut learner.policy_adam.steps),
        ("value.adam_steps", &mut learner.value_adam.steps),
        ("iteration", &mut learner.iteration),
        ("rounds", &mut learner.rounds),
        ("steps", &mut learner.steps),
    ];
    for (name, count) in counts {
        visit(name, Array::U64(std::slice::from_mut(count)))?;
    }
    visit("levels", Array::U32(&mut learner.levels))
}

/// An array of a learner, to read or to write.
enum Array<'a> {
    F32(&'a mut [f32]),
    F64(&'a mut [f64]),
    U32(&'a mut [u32]),
    U64(&'a mut [u64]),
}

impl Array<'_> {
    fn dtype(&self) -> &'static str {
        match self {
            Self::F32(_) => "F32",
            Self::F64(_) => "F64",
            Self::U32(_) => "U32",
            Self::U64(_) => "U64",
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::F64(values) => values.len(),
            Self::U32(values) => values.len(),
            Self::U64(values) => values.len(),
        }
    }

    fn bytes(&self) -> Vec<u8> {
        match self {
            Self::F32(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::F64(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::U32(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::U64(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        }
    }

    /// Takes values of the right number.
    fn fill(self, bytes: &[u8]) {
        fn each<const N: usize, V>(values: &mut [V], bytes: &[u8], of: fn([u8; N]) -> V) {
            for (value, bytes) in values.iter_mut().zip(bytes.as_chunks::<N>().0) {
                *value = of(*bytes);
            }
        }
        match self {
            Self::F32(values) => each(values, bytes, f32::from_le_bytes),
            Self::F64(values) => each(values, bytes, f64::from_le_bytes),
            Self::U32(values) => each(values, bytes, u32::from_le_bytes),
            Self::U64(values) => each(values, bytes, u64::from_le_bytes),
        }
    }
}

/// The file's bytes; the same learner and run give the same.
///
/// # Panics
/// Never: strings and numbers are written to memory.
pub fn encode(learner: &Learner, run: &Run) -> Vec<u8> {
    let metadata = [
        ("config", run.config.clone()),
        ("format", "vocaloco-training-1".to_owned()),
        ("seed", run.seed.to_string()),
    ];
    let mut header = Header {
        metadata: metadata.map(|(key, value)| (key.to_owned(), value)).into(),
        tensors: BTreeMap::new(),
    };
    let mut data = Vec::new();
    let mut copy = learner.clone();
    let visited = arrays(&mut copy, |name, array| {
        let start = data.len();
        data.extend(array.bytes());
        let entry = Entry {
            dtype: array.dtype().to_owned(),
            shape: vec![array.len()],
            data_offsets: [start, data.len()],
        };
        header.tensors.insert(name.to_owned(), entry);
        Ok(())
    });
    visited.expect("writing to memory");
    let mut text = serde_json::to_vec(&header).expect("strings and numbers");
    // The values begin at a multiple of eight, as the format's readers like it.
    text.resize(text.len().next_multiple_of(8), b' ');
    let mut bytes = (text.len() as u64).to_le_bytes().to_vec();
    bytes.extend(text);
    bytes.extend(data);
    bytes
}

/// A learner and its run from a file's bytes.
///
/// # Errors
/// It is no such file, or its arrays do not fit the plan and the environment.
pub fn decode(bytes: &[u8], plan: &Plan, widths: Widths) -> anyhow::Result<(Learner, Run)> {
    let (length, rest) = bytes.split_first_chunk::<8>().context("shorter than its header's length")?;
    let length = u64::from_le_bytes(*length);
    ensure!(
        length <= LONGEST_HEADER && length <= rest.len() as u64,
        "header: found a length of {length}, wanted at most {}",
        LONGEST_HEADER.min(rest.len() as u64)
    );
    let (text, data) = rest.split_at(length as usize);
    let header: Header = serde_json::from_slice(text).context("header: does not parse")?;
    let told = |key: &str| {
        let value = header.metadata.get(key);
        value.with_context(|| format!("__metadata__.{key}: found none, wanted a string"))
    };
    let format = told("format")?;
    ensure!(format == "vocaloco-training-1", "format: found {format}, wanted vocaloco-training-1");
    let seed = told("seed")?.parse().context("seed: wanted a whole number")?;
    let mut learner = Learner::new(plan, widths, seed);
    arrays(&mut learner, |name, array| {
        let entry = header.tensors.get(name).ok_or_else(|| anyhow!("{name}: found none, wanted an array"))?;
        if entry.dtype != array.dtype() || entry.shape != [array.len()] {
            bail!(
                "{name}: found {} {:?}, wanted {} [{}]",
                entry.dtype,
                entry.shape,
                array.dtype(),
                array.len()
            );
        }
        let [start, end] = entry.data_offsets;
        let found = data.get(start..end).filter(|found| found.len() == array.bytes().len());
        array.fill(found.with_context(|| format!("{name}: its values are cut short"))?);
        Ok(())
    })?;
    Ok((learner, Run { seed, config: told("config")?.clone() }))
}

#[cfg(test)]
mod tests {
    use super::super::config::TrainingConfig;
    use super::*;

    const WIDTHS: Widths = Widths { observation: 5, privileged: 7, action: 2 };

    fn learner() -> (Plan, Learner) {
        let plan = TrainingConfig::with_environment(3, ());
        let mut learner = Learner::new(&plan, WIDTHS, 4);
        learner.levels = vec![0, 9, 4];
        learner.observation.count = 1.0 / 3.0;
        learner.value_adam.steps = u64::MAX;
        learner.learning_rate = 3.3e-5;
        (plan, learner)
    }

    fn run() -> Run {
        Run { seed: 4, config: "{\"a\":1}".to_owned() }
    }

    #[test]
    fn what_was_written_is_read_bit_for_bit() {
        let (plan, learner) = learner();
        let bytes = encode(&learner, &run());
        assert_eq!(decode(&bytes, &plan, WIDTHS).unwrap(), (learner.clone(), run()));
        assert_eq!(bytes, encode(&learner, &run()));
    }

    #[test]
    fn another_environment_s_checkpoint_is_refused_by_the_array_that_does_not_fit() {
        let (plan, learner) = learner();
        let bytes = encode(&learner, &run());
        let error = decode(&bytes, &plan, Widths { observation: 6, ..WIDTHS }).unwrap_err();
        assert!(error.to_string().starts_with("policy: found F32"), "{error:#}");
    }

    #[test]
    fn a_file_cut_anywhere_is_refused() {
        let (plan, learner) = learner();
        let bytes = encode(&learner, &run());
        for length in (0..bytes.len()).step_by(997).chain([7, 8, 100, bytes.len() - 1]) {
            assert!(decode(&bytes[..length], &plan, WIDTHS).is_err(), "cut at {length}");
        }
    }

    #[test]
    fn the_largest_sizes_stay_below_five_megabytes() {
        let plan = TrainingConfig::with_environment(1024, ());
        let widths = Widths { observation: 237, privileged: 270, action: 12 };
        assert!(encode(&Learner::new(&plan, widths, 1), &run()).len() < 5_000_000);
    }
}
