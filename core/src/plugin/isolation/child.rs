//! The host's side: starts a child, hands it calls, and turns its end into an error.

use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command as Process, ExitStatus};
use std::sync::OnceLock;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process_group};
use vocaloco_plugin_api::{
    Command, Description, ErrorCode, JointTarget, Needs, RobotDescription, RobotState, SkillError,
};

use super::frame::{Call, NO_CALL, read_answer, write_call};
use super::memory::SharedMemory;
use super::message::{self, Create, Locked, Policy, Refused, Start, Started, Trial, bytes_of, path_of};
use super::wire;
use crate::installation::Installation;
use crate::lock::Lock;
use crate::manifest::Finding;
use crate::plugin::PluginError;
use crate::policy::PolicyNetwork;

/// Longest time to load a library and make an instance.
const START: Duration = Duration::from_secs(30);
/// A call without an answer for this long has hung: the child is ended. In real time the loop has long
/// gone on without it.
const HUNG: Duration = Duration::from_secs(2);
/// Time in which a child that hung up is expected to have ended.
const END: Duration = Duration::from_secs(2);

/// Where [`isolate_with`] was told of a program.
static TOLD: OnceLock<PathBuf> = OnceLock::new();

/// Isolated plugins run in this program from now on, which answers the verb `plugin-host` with
/// [`serve`](super::serve); only the first call counts.
///
/// The command line says so of itself, whatever its file is called. A program that does not is expected to be
/// called `vocaloco`, or to have that beside its plugins.
pub fn isolate_with(program: PathBuf) {
    let _ = TOLD.set(program);
}

/// The program that children run: the one told of, this one, or `vocaloco` beside the plugins.
#[derive(Clone, Debug)]
pub(crate) struct Program(PathBuf);

impl Program {
    /// This process's own program when it is `vocaloco`, else the one on the plugin path.
    pub(crate) fn find(search_path: &[PathBuf]) -> Result<Self, Finding> {
        if let Some(told) = TOLD.get() {
            return Ok(Self(told.clone()));
        }
        let own = std::env::current_exe().ok();
        if own.as_deref().and_then(Path::file_stem).is_some_and(|stem| stem == "vocaloco") {
            // The very program that runs, even when its file was replaced meanwhile.
            return Ok(Self("/proc/self/exe".into()));
        }
        let beside = search_path.iter().map(|folder| folder.join("vocaloco")).find(|file| file.is_file());
        beside.map(Self).ok_or_else(|| {
            let wanted = "the program vocaloco on the plugin path, which isolated plugins run in";
            Finding::new(Path::new("vocaloco"), "isolation", "no such program", wanted)
        })
    }
}

/// What an instance is made of, and made of again.
#[derive(Clone)]
struct Origin {
    program: Program,
    start: Start,
}

/// Loads a skill, under `lock` where there is one, in a child that ends thereafter; where no program for children is
/// known, nothing is found. What its deployment asks of it is for who loads it next.
///
/// # Errors
/// What is wrong with it, or loading it ends the process that does, or takes too long.
pub(crate) fn try_skill(
    installation: &Installation,
    skill: &str,
    lock: Option<&Lock>,
    robot: &RobotDescription,
) -> Result<(), Finding> {
    let Ok(program) = Program::find(&installation.plugin_path_of(skill)) else { return Ok(()) };
    let trial = Some(Trial {
        root: bytes_of(&installation.root),
        plugin_path: installation.plugin_path.iter().map(|folder| bytes_of(folder)).collect(),
        skill: skill.to_owned(),
        lock: lock
            .map(|lock| Locked { deployment: lock.deployment().to_owned(), text: lock.text().to_owned() }),
        robot: message::Robot::of(robot),
    });
    let start = Start { library: bytes_of(&installation.skill_file(skill)), trial, ..Start::default() };
    ChildInstance::start(Origin { program, start }).map(drop).map_err(PluginError::into_finding)
}

/// An instance in a child process.
pub(crate) struct ChildInstance {
    origin: Origin,
    child: Child,
    wire: UnixStream,
    memory: SharedMemory,
    bytes: Vec<u8>,
    calls: u64,
    /// How it ended, once it has.
    ended: Option<String>,
}

impl ChildInstance {
    /// What the library at `file`, whose bytes have this hash, says of itself: asked of a child that
    /// ends thereafter.
    pub(crate) fn describe(
        program: &Program,
        file: &Path,
        sha256: &[u8],
    ) -> Result<Description, PluginError> {
        let start = Start { library: bytes_of(file), sha256: sha256.to_vec(), ..Start::default() };
        let (_, started) = Self::start(Origin { program: program.clone(), start })?;
        let description = started.description.and_then(message::Description::into_api);
        description.ok_or_else(|| PluginError::Description(nonsense(file, "describe")))
    }

    /// A new instance, and what it needs.
    pub(crate) fn create(
        program: &Program,
        file: &Path,
        sha256: &[u8],
        parameters: &str,
        robot: &RobotDescription,
        policy: Option<&PolicyNetwork>,
    ) -> Result<(Self, Needs), PluginError> {
        let create = Some(Create {
            parameters: parameters.to_owned(),
            robot: message::Robot::of(robot),
            policy: policy.map(|network| Policy {
                file: bytes_of(network.file()),
                sha256: network.sha256().to_owned(),
            }),
        });
        let start = Start { library: bytes_of(file), sha256: sha256.to_vec(), create, trial: None };
        let (instance, started) = Self::start(Origin { program: program.clone(), start })?;
        let needs = started.needs.and_then(message::Needs::into_api);
        Ok((instance, needs.ok_or_else(|| PluginError::Create(nonsense(file, "needs")))?))
    }

    fn start(origin: Origin) -> Result<(Self, Started), PluginError> {
        let file = path_of(origin.start.library.clone());
        // What is tried may be no isolated one, and its model's runtime what ends the process.
        let (field, loads) = match &origin.start.trial {
            Some(_) => ("file", "a skill that loads in a process of its own"),
            None => ("isolation", "a plugin that loads and makes an instance"),
        };
        let refuse =
            |found: String, wanted: &str| PluginError::Create(Finding::new(&file, field, found, wanted));
        let wanted = format!("{} as a process of its own", origin.program.0.display());
        let mut instance = Self::spawn(origin).map_err(|error| refuse(error.to_string(), &wanted))?;
        match instance.begin(START) {
            Ok(Started { refused: Some(refused), .. }) => {
                let Refused { kind, file, field, found, wanted } = refused;
                let finding = Finding::new(&path_of(file), field, found, wanted);
                Err(PluginError::of_kind(kind, finding))
            }
            Ok(started) => Ok((instance, started)),
            Err(ended) => Err(refuse(ended, loads)),
        }
    }

    /// Hands over what is to be made and waits for what comes of it, or ends the child and says how.
    fn begin(&mut self, patience: Duration) -> Result<Started, String> {
        let wire = &mut self.wire;
        let started = wire
            .set_read_timeout(Some(patience))
            .and_then(|()| wire.set_write_timeout(Some(patience)))
            .and_then(|()| wire::send(wire, &self.origin.start))
            .and_then(|()| wire::receive::<Started>(wire))
            .and_then(|started| wire.set_read_timeout(Some(HUNG)).map(|()| started));
        started.map_err(|error| self.end(&error, patience))
    }

    fn spawn(origin: Origin) -> io::Result<Self> {
        let (memory, shared) = SharedMemory::new()?;
        let (wire, theirs) = UnixStream::pair()?;
        let child = Process::new(&origin.program.0)
            .arg("plugin-host")
            // Handed over, not named: another process's descriptors can be closed to it.
            .stdin(OwnedFd::from(theirs))
            .stdout(shared)
            // With a group of its own, what a plugin starts ends with it.
            .process_group(0)
            .spawn()?;
        Ok(Self { origin, child, wire, memory, bytes: Vec::new(), calls: 0, ended: None })
    }

    /// Number of the process, until it has ended: it may be another's then.
    pub(crate) fn id(&self) -> Option<u32> {
        self.ended.is_none().then(|| self.child.id())
    }

    /// Starts anew what has ended, for another run that is to go as the first.
    pub(crate) fn revive(&mut self) {
        if self.ended.is_some() {
            match Self::start(self.origin.clone()) {
                Ok((again, _)) => *self = again,
                Err(error) => self.ended = Some(error.to_string()),
            }
        }
    }

    /// See [`Skill::reset`](vocaloco_plugin_api::Skill::reset).
    pub(crate) fn reset(&mut self, state: &RobotState<'_>) -> Result<(), SkillError> {
        self.call(Call::Reset, state, &Command::velocity(0.0, 0.0, 0.0), &mut [])
    }

    /// See [`Skill::act`](vocaloco_plugin_api::Skill::act).
    pub(crate) fn act(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), SkillError> {
        self.call(Call::Act, state, command, joints)
    }

    fn call(
        &mut self,
        call: Call,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), SkillError> {
        let failed = |line: String| SkillError::new(ErrorCode::Internal, line);
        if let Some(ended) = &self.ended {
            return Err(failed(format!("found {ended}, wanted an answer")));
        }
        write_call(&mut self.bytes, call, state, command, joints);
        if !self.memory.write(0, &self.bytes) {
            return Err(failed(format!("found a state of {} bytes, wanted fewer", self.bytes.len())));
        }
        self.calls += 1;
        let (asked, mut answered) = (self.calls.to_le_bytes(), NO_CALL);
        let exchanged =
            self.wire.write_all(&asked).and_then(|()| self.wire.read_exact(&mut answered)).and_then(|()| {
                let is_of_this = answered == asked;
                is_of_this.then_some(()).ok_or_else(|| io::Error::other("an answer to another call"))
            });
        if let Err(error) = exchanged {
            return Err(failed(format!("found {}, wanted an answer", self.end(&error, HUNG))));
        }
        self.memory.read(1, &mut self.bytes);
        match call {
            Call::Reset => read_answer(&self.bytes, &mut []),
            Call::Act => read_answer(&self.bytes, joints),
        }
    }

    /// Ends the child after `error`; how it ended, in words that it also keeps.
    fn end(&mut self, error: &io::Error, patience: Duration) -> String {
        let is_late = matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut);
        let ended = if is_late {
            format!("no answer for {} s from its process, which was ended", patience.as_secs_f64())
        } else if error.kind() == ErrorKind::Other {
            format!("{error} from its process, which was ended")
        } else {
            match self.status() {
                Some(status) => format!("its process {}", how(status, self.origin.start.trial.is_none())),
                None => format!("its process silent ({error})"),
            }
        };
        self.kill();
        self.ended = Some(ended.clone());
        ended
    }

    /// Ends the child, and what it has started.
    fn kill(&mut self) {
        let group = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
        let _ = group.map(|group| kill_process_group(group, Signal::KILL));
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// How the child ended, which it does a moment after it hangs up.
    fn status(&mut self) -> Option<ExitStatus> {
        let step = Duration::from_millis(1);
        (0..END.as_millis()).find_map(|_| {
            let status = self.child.try_wait().ok().flatten();
            if status.is_none() {
                std::thread::sleep(step);
            }
            status
        })
    }
}

fn how(status: ExitStatus, is_limited: bool) -> String {
    let name = |signal| match signal {
        4 => " (illegal instruction)",
        6 if is_limited => " (abort, which more memory than it may have comes to as well)",
        6 => " (abort)",
        7 => " (bus error)",
        8 => " (arithmetic)",
        9 => " (killed)",
        11 => " (segmentation fault)",
        _ => "",
    };
    match (status.signal(), status.code()) {
        (Some(signal), _) => format!("ended by signal {signal}{}", name(signal)),
        (None, Some(code)) => format!("ended with exit code {code}"),
        (None, None) => "ended".to_owned(),
    }
}

fn nonsense(file: &Path, field: &str) -> Finding {
    Finding::new(file, field, "an answer that is none", "a plugin of this interface")
}

impl Drop for ChildInstance {
    fn drop(&mut self) {
        if self.ended.is_none() {
            self.kill();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `grep` takes what it is sent and says nothing until that ends: to its host, a plugin that hangs when created.
    #[test]
    fn a_child_that_never_makes_its_instance_is_ended_and_the_time_it_had_is_named() {
        let origin = Origin { program: Program("grep".into()), start: Start::default() };
        let mut instance = ChildInstance::spawn(origin).unwrap();
        let process = PathBuf::from(format!("/proc/{}", instance.id().unwrap()));
        assert!(process.exists(), "it runs");
        let ended = instance.begin(Duration::from_millis(300)).unwrap_err();
        assert_eq!(ended, "no answer for 0.3 s from its process, which was ended");
        assert!(!process.exists() && instance.id().is_none(), "it is gone");
    }
}
