//! A network that is no plain chain, run by the process's ONNX runtime.

use std::sync::{Mutex, PoisonError};

use ort::session::Session;
use ort::value::Tensor;

use crate::predictor::backend::{backend, session};
use crate::predictor::guard::{Fault, PolicyFile};

/// A session that instances take turns with: a runtime's own is not to be shared.
pub(super) struct SharedSession {
    running: Mutex<(Session, Tensor<f32>)>,
    input: String,
    output: String,
}

impl SharedSession {
    pub(super) fn new(bytes: &[u8], policy: &PolicyFile) -> Result<Self, Fault> {
        let fault =
            |error: ort::Error| Fault::new("model", error, format!("a model that {} loads", backend().name));
        let session = session(bytes).map_err(fault)?;
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
        let outputs = session
            .run(ort::inputs![self.input.as_str() => &*tensor])
            .map_err(|error| format!("model: {error}"))?;
        let found = outputs.get(self.output.as_str()).ok_or_else(|| format!("no output {}", self.output))?;
        let (_, found) = found.try_extract_tensor::<f32>().map_err(|error| error.to_string())?;
        if found.len() != output.len() {
            return Err(format!("{}: found {} values, wanted {}", self.output, found.len(), output.len()));
        }
        output.copy_from_slice(found);
        Ok(())
    }
}
