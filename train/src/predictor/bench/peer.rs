//! The same fit in PyTorch, a Python process that reads its task from files of plain numbers.

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use serde::{Deserialize, Serialize};

use super::super::kernel::FieldCells;
use super::super::network::TENSORS;
use super::RATE;
use crate::files::write_whole;

/// What the process runs; see the text at its head for the files.
const SCRIPT: &str = include_str!("peer.py");

/// What both sides fit.
pub(super) struct Task<'a> {
    pub(super) fields: &'a [FieldCells],
    pub(super) labels: &'a [f32],
    /// Start values, flat.
    pub(super) start: &'a [f32],
    /// Rows of each epoch, in the order in which they are seen.
    pub(super) orders: &'a [Vec<usize>],
    pub(super) batch: usize,
}

/// The peer, timed.
#[derive(Serialize)]
pub(super) struct Peer {
    pub(super) name: String,
    pub(super) samples_per_s: f64,
    pub(super) losses: Vec<f64>,
}

/// What the peer came to.
pub(super) struct Theirs {
    pub(super) peer: Peer,
    /// Of the first batch, flat.
    pub(super) gradient: Vec<f32>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Answer {
    Fitted { version: String, seconds: f64, losses: Vec<f64> },
    Missing { missing: String },
}

/// Fits in `PyTorch`; nothing where the interpreter or the package is missing.
///
/// # Errors
/// The files cannot be written, or the process says something else.
pub(super) fn fit(python: &str, task: &Task<'_>, threads: usize) -> anyhow::Result<Option<Theirs>> {
    let folder = tempfile::tempdir()?;
    write(folder.path(), task)?;
    let shapes: Vec<&[usize]> = TENSORS.iter().map(|tensor| tensor.shape).collect();
    let question = serde_json::json!({
        "folder": folder.path(),
        "shapes": shapes,
        "batch": task.batch,
        "threads": threads,
        "learning_rate": RATE.learning_rate,
        "momentum": RATE.momentum,
    });
    let output = Command::new(python)
        .args(["-c", SCRIPT, &question.to_string()])
        .stdin(Stdio::null())
        .stderr(Stdio::inherit())
        .output();
    let output = match output {
        Ok(output) => output,
        Err(error) => {
            eprintln!("peer: none: {python}: {error}");
            return Ok(None);
        }
    };
    match serde_json::from_slice(&output.stdout) {
        Ok(Answer::Fitted { version, seconds, losses }) => {
            let samples: usize = task.orders.iter().map(Vec::len).sum();
            let peer =
                Peer { name: format!("PyTorch {version}"), samples_per_s: samples as f64 / seconds, losses };
            let gradient = std::fs::read(folder.path().join("gradient.f32"))?;
            let gradient: Vec<f32> =
                gradient.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
            ensure!(gradient.len() == task.start.len(), "gradient.f32: found {} values", gradient.len());
            Ok(Some(Theirs { peer, gradient }))
        }
        Ok(Answer::Missing { missing }) => {
            eprintln!("peer: none: {python}: {missing}");
            Ok(None)
        }
        Err(error) => Err(error).with_context(|| {
            let found = String::from_utf8_lossy(&output.stdout);
            format!("{python}: found {:?}, wanted its times", found.trim_end())
        }),
    }
}

fn write(folder: &Path, task: &Task<'_>) -> anyhow::Result<()> {
    let floats =
        |values: &mut dyn Iterator<Item = f32>| values.flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    write_whole(&folder.join("fields.f32"), &floats(&mut task.fields.iter().flatten().copied()))?;
    write_whole(&folder.join("labels.f32"), &floats(&mut task.labels.iter().copied()))?;
    write_whole(&folder.join("start.f32"), &floats(&mut task.start.iter().copied()))?;
    let rows = task.orders.iter().flatten().flat_map(|row| (*row as u64).to_le_bytes());
    write_whole(&folder.join("order.u64"), &rows.collect::<Vec<u8>>())
}
