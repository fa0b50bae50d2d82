//! What a host offers a plugin: its own policy network, run by the host's one model code.

use abi_stable::sabi_trait::TD_Opaque;
use abi_stable::std_types::{ROption, RSlice, RSliceMut};

use crate::SkillError;
use crate::abi::{BoxedPolicy, PolicyModel, PolicyModel_TO};

/// What the host gives an instance at its creation.
#[derive(Default)]
pub struct Host {
    policy: Option<Policy>,
}

impl Host {
    /// A host that runs `model` as the instance's policy.
    pub fn with_policy(model: impl PolicyModel + 'static) -> Self {
        let policy = Policy(PolicyModel_TO::from_value(model, TD_Opaque));
        Self { policy: Some(policy) }
    }

    pub(crate) fn new(policy: ROption<BoxedPolicy>) -> Self {
        Self { policy: policy.into_option().map(Policy) }
    }

    /// The skill's policy network; none when its manifest names none.
    pub fn into_policy(self) -> Option<Policy> {
        self.policy
    }
}

/// A feed-forward policy network. Weights are shared by a skill's instances, the working memory is this
/// instance's own.
pub struct Policy(BoxedPolicy);

impl Policy {
    /// Number of values that go in.
    pub fn input_len(&self) -> usize {
        self.0.input_len()
    }

    /// Number of values that come out.
    pub fn output_len(&self) -> usize {
        self.0.output_len()
    }

    /// Runs the network: the same input gives the same bytes.
    ///
    /// # Errors
    /// Slices of other lengths, or the host's model code fails.
    pub fn run(&mut self, input: &[f32], output: &mut [f32]) -> Result<(), SkillError> {
        self.0.run(RSlice::from_slice(input), RSliceMut::from_mut_slice(output)).into_result()
    }
}
