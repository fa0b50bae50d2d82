//! A plugin with the right types that calls itself of another version of the interface.
#![allow(unsafe_code, non_upper_case_globals, reason = "the exported symbol")]

use vocaloco_plugin_api::abi::abi_stable::library::{
    __call_root_module_loader, CheckTypeLayout, LibHeader, RootModuleResult,
};
use vocaloco_plugin_api::abi::abi_stable::prefix_type::PrefixTypeTrait;
use vocaloco_plugin_api::abi::abi_stable::std_types::{ROption, RResult, RStr};
use vocaloco_plugin_api::abi::{BoxedInstance, BoxedPolicy, SkillLibrary, SkillLibraryRef};
use vocaloco_plugin_api::{Description, ErrorCode, INTERFACE_VERSION, RobotDescription, SkillError};

/// The host must not get as far as calling this.
extern "C" fn describe() -> RResult<Description, SkillError> {
    RResult::RErr(SkillError::new(ErrorCode::Internal, "called in spite of the version"))
}

/// Nor this.
extern "C" fn create(
    _: RStr<'_>,
    _: &RobotDescription,
    _: ROption<BoxedPolicy>,
) -> RResult<BoxedInstance, SkillError> {
    RResult::RErr(SkillError::new(ErrorCode::Internal, "called in spite of the version"))
}

extern "C" fn root_module() -> RootModuleResult {
    fn load() -> SkillLibraryRef {
        SkillLibrary { interface_version: INTERFACE_VERSION + 1, describe, create }.leak_into_prefix()
    }
    __call_root_module_loader(load)
}

/// The symbol that the host looks for.
#[unsafe(no_mangle)]
pub static vocaloco_skill_library: LibHeader =
    // SAFETY: `root_module` returns the prefix of exactly this module type.
    unsafe { LibHeader::from_constructor::<SkillLibraryRef>(root_module, CheckTypeLayout::Yes) };
