//! A plugin's library: found on the plugin path, checked, loaded once in a process.
#![allow(unsafe_code, reason = "reads a symbol of a foreign library")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use abi_stable::library::{AbiHeaderRef, LibraryError, RootModule};
use abi_stable::std_types::RStr;
use sha2::{Digest, Sha256};
use vocaloco_plugin_api::abi::{LIBRARY_SYMBOL, SkillLibraryRef};
use vocaloco_plugin_api::{Description, INTERFACE_VERSION, RobotDescription, SkillError};

use super::instance::Instance;
#[cfg(target_os = "linux")]
use super::isolation::{ChildInstance, Program};
use super::{PluginError, PluginInstance, description, image};
use crate::manifest::{Finding, bytes_of};
use crate::policy::PolicyNetwork;

/// Whether a library, by its file and the bytes read from it, may be loaded.
pub type Admit<'a> = &'a dyn Fn(&Path, &[u8]) -> Result<(), Finding>;

/// A plugin, loaded until the process ends or, isolated, in a child process for each instance.
pub struct PluginLibrary {
    file: PathBuf,
    sha256: String,
    description: Description,
    code: Code,
}

/// Where a plugin's code is.
enum Code {
    /// Loaded into this process.
    Here(SkillLibraryRef),
    /// Loaded by a child process for each instance, and never by this one.
    #[cfg(target_os = "linux")]
    Child { program: Program, digest: [u8; 32] },
}

/// Largest library, bytes; one of a vendor's may bring a model runtime along.
const MAX_BYTES: u64 = 256 << 20;

type Loaded = BTreeMap<(PathBuf, [u8; 32]), Result<Arc<PluginLibrary>, PluginError>>;

/// Every library this process has loaded, by hash alone: what is not of this interface is not loaded twice either.
static LOADED: Mutex<Loaded> = Mutex::new(BTreeMap::new());
/// The same of those that describe themselves in a child process, which loads them from their file.
#[cfg(target_os = "linux")]
static ISOLATED: Mutex<Loaded> = Mutex::new(BTreeMap::new());

/// File name of the plugin `name` on this platform, such as `libgait.so`.
pub fn library_file_name(name: &str) -> String {
    format!("{}{name}{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX)
}

impl PluginLibrary {
    /// Loads the plugin `name` from the first folder of `search_path` that holds its library.
    ///
    /// # Errors
    /// There is none, its file is not whole, it is not of this interface, or it describes itself in a
    /// way that makes no sense.
    pub fn open(search_path: &[PathBuf], name: &str) -> Result<Arc<Self>, PluginError> {
        Self::open_if(search_path, name, &|_, _| Ok(()))
    }

    /// As [`open`](Self::open), with `admit` asked about the file and the bytes read from it before any
    /// of them runs.
    ///
    /// # Errors
    /// As [`open`](Self::open), and when `admit` refuses.
    pub fn open_if(search_path: &[PathBuf], name: &str, admit: Admit<'_>) -> Result<Arc<Self>, PluginError> {
        let file = Self::find(search_path, name)?;
        let (bytes, digest) = read(&file)?;
        admit(&file, &bytes).map_err(PluginError::Unlocked)?;
        Self::once(&LOADED, (PathBuf::new(), digest), &file, || Self::load(&file, &bytes, &digest))?
            .named(name, &file)
    }

    /// The plugin `name`, found as by [`open`](Self::open), to be run in child processes alone: nothing
    /// of it is loaded into this one. `admit` is asked as in [`open_if`](Self::open_if); the child loads
    /// bytes of the same hash or none.
    ///
    /// # Errors
    /// As [`open_if`](Self::open_if), and when the child cannot be started or ends; elsewhere than on
    /// Linux always.
    #[cfg(target_os = "linux")]
    pub fn open_isolated(
        search_path: &[PathBuf],
        name: &str,
        admit: Admit<'_>,
    ) -> Result<Arc<Self>, PluginError> {
        let file = Self::find(search_path, name)?;
        let (bytes, digest) = read(&file)?;
        admit(&file, &bytes).map_err(PluginError::Unlocked)?;
        let program = Program::find(search_path).map_err(PluginError::NotFound)?;
        let describe = || {
            let description = ChildInstance::describe(&program, &file, &digest)?;
            description::check(&file, &description).map_err(PluginError::Description)?;
            let code = Code::Child { program: program.clone(), digest };
            Ok(Self { file: file.clone(), sha256: hex(&digest), description, code })
        };
        Self::once(&ISOLATED, (file.clone(), digest), &file, describe)?.named(name, &file)
    }

    /// Elsewhere than on Linux plugins are not isolated.
    ///
    /// # Errors
    /// Always.
    #[cfg(not(target_os = "linux"))]
    pub fn open_isolated(
        search_path: &[PathBuf],
        name: &str,
        _admit: Admit<'_>,
    ) -> Result<Arc<Self>, PluginError> {
        let file = Self::find(search_path, name)?;
        let wanted = "\"none\" on this system";
        Err(PluginError::NotFound(Finding::new(&file, "isolation", "\"process\"", wanted)))
    }

    /// Loads the library at `file` into this process if its bytes have this hash.
    #[cfg(target_os = "linux")]
    pub(super) fn open_exactly(file: &Path, sha256: &[u8]) -> Result<Arc<Self>, PluginError> {
        let (bytes, digest) = read(file)?;
        if digest != sha256 {
            let wanted = format!("SHA-256 {}, as it was when the host read it", hex(sha256));
            return Err(PluginError::NotFound(Finding::new(file, "file", hex(&digest), wanted)));
        }
        Self::once(&LOADED, (PathBuf::new(), digest), file, || Self::load(file, &bytes, &digest))
    }

    /// What came, or comes now, of loading what `key` stands for.
    fn once(
        seen: &Mutex<Loaded>,
        key: (PathBuf, [u8; 32]),
        file: &Path,
        load: impl FnOnce() -> Result<Self, PluginError>,
    ) -> Result<Arc<Self>, PluginError> {
        // Held while loading: two threads must not load the same bytes twice.
        let mut seen = seen.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(library) = seen.get(&key) {
            return library.clone().map_err(|error| error.about(file));
        }
        let library = load().map(Arc::new);
        if !library.as_ref().is_err_and(PluginError::may_pass) {
            seen.insert(key, library.clone());
        }
        library
    }

    fn named(self: Arc<Self>, name: &str, file: &Path) -> Result<Arc<Self>, PluginError> {
        if self.description.name == name {
            return Ok(self);
        }
        let found = format!("{:?}", self.description.name.as_str());
        let wanted = format!("{name:?}, as the file is called");
        Err(PluginError::Description(Finding::new(file, "name", found, wanted)))
    }

    /// The library of the plugin `name` in the first folder of `search_path` that holds it.
    ///
    /// # Errors
    /// There is none.
    pub fn find(search_path: &[PathBuf], name: &str) -> Result<PathBuf, PluginError> {
        let file_name = library_file_name(name);
        let Some(file) = search_path.iter().map(|folder| folder.join(&file_name)).find(|file| file.is_file())
        else {
            let folders: Vec<_> = search_path.iter().map(|folder| folder.display().to_string()).collect();
            let wanted = format!("that file in {}", folders.join(" or "));
            return Err(PluginError::NotFound(Finding::new(
                Path::new(&file_name),
                "plugin",
                "no such file",
                wanted,
            )));
        };
        Ok(file)
    }

    fn load(file: &Path, bytes: &[u8], digest: &[u8; 32]) -> Result<Self, PluginError> {
        let finding = |field, found: &str, wanted: &str| Finding::new(file, field, found, wanted);
        #[cfg(all(target_os = "linux", target_pointer_width = "64"))]
        super::elf::check(bytes)
            .map_err(|(field, found, wanted)| PluginError::NotALibrary(finding(field, &found, &wanted)))?;
        let library = image::load(bytes).map_err(|error| {
            PluginError::NotALibrary(finding("library", &error, "a library that this system loads"))
        })?;
        // SAFETY: only the header's magic is read through it before `upgrade` has checked that, and a
        // header never changes its layout.
        let header = unsafe { library.get::<AbiHeaderRef>(LIBRARY_SYMBOL) }.map_err(|_| {
            let symbol =
                String::from_utf8_lossy(LIBRARY_SYMBOL.strip_suffix(b"\0").unwrap_or(LIBRARY_SYMBOL));
            let found = format!("no symbol {symbol}");
            let wanted = "a plugin that calls vocaloco_plugin_api::export_skill!";
            PluginError::ForeignInterface(finding("interface", &found, wanted))
        })?;
        let header = *header;
        let foreign =
            |found: String| PluginError::ForeignInterface(finding("interface", &found, &interface()));
        let header = header
            .upgrade()
            .map_err(|_| foreign("no header of this version of abi_stable, or another C ABI".to_owned()))?;
        let root = header.init_root_module::<SkillLibraryRef>().map_err(|error| {
            // abi_stable's own text of a layout mismatch has hundreds of lines.
            foreign(match error {
                LibraryError::IncompatibleVersionNumber { actual_version, .. } => {
                    format!("vocaloco-plugin-api {actual_version}")
                }
                LibraryError::AbiInstability(_) => {
                    let module = header.root_mod_consts();
                    let version = header.version_strings();
                    format!("{} {version} with types laid out otherwise", module.name())
                }
                _ => "a library that fails to start".to_owned(),
            })
        })?;
        if root.interface_version() != INTERFACE_VERSION {
            let found = format!("skill interface {}", root.interface_version());
            return Err(PluginError::ForeignInterface(finding("interface", &found, &interface())));
        }
        let description = (root.describe())().into_result().map_err(|error| {
            PluginError::Description(finding("describe", &error.message, "a description"))
        })?;
        description::check(file, &description).map_err(PluginError::Description)?;
        Ok(Self { file: file.to_owned(), sha256: hex(digest), description, code: Code::Here(root) })
    }

    /// What the plugin says of itself.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// SHA-256 of the bytes that were loaded, lowercase hex.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// The file it was loaded from.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// A new instance for `robot`, from the text of a parameter file, with no policy network.
    ///
    /// # Errors
    /// As [`create_with`](Self::create_with).
    pub fn create(
        self: &Arc<Self>,
        parameters: &str,
        robot: &RobotDescription,
    ) -> Result<PluginInstance, PluginError> {
        self.create_with(parameters, robot, None)
    }

    /// A new instance for `robot`, from the text of a parameter file or a contract, with a handle to
    /// `policy`.
    ///
    /// # Errors
    /// The plugin refuses the text or the robot, or the robot lacks a joint the plugin drives.
    pub fn create_with(
        self: &Arc<Self>,
        parameters: &str,
        robot: &RobotDescription,
        policy: Option<&PolicyNetwork>,
    ) -> Result<PluginInstance, PluginError> {
        for joint in &self.description.joints {
            if !robot.joints.iter().any(|known| known.name == *joint) {
                let wanted = format!("a joint of {}", robot.name);
                return Err(PluginError::Create(Finding::new(&self.file, "joints", joint, wanted)));
            }
        }
        let refused = |error: SkillError| {
            let wanted = format!("parameters and a robot that {} takes", self.description.name);
            PluginError::Create(Finding::new(&self.file, "parameters", &error.message, wanted))
        };
        let (instance, needs) = match &self.code {
            Code::Here(root) => {
                let policy = policy.map(PolicyNetwork::handle).into();
                let instance = (root.create())(RStr::from_str(parameters), robot, policy);
                let instance = instance.into_result().map_err(refused)?;
                let needs = instance.needs().into_result().map_err(refused)?;
                (Instance::Here(instance), needs)
            }
            #[cfg(target_os = "linux")]
            Code::Child { program, digest } => {
                let (child, needs) =
                    ChildInstance::create(program, &self.file, digest, parameters, robot, policy)?;
                (Instance::Child(Box::new(child)), needs)
            }
        };
        description::check_needs(&self.file, &needs).map_err(PluginError::Create)?;
        Ok(PluginInstance::new(Arc::clone(self), instance, needs, robot))
    }
}

/// A library's bytes and their SHA-256.
fn read(file: &Path) -> Result<(Vec<u8>, [u8; 32]), PluginError> {
    let wanted = format!("a readable file of at most {MAX_BYTES} bytes");
    let bytes = bytes_of(file, MAX_BYTES)
        .map_err(|found| PluginError::NotFound(Finding::new(file, "file", found, wanted)))?;
    let digest = Sha256::digest(&bytes).into();
    Ok((bytes, digest))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |hex, byte| format!("{hex}{byte:02x}"))
}

fn interface() -> String {
    let api = SkillLibraryRef::VERSION_STRINGS.version;
    format!("vocaloco-plugin-api {api} with skill interface {INTERFACE_VERSION}, as this host has it")
}

impl std::fmt::Debug for PluginLibrary {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "PluginLibrary({} {})", self.file.display(), self.sha256)
    }
}
