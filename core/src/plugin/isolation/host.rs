//! The child's side: loads one library, makes one instance, answers calls until the host is gone.

use std::fs::File;
use std::io::{self, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::Arc;

use vocaloco_plugin_api::SkillError;

use super::frame::{Call, CallBuffer, NO_CALL, read_call, write_answer};
use super::limits::{self, GROWTH_BYTES, LOADING_BYTES};
use super::memory::SharedMemory;
use super::message::{Create, Description, Needs, Refused, Start, Started, Trial, bytes_of, path_of};
use super::wire;
use crate::installation::Installation;
use crate::lock::{Lock, sha256_hex};
use crate::manifest::Finding;
use crate::plugin::{PluginError, PluginInstance, PluginLibrary};
use crate::policy::PolicyNetwork;
use crate::registry;

/// Serves one instance over the socket that is this process's stdin and the memory that is its stdout.
///
/// # Errors
/// The socket or the memory is not what a host gives its child. A host that goes away is none.
pub fn serve() -> io::Result<()> {
    let mut wire = UnixStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    let mut memory = SharedMemory::of(&File::from(io::stdout().as_fd().try_clone_to_owned()?))?;
    // What a plugin prints and reads, and what it starts, gets at neither.
    rustix::stdio::dup2_stdin(File::open("/dev/null")?)?;
    rustix::stdio::dup2_stdout(File::options().write(true).open("/dev/null")?)?;
    // Where memory runs out, this process goes before the loop does; before it is closed to its own user.
    let _ = std::fs::write("/proc/self/oom_score_adj", "1000");
    limits::leave_no_core()?;
    end_with_the_host(wire.try_clone()?)?;
    let start: Start = wire::receive(&mut wire)?;
    // A skill that is tried may be one that runs in the host, where nothing limits it.
    let is_limited = start.trial.is_none();
    if is_limited {
        limits::allow_growth(LOADING_BYTES)?;
    }
    let (started, instance) = match load(start) {
        Ok((started, instance)) => (started, instance),
        Err(error) => (Started { refused: Some(refused(error)), ..Started::default() }, None),
    };
    if is_limited {
        limits::allow_growth(GROWTH_BYTES)?;
    }
    wire::send(&mut wire, &started)?;
    let Some(mut instance) = instance else { return Ok(()) };
    let (mut call, mut bytes, mut number) = (CallBuffer::default(), Vec::new(), NO_CALL);
    while wire.read_exact(&mut number).is_ok() {
        memory.read(0, &mut bytes);
        read_call(&bytes, &mut call).ok_or_else(|| io::Error::other("a call that is none"))?;
        let answer = run(&mut instance, &mut call);
        write_answer(&mut bytes, &answer, &call.joints);
        if !memory.write(1, &bytes) {
            return Err(io::Error::other(format!("an answer of {} bytes", bytes.len())));
        }
        wire.write_all(&number)?;
    }
    Ok(())
}

fn run(instance: &mut PluginInstance, call: &mut CallBuffer) -> Result<(), SkillError> {
    let state = call.state.state();
    match call.call {
        Call::Reset => instance.reset(&state),
        Call::Act => instance.act(&state, &call.command, &mut call.joints),
    }
}

/// Ends this process when the host is gone, even while the plugin never returns.
fn end_with_the_host(wire: UnixStream) -> io::Result<()> {
    let (begun, begins) = std::sync::mpsc::sync_channel(1);
    std::thread::Builder::new().name("host watch".to_owned()).stack_size(64 << 10).spawn(move || {
        // The thread's heap is reserved with its first allocation: before the address space is counted, so that the same
        // growth ends every child of a plugin.
        let _ = begun.send(std::hint::black_box(Box::new(0_u8)));
        limits::wait_for_hang_up(&wire);
        // With what the plugin has started; the group is this process's own.
        let _ = rustix::process::kill_current_process_group(rustix::process::Signal::KILL);
        std::process::abort();
    })?;
    begins.recv().map(drop).map_err(io::Error::other)
}

fn load(start: Start) -> Result<(Started, Option<PluginInstance>), PluginError> {
    if let Some(trial) = start.trial {
        try_skill(trial).map_err(PluginError::Create)?;
        return Ok((Started::default(), None));
    }
    let file = &path_of(start.library);
    let library = PluginLibrary::open_exactly(file, &start.sha256)?;
    let description = Some(Description::of(library.description()));
    let Some(create) = start.create else {
        return Ok((Started { description, ..Started::default() }, None));
    };
    let instance = instance(file, &library, create)?;
    let needs = Some(Needs::of(instance.needs()));
    Ok((Started { description, needs, refused: None }, Some(instance)))
}

/// Loads the skill and asks its predictors once.
fn try_skill(trial: Trial) -> Result<(), Finding> {
    let Trial { root, plugin_path, skill, lock, robot } = trial;
    let installation =
        Installation { root: path_of(root), plugin_path: plugin_path.into_iter().map(path_of).collect() };
    let robot = robot.into_api().ok_or_else(|| {
        Finding::new(&installation.skill_file(&skill), "robot", "a description cut short", "a whole one")
    })?;
    let lock = lock.map(|lock| Lock::of_text(&installation, &lock.deployment, lock.text)).transpose()?;
    registry::try_skill(&installation, &skill, lock.as_ref(), &robot)
}

fn instance(
    file: &Path,
    library: &Arc<PluginLibrary>,
    create: Create,
) -> Result<PluginInstance, PluginError> {
    let refuse =
        |field, found: &str, wanted: &str| PluginError::Create(Finding::new(file, field, found, wanted));
    let robot = create.robot.into_api();
    let robot = robot.ok_or_else(|| refuse("robot", "a description cut short", "a whole one"))?;
    let policy = create.policy.map(|policy| {
        let path = &path_of(policy.file);
        let bytes = PolicyNetwork::read(path).map_err(|error| PluginError::Create(error.0))?;
        let found = sha256_hex(&bytes);
        if found != policy.sha256 {
            let wanted = format!("SHA-256 {}, as it was when the host read it", policy.sha256);
            return Err(PluginError::Create(Finding::new(path, "file", found, wanted)));
        }
        PolicyNetwork::from_bytes(&bytes, path).map_err(|error| PluginError::Create(error.0))
    });
    library.create_with(&create.parameters, &robot, policy.transpose()?.as_ref())
}

fn refused(error: PluginError) -> Refused {
    let kind = error.kind();
    let finding = error.into_finding();
    let file = bytes_of(&finding.file);
    Refused { kind, file, field: finding.field, found: finding.found, wanted: finding.wanted }
}

#[cfg(test)]
mod tests {
    use super::super::message::{Locked, Robot};
    use super::*;
    use crate::lock::Intake;

    /// A lock is checked once, with its signature: one that somebody puts on disk thereafter counts for nothing.
    #[test]
    fn a_skill_is_tried_under_the_lock_that_is_handed_over_whatever_lies_on_disk() {
        let folder = tempfile::tempdir().unwrap();
        let installation = Installation { root: folder.path().to_owned(), plugin_path: Vec::new() };
        let file = installation.skill_file("walk");
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        let lock = |manifest: &str| {
            std::fs::write(&file, manifest).unwrap();
            let intake = Intake::recording(&installation.root);
            intake.text(&file, 1 << 20, &file, "file").unwrap();
            Lock::of(&installation, "stairs", intake.into_record()).unwrap()
        };
        let admitted = lock("schema = 1");
        let deployment = installation.deployment_file("stairs");
        std::fs::create_dir_all(deployment.parent().unwrap()).unwrap();
        let on_disk = lock("schema = 2");
        on_disk.write(None).unwrap();
        let robot = crate::runtime::fixture::robot();
        let tried = |lock: &Lock| {
            let trial = Trial {
                root: bytes_of(folder.path()),
                plugin_path: Vec::new(),
                skill: "walk".to_owned(),
                lock: Some(Locked { deployment: "stairs".to_owned(), text: lock.text().to_owned() }),
                robot: Robot::of(&robot.description),
            };
            try_skill(trial).unwrap_err().to_string()
        };
        let found = tried(&admitted);
        assert!(found.contains("walk.toml: sha256: found "), "{found}");
        let found = tried(&on_disk);
        assert!(!found.contains("sha256"), "that lock has the manifest: {found}");
    }
}
