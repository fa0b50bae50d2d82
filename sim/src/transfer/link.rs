//! Lines of JSON to a process and back, a question and an answer at a time.

use std::{
    io::{BufRead, BufReader, Write},
    process::{Child, Command, Stdio},
};

use serde::{Serialize, de::DeserializeOwned};

use super::TransferError;

/// What the process runs; see the text at its head for the lines.
const SCRIPT: &str = include_str!("mujoco_plant.py");

/// The two ends of a conversation.
pub(super) struct Link {
    to: Option<Box<dyn Write + Send>>,
    from: Box<dyn BufRead + Send>,
    child: Option<Child>,
    python: String,
}

/// What any question may be answered with instead.
#[derive(serde::Deserialize)]
#[serde(rename_all = "snake_case")]
enum Trouble {
    Missing(String),
    Error(String),
}

impl Link {
    /// Starts `python` on the script.
    pub(super) fn start(python: &str) -> Result<Self, TransferError> {
        let no_interpreter = |error: std::io::Error| TransferError::NoInterpreter {
            python: python.to_owned(),
            reason: error.to_string(),
        };
        let mut child = Command::new(python)
            .args(["-c", SCRIPT])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(no_interpreter)?;
        let (Some(to), Some(from)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(no_interpreter(std::io::ErrorKind::BrokenPipe.into()));
        };
        let mut link = Self::between(Box::new(to), Box::new(BufReader::new(from)), python);
        link.child = Some(child);
        Ok(link)
    }

    /// A conversation over any two streams.
    pub(super) fn between(to: Box<dyn Write + Send>, from: Box<dyn BufRead + Send>, python: &str) -> Self {
        Self { to: Some(to), from, child: None, python: python.to_owned() }
    }

    /// Asks and waits for the answer.
    pub(super) fn ask<A: DeserializeOwned>(
        &mut self,
        action: &'static str,
        question: &impl Serialize,
    ) -> Result<A, TransferError> {
        let out_of_turn = |found: String| TransferError::OutOfTurn { action, found };
        let mut line = serde_json::to_string(question).map_err(|error| out_of_turn(error.to_string()))?;
        line.push('\n');
        if let Some(to) = &mut self.to {
            // A process that has ended says why in its last line, which is still there to be read.
            let _gone = to.write_all(line.as_bytes()).and_then(|()| to.flush());
        }
        line.clear();
        let read = self.from.read_line(&mut line).map_err(|error| out_of_turn(error.to_string()))?;
        if read == 0 {
            return Err(out_of_turn("its end".to_owned()));
        }
        match serde_json::from_str(&line) {
            Ok(Trouble::Missing(missing)) => {
                return Err(TransferError::NoMujoco { python: self.python.clone(), missing });
            }
            Ok(Trouble::Error(message)) => return Err(TransferError::Refused { action, message }),
            Err(_) => {}
        }
        serde_json::from_str(&line).map_err(|error| out_of_turn(format!("{:?} ({error})", line.trim_end())))
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        // The end of its stdin ends the process.
        self.to = None;
        if let Some(child) = &mut self.child {
            let _status = child.wait();
        }
    }
}
