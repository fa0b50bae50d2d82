//! The one ONNX runtime of the process: a real ONNX Runtime where its library is found, the built-in
//! tract otherwise. Chosen once, capped at one thread, and named in every report.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::ffi::CStr;
use std::path::{Path, PathBuf};
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
pub(crate) fn session(model: &[u8]) -> Result<Session, ort::Error> {
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
        let library = library();
        // One attempt only: after a failed `init_from` a second one of this `ort` reports success.
        let note = match library.as_ref().map(ort::init_from) {
            Some(Ok(builder)) => {
                return choose(builder, ONNX_RUNTIME, library_version(library.as_deref()), None);
            }
            Some(Err(ort::LoadDynamicError::Dlopen { .. })) if std::env::var_os(VARIABLE).is_none() => None,
            Some(Err(error)) => Some(error.to_string().replace('\n', " ")),
            None => None,
        };
        ort::set_api(ort_tract::api());
        let info = ort::info();
        let version = info.split_once("version=").map_or(info, |(_, version)| version);
        choose(ort::init(), "tract", version.to_owned(), note)
    })
}

fn choose(builder: EnvironmentBuilder, name: &'static str, version: String, note: Option<String>) -> Chosen {
    let environment = builder.with_name("vocaloco").with_telemetry(false).build();
    let environment = environment.map_err(|error| error.to_string());
    Chosen { backend: Backend { name, version, note }, environment }
}

const VARIABLE: &str = "ORT_DYLIB_PATH";

/// The library to try; none when the built-in backend is asked for.
fn library() -> Option<PathBuf> {
    if let Some(path) = std::env::var_os(VARIABLE) {
        return (!path.is_empty()).then(|| path.into());
    }
    let name = PathBuf::from(format!("{DLL_PREFIX}onnxruntime{DLL_SUFFIX}"));
    let executable = std::env::current_exe().ok();
    let beside = executable.and_then(|executable| Some(executable.parent()?.join(&name)));
    // A bare name is for the loader to find.
    Some(beside.filter(|path| path.is_file()).unwrap_or(name))
}

/// The version of a library that `ort` has just loaded; its build information names only a branch.
#[allow(unsafe_code, reason = "asks the loaded model runtime for its version")]
fn library_version(library: Option<&Path>) -> String {
    type GetApiBase = unsafe extern "C" fn() -> *const ort::sys::OrtApiBase;
    let asked = library.and_then(|path| {
        // SAFETY: `ort` has loaded the same library and called the same function a moment ago, so
        // opening it runs no code and the types are those that `ort` relies on.
        unsafe {
            let library = libloading::Library::new(path).ok()?;
            let base = (library.get::<GetApiBase>(b"OrtGetApiBase\0").ok()?)().as_ref()?;
            let version = (base.GetVersionString)();
            Some(CStr::from_ptr(version).to_string_lossy().into_owned())
        }
    });
    asked.unwrap_or_else(|| "of unknown version".to_owned())
}
