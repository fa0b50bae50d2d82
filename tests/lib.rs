//! What the promises across crates share: the built plugins and throw-away installations.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

mod installation;
mod model;
mod snapshot;
mod standing_line;
mod walking;

pub use installation::Fixture;
pub use model::{
    PolicyModel, constant_model, constant_model_of_shape, overflowing_model, overflowing_policy,
};
pub use snapshot::snapshot;
pub use standing_line::standing_line;
pub use walking::{Says, Walking};

/// The folder with the libraries of all plugins, the shipped ones and those that misbehave for tests;
/// built on the first call.
///
/// # Panics
/// When they do not build.
pub fn plugin_folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        vocaloco_dev::build_plugins(&["plugins", "tests/plugins"], &["vocaloco"]).expect("the plugins build")
    })
}

/// The repository.
pub fn repository() -> PathBuf {
    vocaloco_dev::workspace_root()
}

/// The installation in the repository itself: what is shipped.
pub fn shipped() -> vocaloco_core::installation::Installation {
    vocaloco_core::installation::Installation {
        root: repository(),
        plugin_path: vec![plugin_folder().to_owned()],
    }
}
