//! The files of a running deployment, looked at in the background: skills that are added, changed or
//! removed are loaded there and handed to the loop between two ticks.
//!
//! A bad file changes nothing but the events of the next decision. Under a lock only what a lock on disk
//! has, signed as demanded, is taken.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel, sync_channel};
use std::time::{Duration, SystemTime};

use super::{Pace, Place, Roster, Skill, Supervision, background::return_large_blocks, give_way};
use crate::installation::Installation;
use crate::lock::{Intake, Lock, PublicKey, sha256_hex};
use crate::manifest::{Deadlines, Deployment, Finding, SkillManifest, bytes_of};
use crate::plugin::library_file_name;
#[cfg(target_os = "linux")]
use crate::plugin::try_skill;
#[cfg(target_os = "linux")]
use crate::registry::Refusal;
use crate::registry::{deployment_through, load_deployed};
use crate::robot::RobotModel;

/// Time between two looks at the files. A change is taken up when a second look finds no other.
const EVERY: Duration = Duration::from_millis(100);

/// What the skills of a deployment are made of, as it lies on disk at one moment.
#[derive(Clone, Debug)]
pub struct Followed {
    installation: Installation,
    name: String,
    keys: Option<Vec<PublicKey>>,
    seen: Seen,
    /// What the skills were made of then.
    contents: BTreeMap<String, Contents>,
}

impl Followed {
    /// The files as they are now, to be called before they are loaded: what changes meanwhile is not lost.
    pub fn now(installation: &Installation, name: &str) -> Self {
        let seen = Seen::look(installation, name);
        let contents = seen.skills.keys().map(|skill| (skill.clone(), seen.contents(skill))).collect();
        Self { installation: installation.clone(), name: name.to_owned(), keys: None, seen, contents }
    }

    /// Takes skills only from a lock, which one of `keys` must have signed where there are any, besides
    /// one of the deployment's own.
    #[must_use]
    pub fn locked(mut self, keys: Vec<PublicKey>) -> Self {
        self.keys = Some(keys);
        self
    }
}

/// Follows a deployment's files from a thread of its own.
#[derive(Debug)]
pub struct Follower {
    changes: Receiver<Roster>,
    back: Sender<Back>,
}

/// What the loop gives back.
pub(super) struct Back {
    pub(super) gone: Vec<Skill>,
    /// New ones that it has not taken up.
    pub(super) starved: Vec<Skill>,
}

impl Follower {
    /// Starts with what runs now: `deployment` on `robot`, and the names of those of its skills that were
    /// sound.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn start(
        followed: Followed,
        deployment: Deployment,
        robot: Arc<RobotModel>,
        running: impl IntoIterator<Item = String>,
        supervision: Option<Supervision>,
    ) -> std::io::Result<Self> {
        // What the loop has not taken yet is waited for: a loop without ticks must not pile up skills.
        let (found, changes) = sync_channel(1);
        let (back, came_back) = channel::<Back>();
        let mut watch = Watch::new(followed, deployment, robot, running, supervision);
        std::thread::Builder::new().name("follow".to_owned()).spawn(move || {
            // What the loop lets go of is dropped here; without a loop there is nothing to follow for.
            loop {
                match came_back.recv_timeout(EVERY) {
                    Ok(Back { gone, starved }) => {
                        drop(gone);
                        watch.forget(&starved);
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => break,
                }
                if let Some(roster) = watch.look()
                    && found.send(roster).is_err()
                {
                    break;
                }
            }
        })?;
        Ok(Self { changes, back })
    }

    /// One that hands over what comes, and what the loop gives back to it.
    #[cfg(test)]
    pub(super) fn of(changes: Receiver<Roster>) -> (Self, Receiver<Back>) {
        let (back, came_back) = channel();
        (Self { changes, back }, came_back)
    }

    /// What has changed since it was asked last; never waits.
    pub(super) fn changed(&mut self) -> Option<Roster> {
        self.changes.try_recv().ok()
    }

    /// Takes skills to drop them on its own thread.
    pub(super) fn retire(&self, gone: Vec<Skill>, starved: Vec<Skill>) {
        // A thread that is gone drops nothing; then they are dropped here.
        let _ = self.back.send(Back { gone, starved });
    }
}

/// A file at one moment; none is not there.
type Stamp = Option<(SystemTime, u64)>;

/// The files of a skill, at one moment.
type Files = BTreeMap<PathBuf, Stamp>;

/// What the files of a skill hold, hashed; none could not be read.
type Contents = BTreeMap<PathBuf, Option<String>>;

/// A deployment's thresholds for one of its skills, to begin and to go on.
type Thresholds = [Option<f32>; 2];

fn thresholds(deployment: &Deployment) -> BTreeMap<String, Thresholds> {
    let of = |skill: &String| {
        let tables = [&deployment.viability_thresholds, &deployment.hold_thresholds];
        (skill.clone(), tables.map(|table| table.get(skill).copied()))
    };
    deployment.skills.iter().map(of).collect()
}

/// Largest file that is looked into, bytes.
const MAX_FILE_BYTES: u64 = 1 << 30;

/// All the files that count, at one moment.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Seen {
    deployment: Stamp,
    lock: [Stamp; 2],
    skills: BTreeMap<String, Files>,
}

impl Seen {
    fn look(installation: &Installation, name: &str) -> Self {
        let file = installation.deployment_file(name);
        let skills = Deployment::read(&file).map(|deployment| deployment.skills).unwrap_or_default();
        Self {
            deployment: stamp(&file),
            lock: ["lock", "lock.sig"].map(|extension| stamp(&file.with_extension(extension))),
            skills: skills.into_iter().map(|skill| (skill.clone(), files(installation, &skill))).collect(),
        }
    }

    /// What the files of a skill hold now.
    fn contents(&self, skill: &str) -> Contents {
        let hash = |path: &PathBuf| bytes_of(path, MAX_FILE_BYTES).ok().map(|bytes| sha256_hex(&bytes));
        let files = self.skills.get(skill).into_iter().flat_map(Files::keys);
        files.map(|path| (path.clone(), hash(path))).collect()
    }
}

fn stamp(path: &Path) -> Stamp {
    let about = std::fs::metadata(path).ok()?;
    Some((about.modified().ok()?, about.len()))
}

/// The manifest of a skill, the files it names and the places its plugin may lie in.
fn files(installation: &Installation, skill: &str) -> Files {
    let file = installation.skill_file(skill);
    let mut paths = BTreeSet::from([file.clone()]);
    if let Ok(manifest) = SkillManifest::read(&file) {
        let folder = installation.skill_folder(skill);
        paths.extend(manifest.models.paths().map(|path| folder.join(path)));
        let library = library_file_name(&manifest.plugin);
        paths.extend(installation.plugin_path_of(skill).iter().map(|folder| folder.join(&library)));
    }
    paths.into_iter().map(|path| (path.clone(), stamp(&path))).collect()
}

/// What `work` comes to on a thread that gives way to the loop, or on this one when the system has no other; none
/// where it panics.
fn apart<T: Send>(work: impl Fn() -> T + Sync) -> Option<T> {
    let gives_way = || {
        give_way();
        work()
    };
    let done = std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().name("follow apart".to_owned());
        thread.spawn_scoped(scope, gives_way).map(std::thread::ScopedJoinHandle::join).ok()
    });
    done.map_or_else(|| Some(work()), Result::ok)
}

/// What looks at the files; a [`Follower`] does so from its thread.
#[derive(Debug)]
pub struct Watch {
    followed: Followed,
    deployment: Deployment,
    robot: Arc<RobotModel>,
    /// Skills that the loop has, or is about to get, in its order, and what they were made of.
    running: Vec<(String, Contents)>,
    /// The files with which each skill was last found sound or not, and the thresholds that it was held to.
    judged: BTreeMap<String, Files>,
    thresholds: BTreeMap<String, Thresholds>,
    supervision: Option<Supervision>,
    /// A change that may not be complete yet.
    settling: Option<Seen>,
    /// The lock under which the skills were looked at last.
    locked: [Stamp; 2],
}

impl Watch {
    /// Starts with what runs now, as [`Follower::start`].
    pub fn new(
        mut followed: Followed,
        deployment: Deployment,
        robot: Arc<RobotModel>,
        running: impl IntoIterator<Item = String>,
        supervision: Option<Supervision>,
    ) -> Self {
        return_large_blocks();
        let contents = &mut followed.contents;
        let made_of = |skill: String| {
            let contents = contents.remove(&skill).unwrap_or_default();
            (skill, contents)
        };
        let running = running.into_iter().map(made_of).collect();
        let (judged, locked) = (followed.seen.skills.clone(), followed.seen.lock);
        let thresholds = thresholds(&deployment);
        Self { followed, deployment, robot, running, judged, thresholds, supervision, settling: None, locked }
    }

    /// The loop has not taken up these: what it has under their names, if anything, is older, and the same files are
    /// news again when they are touched.
    fn forget(&mut self, starved: &[Skill]) {
        let is_starved = |name: &String| starved.iter().any(|skill| skill.rule.name == *name);
        self.running.iter_mut().filter(|(name, _)| is_starved(name)).for_each(|(_, made_of)| made_of.clear());
    }

    /// Looks at the files: the skills as they should be, when that is news. A change is news when the look
    /// after the one that has found it finds no other.
    pub fn look(&mut self) -> Option<Roster> {
        let Followed { installation, name, seen, .. } = &self.followed;
        let now = Seen::look(installation, name);
        if now == *seen {
            self.settling = None;
            return None;
        }
        if self.settling.as_ref() != Some(&now) {
            self.settling = Some(now);
            return None;
        }
        self.followed.seen = now;
        self.settling = None;
        let roster = self.take_up();
        Some(roster.unwrap_or_else(|finding| Roster {
            places: self.running.iter().map(|(skill, _)| Place::Kept(skill.clone())).collect(),
            events: vec![format!("{finding}; the skills go on as they were")],
            deadlines: None,
        }))
    }

    /// Loads what differs from what was judged.
    fn take_up(&mut self) -> Result<Roster, Finding> {
        let Followed { installation, name, keys, seen, .. } = &self.followed;
        let lock = keys.as_ref().map(|_| Lock::read(installation, name)).transpose()?;
        let intake = Intake::of(&installation.root, lock.as_ref());
        let deployment = deployment_through(installation, name, &intake)?;
        if let (Some(lock), Some(keys)) = (&lock, keys) {
            lock.check_signature(keys)?;
            lock.check_signature(&deployment.trusted_keys)?;
            // A deployment that demands less than the one that was started takes nothing back.
            lock.check_signature(&self.deployment.trusted_keys)?;
        }
        self.is_same_tick(&deployment)?;
        let mut events = Vec::new();
        if self.differs_otherwise(&deployment) {
            let file = deployment.file.strip_prefix(&installation.root).unwrap_or(&deployment.file);
            events.push(format!("{}: found other settings, taken up at the next start", file.display()));
        }
        let is_relocked = lock.is_some() && self.locked != seen.lock;
        let now_held_to = thresholds(&deployment);
        let (mut places, mut loaded_from) = (Vec::new(), BTreeMap::new());
        for skill in &deployment.skills {
            let running = self.running.iter().find(|(name, _)| name == skill).map(|(_, made_of)| made_of);
            let runs = running.is_some();
            // What was refused under another lock, or other thresholds, may be taken under these.
            let is_judged = !is_relocked
                && seen.skills.get(skill) == self.judged.get(skill)
                && now_held_to.get(skill) == self.thresholds.get(skill);
            // Touched, or changed and changed back.
            let is_what_runs =
                || running.is_some_and(|made_of| Some(made_of) == apart(|| seen.contents(skill)).as_ref());
            if is_judged || is_what_runs() {
                // One that was refused as it is now would be refused again.
                places.extend(runs.then(|| Place::Kept(skill.clone())));
                continue;
            }
            if stamp(&installation.skill_file(skill)).is_none() {
                events.push(format!("skill {skill} is gone: it has no manifest any more"));
                continue;
            }
            let ready = |loaded| self.ready(loaded, &deployment.deadlines);
            // What changes while it is loaded is found otherwise at the next look.
            let contents = apart(|| seen.contents(skill)).unwrap_or_default();
            match self.load(&deployment, skill, lock.as_ref()).and_then(ready) {
                Ok(ready) => {
                    loaded_from.insert(skill.clone(), contents);
                    places.push(Place::New(ready));
                }
                Err(line) if runs => {
                    events.push(format!("{line}; it goes on as it was"));
                    places.push(Place::Kept(skill.clone()));
                }
                Err(line) => events.push(line),
            }
        }
        let names = self.running.iter().map(|(skill, _)| skill);
        for skill in names.filter(|skill| !deployment.skills.contains(skill)) {
            events.push(format!("skill {skill} is gone: its deployment names it no more"));
        }
        self.judged.clone_from(&seen.skills);
        self.thresholds = now_held_to;
        self.locked = seen.lock;
        let mut before: BTreeMap<_, _> = std::mem::take(&mut self.running).into_iter().collect();
        self.running = places
            .iter()
            .map(|place| match place {
                Place::Kept(name) => (name.clone(), before.remove(name).unwrap_or_default()),
                Place::New(skill) => {
                    (skill.rule.name.clone(), loaded_from.remove(&skill.rule.name).unwrap_or_default())
                }
            })
            .collect();
        Ok(Roster { places, events, deadlines: Some(deployment.deadlines) })
    }

    /// Loads a skill: in a process of its own first, since what ends that one must not end the loop.
    fn load(&self, deployment: &Deployment, skill: &str, lock: Option<&Lock>) -> Result<Skill, String> {
        let (installation, robot) = (&self.followed.installation, &self.robot.description);
        apart(|| {
            #[cfg(target_os = "linux")]
            try_skill(installation, skill, lock, robot)
                .map_err(|finding| Refusal::of(installation, skill, finding).to_string())?;
            let intake = Intake::of(&installation.root, lock);
            let loaded = load_deployed(installation, deployment, skill, robot, &intake);
            let loaded = loaded.map_err(|refusal| refusal.to_string())?;
            Skill::of(loaded, robot).map_err(|error| error.to_string())
        })
        .unwrap_or_else(|| Err(format!("skill {skill}: loading it panicked")))
    }

    /// The skill as the loop takes it. Its workers follow the priority of this thread, which is the loop's.
    fn ready(&self, skill: Skill, deadlines: &Deadlines) -> Result<Skill, String> {
        match self.supervision {
            Some(supervision) if supervision.pace == Pace::Real => {
                let supervision = Supervision { deadlines: *deadlines, ..supervision };
                skill.watched(supervision.act(), supervision.predict()).map_err(|error| error.to_string())
            }
            _ => Ok(skill),
        }
    }

    /// A tick is as long as it was at the start, and as many skills act in it: what fits into another, skills
    /// and budgets, need not fit into this one.
    ///
    /// # Errors
    /// It is not.
    fn is_same_tick(&self, now: &Deployment) -> Result<(), Finding> {
        let (started, wanted) = (&self.deployment, |value: String| format!("{value}, until the next start"));
        let differs = if now.rate_hz.to_bits() == started.rate_hz.to_bits() {
            (now.switching.mixing != started.switching.mixing).then(|| {
                let [found, was] = [now, started].map(|of| of.switching.mixing.to_string());
                ("switching.mixing", found, wanted(was))
            })
        } else {
            Some(("rate_hz", now.rate_hz.to_string(), wanted(started.rate_hz.to_string())))
        };
        differs.map_or(Ok(()), |(field, found, wanted)| Err(Finding::new(&now.file, field, found, wanted)))
    }

    /// Whether more than the skills is not as at the start; budgets follow the number of skills.
    fn differs_otherwise(&self, now: &Deployment) -> bool {
        let started =
            Deployment { skills: now.skills.clone(), deadlines: now.deadlines, ..self.deployment.clone() };
        started != *now
    }
}
