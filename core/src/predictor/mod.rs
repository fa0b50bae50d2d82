//! The two small networks of a skill, viability and cost of transport, read from ONNX files.
//!
//! A file passes the guard before any model runtime sees it; what goes in and what comes out is
//! checked on every prediction, because runtimes differ in what they make of a NaN.

pub(crate) mod backend;
pub(crate) mod guard;
#[cfg(test)]
pub(crate) mod network;
#[cfg(test)]
mod tests;

use std::io::Read;
use std::path::{Path, PathBuf};

use ort::session::Session;
use ort::value::Tensor;
use sha2::{Digest, Sha256};
use thiserror::Error;

pub use backend::{Backend, backend};
pub(crate) use guard::MAX_BYTES as MAX_MODEL_BYTES;

use crate::heightfield::{COLUMNS, Field, ROWS};
use crate::manifest::Finding;
use guard::Fault;

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
    session: Session,
    input: Tensor<f32>,
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
        guard::check(bytes, quantity).map_err(refuse)?;
        let backend_error = |error: ort::Error| {
            ModelError(Finding::new(file, "model", error, format!("a model that {} loads", backend().name)))
        };
        let session = backend::session(bytes).map_err(backend_error)?;
        let input = Tensor::from_array(([1_usize, 1, ROWS, COLUMNS], vec![0.0_f32; ROWS * COLUMNS]))
            .map_err(backend_error)?;
        let sha256 = Sha256::digest(bytes).iter().fold(String::new(), |hex, byte| format!("{hex}{byte:02x}"));
        let mut predictor = Self { file: file.to_owned(), sha256, quantity, session, input };
        // A model that cannot answer for flat ground is refused now rather than on the stairs.
        predictor.run()?;
        Ok(predictor)
    }

    /// SHA-256 of the file, lowercase hex.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// What it predicts.
    pub const fn quantity(&self) -> Quantity {
        self.quantity
    }

    /// The prediction for a field.
    ///
    /// # Errors
    /// The backend fails, or the prediction is not finite or, for viability, not within 0 to 1.
    pub fn predict(&mut self, field: &Field) -> Result<f32, ModelError> {
        // A `Field` is finite by construction, so nothing but numbers goes in.
        let (_, cells) = self.input.extract_tensor_mut();
        cells.copy_from_slice(field.as_slice());
        let found = self.run()?;
        let (inside, wanted) = match self.quantity {
            Quantity::Viability => ((0.0..=1.0).contains(&found), "0 to 1"),
            Quantity::Cot => (found.is_finite(), "a finite number"),
        };
        if inside { Ok(found) } else { Err(self.error(found, wanted)) }
    }

    fn run(&mut self) -> Result<f32, ModelError> {
        let outputs = match self.session.run(ort::inputs![guard::INPUT => &self.input]) {
            Ok(outputs) => outputs,
            Err(error) => {
                return Err(ModelError(Finding::new(&self.file, "model", error, "a model that runs")));
            }
        };
        let value = outputs.get(self.quantity.output()).map(|value| value.try_extract_tensor::<f32>());
        let found = match value {
            Some(Ok((shape, [value]))) if shape.len() == 2 => return Ok(*value),
            Some(Ok((shape, _))) => format!("{shape:?}"),
            Some(Err(error)) => error.to_string(),
            None => "no such output".to_owned(),
        };
        drop(outputs);
        Err(self.error(found, "f32 [1, 1]"))
    }

    fn error(&self, found: impl std::fmt::Display, wanted: &str) -> ModelError {
        ModelError(Finding::new(&self.file, self.quantity.output(), found, wanted))
    }
}
