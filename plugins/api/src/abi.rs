//! The layer that names `abi_stable`'s machinery: the root module of a skill library, the trait
//! object of an instance, and the macro that exports both and stops panics at the border.
#![allow(
    unsafe_code,
    non_local_definitions,
    clippy::used_underscore_binding,
    clippy::expl_impl_clone_on_copy,
    reason = "in what abi_stable's macros write"
)]

use std::panic::{AssertUnwindSafe, catch_unwind};

pub use abi_stable;
use abi_stable::{
    StableAbi,
    library::RootModule,
    package_version_strings, sabi_trait,
    sabi_types::VersionStrings,
    std_types::{RBox, ROption, RResult, RSlice, RSliceMut, RStr},
};

use crate::{
    Command, Description, ErrorCode, Host, JointTarget, Needs, RobotDescription, RobotState, Skill,
    SkillError,
};

/// Symbol under which a skill library exports its root module.
pub const LIBRARY_SYMBOL: &[u8] = b"vocaloco_skill_library\0";

/// One instance, seen from the host.
#[sabi_trait]
pub trait Instance: Send {
    /// See [`Skill::reset`].
    fn reset(&mut self, state: &RobotState<'_>) -> RResult<(), SkillError>;
    /// See [`Skill::needs`].
    fn needs(&self) -> RResult<Needs, SkillError>;
    /// See [`Skill::act`].
    #[sabi(last_prefix_field)]
    fn act(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: RSliceMut<'_, JointTarget>,
    ) -> RResult<(), SkillError>;
}

/// An owned instance.
pub type BoxedInstance = Instance_TO<'static, RBox<()>>;

/// A policy network that the host runs, seen from the plugin; one to an instance.
#[sabi_trait]
pub trait PolicyModel: Send {
    /// Number of values that go in.
    fn input_len(&self) -> usize;
    /// Number of values that come out.
    fn output_len(&self) -> usize;
    /// Runs it, with slices of these lengths; the same input gives the same bytes.
    #[sabi(last_prefix_field)]
    fn run(&mut self, input: RSlice<'_, f32>, output: RSliceMut<'_, f32>) -> RResult<(), SkillError>;
}

/// An owned handle of a policy network.
pub type BoxedPolicy = PolicyModel_TO<'static, RBox<()>>;

/// The root module of a skill library.
#[repr(C)]
#[derive(StableAbi)]
#[sabi(kind(Prefix(prefix_ref = SkillLibraryRef)))]
#[sabi(missing_field(panic))]
pub struct SkillLibrary {
    /// [`INTERFACE_VERSION`](crate::INTERFACE_VERSION) that the plugin was built against.
    pub interface_version: u32,
    /// See [`Skill::describe`].
    pub describe: extern "C" fn() -> RResult<Description, SkillError>,
    /// See [`Skill::create`].
    #[sabi(last_prefix_field)]
    pub create: extern "C" fn(
        RStr<'_>,
        &RobotDescription,
        ROption<BoxedPolicy>,
    ) -> RResult<BoxedInstance, SkillError>,
}

impl RootModule for SkillLibraryRef {
    abi_stable::declare_root_module_statics! {SkillLibraryRef}
    const BASE_NAME: &'static str = "vocaloco_skill";
    const NAME: &'static str = "vocaloco_skill";
    const VERSION_STRINGS: VersionStrings = package_version_strings!();
}

/// Runs plugin code and turns a panic into an error, so that none crosses the border.
fn fenced<T>(call: &str, run: impl FnOnce() -> Result<T, SkillError>) -> RResult<T, SkillError> {
    match catch_unwind(AssertUnwindSafe(run)) {
        Ok(result) => result.into(),
        Err(panic) => {
            let text = panic
                .downcast_ref::<String>()
                .map(String::as_str)
                .or_else(|| panic.downcast_ref::<&str>().copied())
                .unwrap_or("no message");
            RResult::RErr(SkillError::new(ErrorCode::Panic, format!("{call} panicked: {text}")))
        }
    }
}

struct Fence<S>(S);

impl<S: Skill> Instance for Fence<S> {
    fn reset(&mut self, state: &RobotState<'_>) -> RResult<(), SkillError> {
        fenced("reset", || self.0.reset(state))
    }

    fn needs(&self) -> RResult<Needs, SkillError> {
        fenced("needs", || Ok(self.0.needs()))
    }

    fn act(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: RSliceMut<'_, JointTarget>,
    ) -> RResult<(), SkillError> {
        fenced("act", || self.0.act(state, command, joints.into_mut_slice()))
    }
}

/// `describe` of the exported plugin `S`.
pub extern "C" fn describe<S: Skill>() -> RResult<Description, SkillError> {
    fenced("describe", || Ok(S::describe()))
}

/// `create` of the exported plugin `S`.
pub extern "C" fn create<S: Skill>(
    parameters: RStr<'_>,
    robot: &RobotDescription,
    policy: ROption<BoxedPolicy>,
) -> RResult<BoxedInstance, SkillError> {
    fenced("create", || {
        let skill = S::create(parameters.as_str(), robot, Host::new(policy))?;
        Ok(Instance_TO::from_value(Fence(skill), abi_stable::sabi_trait::TD_Opaque))
    })
}

/// The root module of the plugin `S`.
pub fn library<S: Skill>() -> SkillLibraryRef {
    use abi_stable::prefix_type::PrefixTypeTrait;
    SkillLibrary { interface_version: crate::INTERFACE_VERSION, describe: describe::<S>, create: create::<S> }
        .leak_into_prefix()
}

/// Exports a [`Skill`] as the plugin of this library; panics in it come back as errors.
///
/// `abi_stable`'s own attribute writes `#[no_mangle]`, which the 2024 edition refuses; this is the
/// same header under our own symbol.
#[macro_export]
macro_rules! export_skill {
    ($skill:ident) => {
        #[doc(hidden)]
        #[allow(unsafe_code, non_upper_case_globals, missing_docs, reason = "the exported symbol")]
        mod vocaloco_export {
            use $crate::abi::abi_stable::library::{
                __call_root_module_loader, CheckTypeLayout, LibHeader, RootModuleResult,
            };

            extern "C" fn root_module() -> RootModuleResult {
                fn load() -> $crate::abi::SkillLibraryRef {
                    $crate::abi::library::<super::$skill>()
                }
                __call_root_module_loader(load)
            }

            #[unsafe(no_mangle)]
            pub static vocaloco_skill_library: LibHeader = unsafe {
                // SAFETY: `root_module` returns the prefix of exactly this module type.
                LibHeader::from_constructor::<$crate::abi::SkillLibraryRef>(root_module, CheckTypeLayout::Yes)
            };
        }
    };
}
