//! The two small networks of a skill, viability and cost of transport, read from ONNX files.
//!
//! A file passes the guard before any model runtime sees it; what goes in and what comes out is
//! checked on every prediction, because runtimes differ in what they make of a NaN. The method's own
//! network is computed here, any other by the process's ONNX runtime.

pub(crate) mod backend;
mod evaluator;
mod fixed;
pub(crate) mod guard;
pub mod known_terrain;
#[cfg(test)]
pub(crate) mod network;
pub(crate) mod run;
#[cfg(test)]
mod tests;

use std::io::Read;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use thiserror::Error;

pub use backend::{Backend, backend};
pub(crate) use guard::MAX_BYTES as MAX_MODEL_BYTES;

use crate::heightfield::Field;
use crate::manifest::Finding;
use evaluator::Evaluator;
use guard::Fault;
use known_terrain::KnownTerrain;

/// What a predictor predicts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Probability that the skill gets ahead without a base collision, 0 to 1.
    Viability,
    /// Cost of transport, positive.
    Cot,
}

impl Quantity {
    /// Name of the model's output.
    pub const fn output(self) -> &'static str {
        match self {
            Self::Viability => "viability",
            Self::Cot => "cot",
        }
    }
}

/// Why a model was refused, or why its prediction cannot be used.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{0}")]
pub struct ModelError(pub Finding);

/// A predictor, ready to run; used by one thread at a time.
///
/// | | name | type | shape |
/// |---|---|---|---|
/// | input | `heightfield` | f32, m, centred | `[1, 1, 31, 11]`: rows back to front, columns left to right |
/// | output | `viability` or `cot` | f32 | `[1, 1]` |
pub struct Predictor {
    file: PathBuf,
    sha256: String,
    quantity: Quantity,
    evaluator: Evaluator,
    note: Option<String>,
    known: Option<KnownTerrain>,
}

impl std::fmt::Debug for Predictor {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "Predictor({} {})", self.file.display(), self.sha256)
    }
}

impl Predictor {
    /// Reads a model from a file.
    ///
    /// # Errors
    /// The file is missing, oversized, truncated or no network of this signature, or the backend
    /// does not take it.
    pub fn load(path: &Path, quantity: Quantity) -> Result<Self, ModelError> {
        let unreadable =
            |error: std::io::Error| ModelError(Finding::new(path, "file", error, "a readable model file"));
        let mut bytes = Vec::new();
        std::fs::File::open(path)
            .and_then(|file| file.take(guard::MAX_BYTES + 1).read_to_end(&mut bytes))
            .map_err(unreadable)?;
        Self::from_bytes(&bytes, path, quantity)
    }

    /// A model from the bytes of `file`, which is only named in errors.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn from_bytes(bytes: &[u8], file: &Path, quantity: Quantity) -> Result<Self, ModelError> {
        let refuse = |fault: Fault| ModelError(Finding::new(file, fault.field, fault.found, fault.wanted));
        let checked = guard::check(bytes, quantity).map_err(refuse)?;
        let known = checked.metadata.get(known_terrain::KEY);
        let known = known.map(|text| KnownTerrain::from_text(text)).transpose().map_err(refuse)?;
        // A model that cannot answer for flat ground is refused now rather than on the stairs.
        let (evaluator, note) =
            Evaluator::of(&checked.plain(quantity), &checked.graph, quantity).map_err(refuse)?;
        let sha256 = Sha256::digest(bytes).iter().fold(String::new(), |hex, byte| format!("{hex}{byte:02x}"));
        Ok(Self { file: file.to_owned(), sha256, quantity, evaluator, note, known })
    }

    /// The file that it was read from.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// What computes it: `own forward`, or the process's ONNX runtime by name.
    pub fn runs_on(&self) -> &'static str {
        self.evaluator.name()
    }

    /// Why a network of the method's shape is left to the ONNX runtime: the two disagree on it.
    pub fn note(&self) -> Option<&str> {
        self.note.as_deref()
    }

    /// SHA-256 of the file, lowercase hex.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// What it predicts.
    pub const fn quantity(&self) -> Quantity {
        self.quantity
    }

    /// How unlike the terrain that it was fitted to a field is: up to 1 it is known. None where the file
    /// says nothing of that terrain.
    pub fn strangeness(&self, field: &Field) -> Option<f32> {
        self.known.as_ref().map(|known| known.strangeness(field))
    }

    /// The prediction for a field.
    ///
    /// # Errors
    /// The backend fails, or the prediction is not finite or, for viability, not within 0 to 1.
    pub fn predict(&mut self, field: &Field) -> Result<f32, ModelError> {
        // A `Field` is finite by construction, so nothing but numbers goes in.
        let found = self
            .evaluator
            .run(field.as_slice(), self.quantity)
            .map_err(|fault| ModelError(Finding::new(&self.file, fault.field, fault.found, fault.wanted)))?;
        let (inside, wanted) = match self.quantity {
            Quantity::Viability => ((0.0..=1.0).contains(&found), "0 to 1"),
            Quantity::Cot => (found.is_finite(), "a finite number"),
        };
        if inside { Ok(found) } else { Err(self.error(found, wanted)) }
    }

    fn error(&self, found: impl std::fmt::Display, wanted: &str) -> ModelError {
        ModelError(Finding::new(&self.file, self.quantity.output(), found, wanted))
    }
}
