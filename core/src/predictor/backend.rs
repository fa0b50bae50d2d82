//! The one ONNX runtime of the process: a real ONNX Runtime where its library is found, the built-in
//! tract otherwise. Chosen once, capped at one thread, and named in every report.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::path::PathBuf;
use std::sync::OnceLock;

use ort::environment::{Environment, EnvironmentBuilder};
use ort::session::Session;

/// Which runtime runs the models.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Backend {
    /// `onnxruntime` or `tract`.
    pub name: &'static str,
    /// Its version.
    pub version: String,
    /// Why a library that was asked for or found is not used.
    pub note: Option<String>,
}

struct Chosen {
    backend: Backend,
    environment: Result<Environment, String>,
}

static CHOSEN: OnceLock<Chosen> = OnceLock::new();

/// The runtime of this process.
///
/// `ORT_DYLIB_PATH` names a library of ONNX Runtime 1.24 or later; set but empty it asks for the
/// built-in backend. Without it the platform's usual name is looked for beside the executable and on
/// the loader's path.
pub fn backend() -> &'static Backend {
    &chosen().backend
}

/// A session on one thread.
pub(super) fn session(model: &[u8]) -> Result<Session, ort::Error> {
    let chosen = chosen();
    let environment = chosen.environment.as_ref().map_err(ort::Error::new)?;
    let mut builder = Session::builder(environment)?;
    // tract runs on the caller's thread and knows none of these.
    if chosen.backend.name == ONNX_RUNTIME {
        builder = builder
            .with_intra_threads(1)
            .and_then(|builder| builder.with_inter_threads(1))
            .and_then(|builder| builder.with_intra_op_spinning(false))
            .map_err(|error| ort::Error::new(error.to_string()))?;
    }
    builder.commit_from_memory(model)
}

const ONNX_RUNTIME: &str = "onnxruntime";

fn chosen() -> &'static Chosen {
    CHOSEN.get_or_init(|| {
        // One attempt only: after a failed `init_from` a second one of this `ort` reports success.
        let note = match library().map(ort::init_from) {
            Some(Ok(builder)) => return choose(builder, ONNX_RUNTIME, None),
            Some(Err(ort::LoadDynamicError::Dlopen { .. })) if std::env::var_os(VARIABLE).is_none() => None,
            Some(Err(error)) => Some(error.to_string().replace('\n', " ")),
            None => None,
        };
        ort::set_api(ort_tract::api());
        choose(ort::init(), "tract", note)
    })
}

fn choose(builder: EnvironmentBuilder, name: &'static str, note: Option<String>) -> Chosen {
    let environment = builder.with_name("vocaloco").with_telemetry(false).build();
    let environment = environment.map_err(|error| error.to_string());
    Chosen { backend: Backend { name, version: version(ort::info()), note }, environment }
}

const VARIABLE: &str = "ORT_DYLIB_PATH";

/// The library to try; none when the built-in backend is asked for.
fn library() -> Option<PathBuf> {
    match std::env::var_os(VARIABLE) {
        Some(path) => (!path.is_empty()).then(|| path.into()),
        // A bare name is looked for beside the executable first, then by the loader.
        None => Some(format!("{DLL_PREFIX}onnxruntime{DLL_SUFFIX}").into()),
    }
}

/// The version in a build-info line, such as `… version=1.2.3` or `git-branch=rel-1.24.0, …`.
fn version(info: &str) -> String {
    ["version=", "git-branch=rel-", "git-branch="]
        .iter()
        .find_map(|key| info.split_once(key))
        .map_or(info, |(_, rest)| rest.split([',', ' ']).next().unwrap_or(rest))
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::version;

    #[test]
    fn the_version_is_read_from_either_runtimes_build_info() {
        let real = "ORT Build Info: git-branch=rel-1.24.0, git-commit-id=26250ae, build type=Release";
        assert_eq!(version(real), "1.24.0");
        assert_eq!(version("ORT Build Info: backend=ort-tract, version=0.5.0+0.23"), "0.5.0+0.23");
    }
}
