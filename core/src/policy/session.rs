//! A network that is no plain chain, run by the process's ONNX runtime.

use std::sync::{Mutex, PoisonError};

use ort::session::Session;
use ort::value::Tensor;

use crate::predictor::backend::{backend, session};
use crate::predictor::guard::{Fault, PolicyFile};
use crate::predictor::run::run;

/// A session that instances take turns with: a runtime's own is not to be shared.
pub(super) struct SharedSession {
    running: Mutex<(Session, Tensor<f32>)>,
    input: String,
    output: String,
}

impl SharedSession {
    pub(super) fn new(policy: &PolicyFile) -> Result<Self, Fault> {
        let fault =
            |error: ort::Error| Fault::new("model", error, format!("a model that {} loads", backend().name));
        let session = session(&policy.plain()).map_err(fault)?;
        let input = Tensor::from_array(([1_usize, policy.input.1], vec![0.0_f32; policy.input.1]));
        Ok(Self {
            running: Mutex::new((session, input.map_err(fault)?)),
            input: policy.input.0.clone(),
            output: policy.output.0.clone(),
        })
    }

    /// Runs the model; the slices have its lengths.
    pub(super) fn run(&self, input: &[f32], output: &mut [f32]) -> Result<(), String> {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        let (session, tensor) = &mut *running;
        let (_, values) = tensor.extract_tensor_mut();
        values.copy_from_slice(input);
        let wanted = output.len();
        let found = run(session, (&self.input, tensor), &self.output, |_, found| {
            if found.len() == wanted {
                output.copy_from_slice(found);
            }
            found.len()
        });
        match found.map_err(|error| format!("model: {error}"))? {
            Some(found) if found == wanted => Ok(()),
            Some(found) => Err(format!("{}: found {found} values, wanted {wanted}", self.output)),
            None => Err(format!("no output {}", self.output)),
        }
    }
}
