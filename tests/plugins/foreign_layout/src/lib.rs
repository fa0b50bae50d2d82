//! A library whose root module has the right symbol and header but other types: what a plugin built
//! against a changed interface looks like to this host.
#![allow(
    unsafe_code,
    non_upper_case_globals,
    clippy::expl_impl_clone_on_copy,
    reason = "the exported symbol, and in what abi_stable's macros write"
)]

use abi_stable::StableAbi;
use abi_stable::library::{
    __call_root_module_loader, CheckTypeLayout, LibHeader, RootModule, RootModuleResult,
};
use abi_stable::package_version_strings;
use abi_stable::prefix_type::PrefixTypeTrait;
use abi_stable::sabi_types::VersionStrings;

/// Where the interface has its version, this has a float, and the rest is missing.
#[repr(C)]
#[derive(StableAbi)]
#[sabi(kind(Prefix(prefix_ref = SkillLibraryRef)))]
pub struct SkillLibrary {
    /// Of another type than the interface's.
    #[sabi(last_prefix_field)]
    pub interface_version: f64,
}

impl RootModule for SkillLibraryRef {
    abi_stable::declare_root_module_statics! {SkillLibraryRef}
    const BASE_NAME: &'static str = "vocaloco_skill";
    const NAME: &'static str = "vocaloco_skill";
    const VERSION_STRINGS: VersionStrings = package_version_strings!();
}

extern "C" fn root_module() -> RootModuleResult {
    fn load() -> SkillLibraryRef {
        SkillLibrary { interface_version: 1.0 }.leak_into_prefix()
    }
    __call_root_module_loader(load)
}

/// The symbol that the host looks for.
#[unsafe(no_mangle)]
pub static vocaloco_skill_library: LibHeader =
    // SAFETY: `root_module` returns the prefix of exactly this module type.
    unsafe { LibHeader::from_constructor::<SkillLibraryRef>(root_module, CheckTypeLayout::Yes) };
