//! Decision logs: MCAP with JSON messages, which Foxglove and Rerun open.
//!
//! The first message says what the loop was configured with, so that a log explains and replays
//! itself; then comes one [`Decision`] a tick. A log whose writer was killed is read up to its last
//! whole second.

mod beside;
mod setup;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions, Writer};
use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use beside::LogBeside;
pub use setup::{Setup, SetupSkill};

use crate::decision::Decision;

const SETUP: &str = "/vocaloco/setup";
const DECISION: &str = "/vocaloco/decision";
/// Messages after which a chunk is closed and handed to the system.
const FLUSH_EVERY: u32 = 50;

/// Version of the messages.
pub const SCHEMA: u32 = 1;

/// Why a log could not be written or read.
#[derive(Debug, Error)]
pub enum LogError {
    /// The system refused.
    #[error("{}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// What the system says.
        #[source]
        source: std::io::Error,
    },
    /// The disk does not keep up with the loop.
    #[error("{}: found {ticks} ticks that wait to be written, wanted a disk that keeps up", file.display())]
    Behind {
        /// The file.
        file: PathBuf,
        /// Ticks that wait.
        ticks: usize,
    },
    /// The container is damaged or no MCAP at all.
    #[error("{}: {source}, wanted an MCAP file of decisions", file.display())]
    Container {
        /// The file.
        file: PathBuf,
        /// What the reader says.
        #[source]
        source: Box<McapError>,
    },
    /// A message is not what this version writes.
    #[error("{}: {topic}: found {found}, wanted {wanted}", file.display())]
    Message {
        /// The file.
        file: PathBuf,
        /// Its topic.
        topic: &'static str,
        /// What is there.
        found: String,
        /// What should be.
        wanted: String,
    },
}

/// A log being written.
pub struct LogWriter {
    file: PathBuf,
    writer: Writer<BufWriter<File>>,
    channel: u16,
    written: u32,
    text: Vec<u8>,
}

impl LogWriter {
    /// Creates or replaces `file` and writes the setup.
    ///
    /// # Errors
    /// When the system does not take it.
    pub fn create(file: &Path, setup: &Setup) -> Result<Self, LogError> {
        let opened = File::create(file).map_err(|source| LogError::Io { file: file.to_owned(), source })?;
        let fault = |source| container(file, source);
        let options = WriteOptions::new().library("vocaloco").compression(None);
        let mut writer = options.create(BufWriter::new(opened)).map_err(fault)?;
        let mut channel = |name: &str, topic: &str, schema: &str| {
            let id = writer.add_schema(name, "jsonschema", schema.as_bytes())?;
            writer.add_channel(id, topic, "json", &BTreeMap::new())
        };
        let setup_channel = channel("vocaloco.Setup", SETUP, SETUP_SCHEMA).map_err(fault)?;
        let channel = channel("vocaloco.Decision", DECISION, DECISION_SCHEMA).map_err(fault)?;
        let mut log = Self { file: file.to_owned(), writer, channel, written: 0, text: Vec::new() };
        log.put(setup_channel, 0, setup)?;
        Ok(log)
    }

    /// Appends one tick.
    ///
    /// # Errors
    /// When the system does not take it.
    pub fn write(&mut self, decision: &Decision) -> Result<(), LogError> {
        let log_time = (decision.t_s * 1e9).round().max(0.0) as u64;
        self.put(self.channel, log_time, decision)?;
        if self.written.is_multiple_of(FLUSH_EVERY) {
            self.writer.flush().map_err(|source| container(&self.file, source))?;
        }
        Ok(())
    }

    /// Writes the index and closes the file.
    ///
    /// # Errors
    /// When the system does not take it.
    pub fn finish(mut self) -> Result<(), LogError> {
        self.writer.finish().map(drop).map_err(|source| container(&self.file, source))
    }

    fn put(&mut self, channel_id: u16, log_time: u64, message: &impl Serialize) -> Result<(), LogError> {
        self.text.clear();
        serde_json::to_writer(&mut self.text, message)
            .map_err(|error| container(&self.file, McapError::Io(error.into())))?;
        let header = MessageHeader { channel_id, sequence: self.written, log_time, publish_time: log_time };
        self.written += 1;
        self.writer
            .write_to_known_channel(&header, &self.text)
            .map_err(|source| container(&self.file, source))
    }
}

/// A log read back.
#[derive(Clone, Debug, PartialEq)]
pub struct DecisionLog {
    /// What the loop was configured with.
    pub setup: Setup,
    /// Every tick.
    pub decisions: Vec<Decision>,
    /// Why reading ended early, when the file ends in the middle of a record.
    pub truncated: Option<String>,
}

impl DecisionLog {
    /// Reads a whole log.
    ///
    /// # Errors
    /// The file cannot be read, is no MCAP, or holds other messages than this version writes.
    pub fn read(file: &Path) -> Result<Self, LogError> {
        let bytes = std::fs::read(file).map_err(|source| LogError::Io { file: file.to_owned(), source })?;
        let options = mcap::read::Options::IgnoreEndMagic.into();
        let stream = mcap::MessageStream::new_with_options(&bytes, options);
        let (mut setup, mut decisions, mut truncated) = (None, Vec::<Decision>::new(), None);
        for message in stream.map_err(|source| container(file, source))? {
            let message = match message {
                Ok(message) => message,
                // What a killed writer leaves behind is still worth explaining.
                Err(error) if setup.is_some() => {
                    truncated = Some(error.to_string());
                    break;
                }
                Err(source) => return Err(container(file, source)),
            };
            match message.channel.topic.as_str() {
                SETUP => setup = Some(parse(file, SETUP, &message.data)?),
                DECISION => decisions.push(parse(file, DECISION, &message.data)?),
                _ => {}
            }
        }
        let setup: Setup = setup.ok_or_else(|| wrong(file, SETUP, "no such message", "one at the start"))?;
        if setup.schema != SCHEMA {
            return Err(wrong(file, SETUP, format!("schema {}", setup.schema), format!("schema {SCHEMA}")));
        }
        // A file that is no log of ours must not make a sum of them overflow.
        let windows = [setup.switch_window, setup.stop_window, setup.resume_window];
        if let Some(window) = windows.into_iter().find(|window| !(1..=1000).contains(window)) {
            return Err(wrong(file, SETUP, format!("a window of {window} ticks"), "1 to 1000 ticks"));
        }
        let mut skills = setup.skills.len();
        for decision in &decisions {
            // From here on there are others.
            skills = decision.roster.as_ref().map_or(skills, Vec::len);
            if decision.skills.len() != skills {
                let found = format!("{} skills at tick {}", decision.skills.len(), decision.tick);
                return Err(wrong(file, DECISION, found, format!("{skills}, as said before")));
            }
        }
        Ok(Self { setup, decisions, truncated })
    }
}

fn parse<T: for<'de> Deserialize<'de>>(file: &Path, topic: &'static str, data: &[u8]) -> Result<T, LogError> {
    serde_json::from_slice(data).map_err(|error| wrong(file, topic, error, "a message of this version"))
}

fn wrong(
    file: &Path,
    topic: &'static str,
    found: impl std::fmt::Display,
    wanted: impl std::fmt::Display,
) -> LogError {
    LogError::Message { file: file.to_owned(), topic, found: found.to_string(), wanted: wanted.to_string() }
}

fn container(file: &Path, source: McapError) -> LogError {
    LogError::Container { file: file.to_owned(), source: Box::new(source) }
}

const SETUP_SCHEMA: &str = r#"{"title":"vocaloco.Setup","type":"object","properties":{
"schema":{"type":"integer"},"version":{"type":"string"},"deployment":{"type":"string"},"robot":{"type":"string"},
"backend":{"type":"string"},"rate_hz":{"type":"number"},"switch_window":{"type":"integer"},
"stop_window":{"type":"integer"},"resume_window":{"type":"integer"},"skills":{"type":"array","items":{"type":"object",
"properties":{"name":{"type":"string"},"viability_threshold":{"type":"number"},"hold_threshold":{"type":"number"},
"cost_margin":{"type":"number"},"position_target":{"type":"boolean"},
"forward_m_per_s":{"type":"array","items":{"type":"number"}}}}}}}"#;

const DECISION_SCHEMA: &str = r#"{"title":"vocaloco.Decision","type":"object","properties":{
"t_s":{"type":"number"},"tick":{"type":"integer"},"command":{"type":"array","items":{"type":"number"}},
"heightfield_hash":{"type":"string"},"field":{"type":"array","items":{"type":"number"}},
"skills":{"type":"array","items":{"type":"object","properties":{"name":{"type":"string"},
"viability":{"type":"number"},"cot":{"type":"number"},"strangeness":{"type":"number"},
"viable":{"type":"boolean"},
"reason":{"type":"object","properties":{"code":{"type":"string"}}}}}},
"choice":{"type":"string"},"active":{"type":"string"},"stopped":{"type":"boolean"},"forced":{"type":"string"},
"committed":{"type":"boolean"},"reason":{"type":"string"},"events":{"type":"array","items":{"type":"string"}},
"roster":{"type":"array","items":{"type":"object","properties":{"name":{"type":"string"},
"is_new":{"type":"boolean"},"viability_threshold":{"type":"number"},"hold_threshold":{"type":"number"},
"cost_margin":{"type":"number"},
"position_target":{"type":"boolean"},"forward_m_per_s":{"type":"array","items":{"type":"number"}}}}},
"timings":{"type":"object","properties":{"predict_us":{"type":"number"},"act_us":{"type":"number"},
"total_us":{"type":"number"}}}}}"#;
