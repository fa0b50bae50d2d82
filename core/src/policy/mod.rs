//! Policy networks, run for plugins: read once, guarded, shared by a skill's instances.
//!
//! Plain chains of layers are computed here, with the same bytes on every machine; what is no such
//! chain goes to the process's ONNX runtime. Which of the two it is depends on the file alone.

mod chain;
mod dense;
mod metadata;
mod proposal;
mod session;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use abi_stable::sabi_trait::TD_Opaque;
use abi_stable::std_types::{RResult, RSlice, RSliceMut};
use sha2::{Digest, Sha256};
use vocaloco_plugin_api::abi::{BoxedPolicy, PolicyModel, PolicyModel_TO};
use vocaloco_plugin_api::action::ActionMap;
use vocaloco_plugin_api::contract::Contract;
use vocaloco_plugin_api::observation::Observer;
use vocaloco_plugin_api::{ErrorCode, RobotDescription, SkillError};

use crate::manifest::Finding;
use crate::predictor::ModelError;
pub(crate) use crate::predictor::guard::MAX_POLICY_BYTES;
use crate::predictor::guard::{self, Fault};
use chain::Chain;
pub use proposal::{NoContract, Origin, Proposal, propose};
use session::SharedSession;

/// A policy network, ready to be run by any number of instances.
#[derive(Clone)]
pub struct PolicyNetwork(Arc<Shared>);

struct Shared {
    file: PathBuf,
    sha256: String,
    input_len: usize,
    output_len: usize,
    metadata: BTreeMap<String, String>,
    network: Network,
}

enum Network {
    Chain(Chain),
    Session(SharedSession),
}

impl PolicyNetwork {
    /// Reads a network from a file.
    ///
    /// # Errors
    /// The file is missing, oversized, truncated, recurrent or no network of one observation, or no
    /// runtime takes it.
    pub fn load(path: &Path) -> Result<Self, ModelError> {
        Self::from_bytes(&Self::read(path)?, path)
    }

    /// The bytes of a network's file, which are no larger than a network's may be.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read(path: &Path) -> Result<Vec<u8>, ModelError> {
        let unreadable =
            |error: std::io::Error| ModelError(Finding::new(path, "file", error, "a readable model file"));
        let mut bytes = Vec::new();
        std::fs::File::open(path)
            .and_then(|file| file.take(guard::MAX_POLICY_BYTES + 1).read_to_end(&mut bytes))
            .map_err(unreadable)?;
        Ok(bytes)
    }

    /// A network from the bytes of `file`, which is only named in errors.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn from_bytes(bytes: &[u8], file: &Path) -> Result<Self, ModelError> {
        let refuse = |fault: Fault| ModelError(Finding::new(file, fault.field, fault.found, fault.wanted));
        let policy = guard::check_policy(bytes).map_err(refuse)?;
        let network = match Chain::of(&policy) {
            Some(chain) => Network::Chain(chain),
            None => Network::Session(SharedSession::new(&policy).map_err(refuse)?),
        };
        let sha256 = Sha256::digest(bytes).iter().fold(String::new(), |hex, byte| format!("{hex}{byte:02x}"));
        let shared = Shared {
            file: file.to_owned(),
            sha256,
            input_len: policy.input.1,
            output_len: policy.output.1,
            metadata: policy.metadata,
            network,
        };
        let network = Self(Arc::new(shared));
        // A network that cannot answer for zeros is refused now rather than on the stairs.
        let mut output = vec![0.0; network.output_len()];
        Handle::new(&network).run_slices(&vec![0.0; network.input_len()], &mut output).map_err(|error| {
            ModelError(Finding::new(file, "model", error.message, "a network that runs on zeros"))
        })?;
        Ok(network)
    }

    /// The file that its bytes are from.
    pub(crate) fn file(&self) -> &Path {
        &self.0.file
    }

    /// SHA-256 of the file, lowercase hex.
    pub fn sha256(&self) -> &str {
        &self.0.sha256
    }

    /// Number of values that go in.
    pub fn input_len(&self) -> usize {
        self.0.input_len
    }

    /// Number of values that come out.
    pub fn output_len(&self) -> usize {
        self.0.output_len
    }

    /// Whether it is computed here, with the same bytes on every machine, and not by an ONNX runtime.
    pub fn is_portable(&self) -> bool {
        matches!(self.0.network, Network::Chain(_))
    }

    /// What the exporter wrote beside the network, by key.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.0.metadata
    }

    /// A handle for one instance: shared weights, working memory of its own.
    pub fn handle(&self) -> BoxedPolicy {
        PolicyModel_TO::from_value(Handle::new(self), TD_Opaque)
    }

    /// Where `contract`, a field of `file` that fits `robot`, and this network contradict each other.
    pub fn misfits(&self, file: &Path, contract: &Contract, robot: &RobotDescription) -> Vec<Finding> {
        let mut findings = Vec::new();
        let model = self.0.file.file_name().unwrap_or_default().display();
        if let Ok(observer) = Observer::new(contract, robot)
            && observer.len() != self.input_len()
        {
            let terms: Vec<_> =
                observer.layout().map(|(term, length)| format!("{} {length}", term.name())).collect();
            let found = format!("{} values ({})", observer.len(), terms.join(", "));
            let wanted = format!("{}, the input of {model}", self.input_len());
            findings.push(Finding::new(file, "contract.observation", found, wanted));
        }
        if let Ok(actions) = ActionMap::new(contract, robot)
            && actions.len() != self.output_len()
        {
            let found = format!("{} joints", actions.len());
            let wanted = format!("{}, the output of {model}", self.output_len());
            findings.push(Finding::new(file, "contract.joints", found, wanted));
        }
        findings.extend(metadata::contradictions(&self.0.metadata, contract).into_iter().map(|misfit| {
            let wanted = format!("{}, {} of {model}", misfit.wanted, misfit.key);
            Finding::new(file, format!("contract.{}", misfit.field), misfit.found, wanted)
        }));
        findings
    }
}

impl std::fmt::Debug for PolicyNetwork {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "PolicyNetwork({} {})", self.0.file.display(), self.0.sha256)
    }
}

/// One instance's end of a network.
struct Handle {
    network: PolicyNetwork,
    memory: Vec<f32>,
}

impl Handle {
    fn new(network: &PolicyNetwork) -> Self {
        let memory = match &network.0.network {
            Network::Chain(chain) => vec![0.0; chain.memory_len()],
            Network::Session(_) => Vec::new(),
        };
        Self { network: network.clone(), memory }
    }

    fn run_slices(&mut self, input: &[f32], output: &mut [f32]) -> Result<(), SkillError> {
        let shared = &self.network.0;
        for (what, found, wanted) in
            [("input", input.len(), shared.input_len), ("output", output.len(), shared.output_len)]
        {
            if found != wanted {
                let message = format!("policy {what}: found {found} values, wanted {wanted}");
                return Err(SkillError::new(ErrorCode::Input, message));
            }
        }
        // Runtimes differ in what they make of a NaN, and some hide it.
        if let Some(value) = input.iter().find(|value| !value.is_finite()) {
            let message = format!("policy input: found {value}, wanted a finite observation");
            return Err(SkillError::new(ErrorCode::Input, message));
        }
        match &shared.network {
            Network::Chain(chain) => chain.run(input, &mut self.memory, output),
            Network::Session(session) => {
                session.run(input, output).map_err(|error| SkillError::new(ErrorCode::Internal, error))?;
            }
        }
        if let Some(value) = output.iter().find(|value| !value.is_finite()) {
            let message = format!("policy output: found {value}, wanted finite actions");
            return Err(SkillError::new(ErrorCode::Internal, message));
        }
        Ok(())
    }
}

impl PolicyModel for Handle {
    fn input_len(&self) -> usize {
        self.network.input_len()
    }

    fn output_len(&self) -> usize {
        self.network.output_len()
    }

    fn run(&mut self, input: RSlice<'_, f32>, mut output: RSliceMut<'_, f32>) -> RResult<(), SkillError> {
        self.run_slices(input.as_slice(), output.as_mut_slice()).into()
    }
}
