//! What computes a predictor: our own forward where the network is the method's, the process's ONNX
//! runtime otherwise. The two are held against each other when a file is loaded.

use ort::session::Session;
use ort::value::Tensor;
use tract_onnx::pb;

use super::fixed::FixedNetwork;
use super::guard::{self, Fault};
use super::run::run;
use super::{Quantity, backend};
use crate::heightfield::{CELLS, COLUMNS, ROWS};

/// How far our forward may be from the runtime's: this much, and this share of the runtime's answer.
///
/// Sums in another order move an answer by about 1e-6, the weights that ours keeps in two bytes by up to
/// some 2e-5.
pub(super) const TOLERANCE: f32 = 1e-4;
/// Fields on which the two are compared when a file is loaded.
const PROBES: usize = 8;

/// Computes one network.
pub(super) enum Evaluator {
    /// Our own forward, the same bytes on every machine.
    Fixed(Box<FixedNetwork>),
    /// Whatever else passes the guard.
    Runtime(Runtime),
}

/// A network in the process's ONNX runtime.
pub(super) struct Runtime {
    session: Session,
    input: Tensor<f32>,
}

impl Evaluator {
    /// What computes the network of a guarded file, and why not our forward when it has its shape.
    ///
    /// # Errors
    /// The runtime does not take the file, or does not answer.
    pub(super) fn of(
        bytes: &[u8],
        graph: &pb::GraphProto,
        quantity: Quantity,
    ) -> Result<(Self, Option<String>), Fault> {
        let mut runtime = Runtime::new(bytes)?;
        let fixed = FixedNetwork::of(graph, guard::INPUT, quantity.output());
        let Some(fixed) = fixed.filter(|_| FixedNetwork::is_fast_here()) else {
            runtime.run(&[0.0; CELLS], quantity)?;
            return Ok((Self::Runtime(runtime), None));
        };
        for probe in 0..PROBES {
            let cells = probe_cells(probe);
            let (ours, theirs) = (fixed.run(&cells), runtime.run(&cells, quantity)?);
            if !agree(ours, theirs) {
                let note = format!(
                    "{} for probe {probe}: found {ours} by our forward and {theirs} by {}, wanted the same \
                     within {TOLERANCE}; {} computes it",
                    quantity.output(),
                    backend().name,
                    backend().name
                );
                return Ok((Self::Runtime(runtime), Some(note)));
            }
        }
        Ok((Self::Fixed(Box::new(fixed)), None))
    }

    pub(super) fn name(&self) -> &'static str {
        match self {
            Self::Fixed(_) => "own forward",
            Self::Runtime(_) => backend().name,
        }
    }

    /// The output for one field.
    ///
    /// # Errors
    /// The runtime fails, or gives something other than one number.
    pub(super) fn run(&mut self, cells: &[f32; CELLS], quantity: Quantity) -> Result<f32, Fault> {
        match self {
            Self::Fixed(network) => Ok(network.run(cells)),
            Self::Runtime(runtime) => runtime.run(cells, quantity),
        }
    }
}

impl Runtime {
    fn new(bytes: &[u8]) -> Result<Self, Fault> {
        let wanted =
            |error: ort::Error| Fault::new("model", error, format!("a model that {} loads", backend().name));
        let session = backend::session(bytes).map_err(wanted)?;
        let input =
            Tensor::from_array(([1_usize, 1, ROWS, COLUMNS], vec![0.0_f32; CELLS])).map_err(wanted)?;
        Ok(Self { session, input })
    }

    fn run(&mut self, cells: &[f32; CELLS], quantity: Quantity) -> Result<f32, Fault> {
        let (_, input) = self.input.extract_tensor_mut();
        input.copy_from_slice(cells);
        let read = |shape: &[i64], values: &[f32]| match values {
            [value] if shape.len() == 2 => Ok(*value),
            _ => Err(format!("{shape:?}")),
        };
        let found = run(&mut self.session, (guard::INPUT, &self.input), quantity.output(), read)
            .map_err(|error| Fault::new("model", error, "a model that runs"))?;
        let found = match found {
            Some(Ok(value)) => return Ok(value),
            Some(Err(shape)) => shape,
            None => "no such output".to_owned(),
        };
        Err(Fault::new(quantity.output(), found, "f32 [1, 1]"))
    }
}

/// Whether two answers are the same but for rounding; two overflows are as well.
fn agree(ours: f32, theirs: f32) -> bool {
    let within = (ours - theirs).abs() <= TOLERANCE * theirs.abs().max(1.0);
    within || ours.is_finite() == theirs.is_finite() && !ours.is_finite()
}

/// Flat ground, then steps of other heights at other places with ever more roughness, ±1 m at the end:
/// no two cells alike, so that a swapped axis or a shifted border cannot agree.
pub(super) fn probe_cells(probe: usize) -> [f32; CELLS] {
    let mut state = probe as u32;
    std::array::from_fn(|cell| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let rough = (state >> 8) as f32 / 8_388_608.0 - 1.0;
        let share = probe as f32 / (PROBES - 1) as f32;
        let step = 0.07 * share * (cell / COLUMNS / (2 + probe)) as f32;
        (step - 0.1 * share * (cell % COLUMNS) as f32 / COLUMNS as f32 + share * share * rough)
            .clamp(-1.0, 1.0)
    })
}
