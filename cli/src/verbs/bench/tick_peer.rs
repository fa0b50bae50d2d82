//! The networks of a tick in Python's onnxruntime, beside which ours are told.

use std::io::Write;
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use serde::{Deserialize, Serialize};
use vocaloco_core::heightfield::Field;
use vocaloco_core::predictor::Predictor;
use vocaloco_core::registry::LoadedSkill;

/// What the process runs; see the text at its head for the lines.
const SCRIPT: &str = include_str!("tick_peer.py");
/// How far the peer's answers may be from ours: this much, and this share of ours.
const TOLERANCE: f64 = 1e-4;

/// The peer, timed.
#[derive(Serialize)]
pub(super) struct Peer {
    /// Its name and version.
    pub(super) name: String,
    /// Half of the rounds, in which it runs the networks alone, take no longer than this.
    pub(super) p50_us: f64,
    /// Largest difference of an answer from ours.
    pub(super) largest_difference: f64,
}

#[derive(Serialize)]
struct Question<'a> {
    models: Vec<&'a std::path::Path>,
    field: &'a [f32],
    rounds: usize,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Answer {
    Timed { version: String, p50_us: f64, answers: Vec<f64> },
    Missing { missing: String },
}

/// Times all networks of `skills` on one field; nothing where the interpreter or the package is missing.
///
/// # Errors
/// The process says something else, or answers otherwise than ours do.
pub(super) fn time(
    python: &str,
    skills: &mut [LoadedSkill],
    field: &Field,
    rounds: usize,
) -> anyhow::Result<Option<Peer>> {
    let mut predictors: Vec<&mut Predictor> =
        skills.iter_mut().flat_map(|skill| skill.viability.iter_mut().chain(&mut skill.cot)).collect();
    let ours = predictors.iter_mut().map(|predictor| predictor.predict(field));
    let ours = ours.collect::<Result<Vec<f32>, _>>()?;
    let models = predictors.iter().map(|predictor| predictor.file()).collect();
    let question = serde_json::to_string(&Question { models, field: field.as_slice(), rounds })?;
    let Some(line) = ask(python, &question)? else { return Ok(None) };
    match serde_json::from_slice(&line) {
        Ok(Answer::Timed { version, p50_us, answers }) => {
            let differences = answers
                .iter()
                .zip(&ours)
                .map(|(theirs, &ours)| ((theirs - f64::from(ours)).abs(), f64::from(ours).abs().max(1.0)));
            let within = differences.clone().all(|(difference, scale)| difference <= TOLERANCE * scale);
            let largest_difference = differences.map(|(difference, _)| difference).fold(0.0, f64::max);
            ensure!(
                within && answers.len() == ours.len(),
                "{python}: found answers up to {largest_difference} away from ours, wanted {TOLERANCE}"
            );
            Ok(Some(Peer { name: format!("onnxruntime {version} in Python"), p50_us, largest_difference }))
        }
        Ok(Answer::Missing { missing }) => {
            eprintln!("peer: none: {python}: {missing}");
            Ok(None)
        }
        Err(error) => Err(error).with_context(|| {
            format!("{python}: found {:?}, wanted its times", String::from_utf8_lossy(&line).trim_end())
        }),
    }
}

fn ask(python: &str, question: &str) -> anyhow::Result<Option<Vec<u8>>> {
    let started =
        Command::new(python).args(["-c", SCRIPT]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
    let mut child = match started {
        Ok(child) => child,
        Err(error) => {
            eprintln!("peer: none: {python}: {error}");
            return Ok(None);
        }
    };
    if let Some(mut stdin) = child.stdin.take() {
        // A process that has ended says why on stderr.
        let _gone = stdin.write_all(question.as_bytes()).and_then(|()| stdin.write_all(b"\n"));
    }
    Ok(Some(child.wait_with_output()?.stdout))
}
