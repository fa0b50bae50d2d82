//! `bench hot-add`: what a loop notices of a skill that is installed, and removed, while it drives a robot.

use std::path::Path;
use std::process::Command;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use anyhow::{Context, ensure};
use serde::Serialize;
use tempfile::TempDir;
use vocaloco_core::bundle;
use vocaloco_core::decision::{Decision, STAND};
use vocaloco_core::installation::Installation;
use vocaloco_core::manifest::{Deployment, SkillManifest};
use vocaloco_core::observation::Observation;
use vocaloco_core::predictor::backend;
use vocaloco_core::registry::{load_deployment, read_deployment};
use vocaloco_core::runtime::{Followed, Follower, Pace, Runtime, Supervision, give_way};

use super::tick::{observation, quantile};
use crate::exit::Exit;
use crate::verbs::{Shared, run::pace::clock};
use crate::{output, progress};

/// Time until a skill takes part that is installed while the loop drives, and what ticks notice of it.
///
/// In a temporary installation the deployment's other skills run by the clock, as with `run --real-time`, the
/// robot told that it walks over flat ground. Then another process installs the skill's bundle, and the
/// deployment's line names it; once it drives, another process removes it again. All figures are of this
/// machine and this moment.
///
/// `lateness` is the time from a tick's beat, when its measurement is due, to its targets: the system's
/// waking of the loop and the tick itself. `quiet` is what it is without any change; `late` counts the
/// ticks more than 2 ms beyond the longest of them.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The skill that comes and goes; it must be what drives on flat ground when it is there
    #[arg(long, default_value = "walk", value_name = "NAME")]
    skill: String,
    /// Deployment whose other skills run
    #[arg(long, default_value = "anymal_stairs", value_name = "NAME")]
    deployment: String,
    /// Time to watch before, between and after, s
    #[arg(long, default_value_t = 5.0, value_name = "S")]
    seconds: f64,
    #[command(flatten)]
    shared: Shared,
}

/// Longest wait for anything, s.
const PATIENCE_S: f64 = 60.0;
/// How much later than the latest quiet one a tick counts as late.
const LATE: Duration = Duration::from_millis(2);

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    command: String,
    seed: u64,
    version: &'static str,
    deployment: String,
    skill: String,
    rate_hz: f64,
    /// From the deployment's line to the first tick that knows the skill.
    takes_part_after_s: f64,
    /// From the same moment to the first tick that it drives, the switch window included.
    drives_after_s: f64,
    /// From the end of `skills remove` to the first tick without it.
    gone_after_s: f64,
    /// Who drives in that tick.
    then_drives: String,
    /// The tick in which it came, and the one in which it went, without the waking.
    swap_us: [f64; 2],
    quiet: Lateness,
    adding: Lateness,
    removing: Lateness,
    backend: String,
}

/// Of the ticks of a phase.
#[derive(Serialize)]
struct Lateness {
    ticks: usize,
    p50_us: f64,
    p99_us: f64,
    max_us: f64,
    late: usize,
}

impl Lateness {
    fn of(phase: &[Duration], quiet: &[Duration]) -> Self {
        let bound = quiet.iter().max().copied().unwrap_or_default() + LATE;
        let mut sorted: Vec<f64> = phase.iter().map(|lateness| 1e6 * lateness.as_secs_f64()).collect();
        sorted.sort_by(f64::total_cmp);
        let [p50_us, p99_us, max_us] = [0.5, 0.99, 1.0].map(|share| quantile(&sorted, share));
        let late = phase.iter().filter(|lateness| **lateness > bound).count();
        Self { ticks: phase.len(), p50_us, p99_us, max_us, late }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!((0.1..=3600.0).contains(&args.seconds), "--seconds: found {}, wanted 0.1 to 3600", args.seconds);
    let scene = Scene::set(&Installation::find()?, args)?;
    let mut beats = Beats::start(&scene)?;
    let ticks = (args.seconds / beats.period.as_secs_f64()).ceil() as usize;
    let skill = args.skill.as_str();
    let knows = |decision: &Decision| decision.skills.iter().any(|one| one.name == skill);
    let spinner = progress::spinner("driving");

    beats.until("a skill drives", |decision| decision.active != STAND)?;
    beats.lateness.clear();
    beats.go_on(ticks);
    let quiet = std::mem::take(&mut beats.lateness);

    let named = scene.change(&["skills", "install", &scene.bundle], Some(scene.with.clone()));
    let came = beats.until("the skill takes part", knows)?;
    let drives_s = beats.until("the skill drives", |decision| decision.active == skill)?.at_s;
    beats.go_on(ticks);
    let named_s = ended(&named)?;
    let adding = std::mem::take(&mut beats.lateness);

    let removed = scene.change(&["skills", "remove", skill], None);
    let went = beats.until("the skill is gone", |decision| !knows(decision))?;
    beats.go_on(ticks);
    let removed_s = ended(&removed)?;
    let removing = std::mem::take(&mut beats.lateness);
    spinner.finish_and_clear();

    let report = Report {
        command: format!(
            "vocaloco bench hot-add --skill {skill} --deployment {} --seconds {} --seed {}",
            args.deployment, args.seconds, args.shared.seed
        ),
        seed: args.shared.seed,
        version: env!("CARGO_PKG_VERSION"),
        deployment: args.deployment.clone(),
        skill: skill.to_owned(),
        rate_hz: 1.0 / beats.period.as_secs_f64(),
        takes_part_after_s: came.at_s - named_s,
        drives_after_s: drives_s - named_s,
        // It may be gone before the process that removes it has ended.
        gone_after_s: (went.at_s - removed_s).max(0.0),
        then_drives: went.active,
        swap_us: [came.took_us, went.took_us],
        quiet: Lateness::of(&quiet, &quiet),
        adding: Lateness::of(&adding, &quiet),
        removing: Lateness::of(&removing, &quiet),
        backend: format!("{} {}", backend().name, backend().version),
    };
    if args.shared.json {
        output::json(&report)?;
    } else {
        say(&report)?;
    }
    Ok(Exit::Fine)
}

fn say(report: &Report) -> anyhow::Result<()> {
    let Report { skill, takes_part_after_s, drives_after_s, gone_after_s, then_drives, swap_us, .. } = report;
    output::line(&format!(
        "{skill} takes part {takes_part_after_s:.2} s after its line (tick of {:.0} µs), drives after \
         {drives_after_s:.2} s; gone {gone_after_s:.2} s after its removal (tick of {:.0} µs), then {then_drives} drives",
        swap_us[0], swap_us[1]
    ))?;
    for (phase, of) in [("quiet", &report.quiet), ("adding", &report.adding), ("removing", &report.removing)]
    {
        let Lateness { ticks, p50_us, p99_us, max_us, late } = of;
        output::line(&format!(
            "{phase:9}{ticks} ticks after their beats by p50 {p50_us:.0} µs, p99 {p99_us:.0} µs, max {max_us:.0} µs; \
             {late} more than 2 ms beyond the longest quiet one"
        ))?;
    }
    output::line(&report.command)?;
    Ok(())
}

/// A temporary installation in which the deployment lacks the skill, and what changes that.
struct Scene {
    _folder: TempDir,
    installation: Installation,
    deployment: String,
    /// The skill's bundle.
    bundle: String,
    /// The deployment's file with the skill in it.
    with: String,
}

impl Scene {
    fn set(source: &Installation, args: &Args) -> anyhow::Result<Self> {
        let deployment = read_deployment(source, &args.deployment)?;
        let others: Vec<String> =
            deployment.skills.iter().filter(|name| **name != args.skill).cloned().collect();
        ensure!(!others.is_empty(), "deployment `{}`: found no skill but {}", args.deployment, args.skill);
        let folder = tempfile::tempdir()?;
        let installation =
            Installation { root: folder.path().to_owned(), plugin_path: source.plugin_path.clone() };
        copy_folder(&source.robots_folder(), &installation.robots_folder())?;
        for name in &others {
            copy(&source.skill_file(name), &installation.skill_file(name))?;
            for path in SkillManifest::read(&source.skill_file(name))?.models.paths() {
                copy(&source.skill_folder(name).join(path), &installation.skill_folder(name).join(path))?;
            }
        }
        let bundle = folder.path().join("added.skill");
        bundle::pack(source, &args.skill, &bundle, None)?;
        let scene = Self {
            deployment: args.deployment.clone(),
            bundle: bundle.display().to_string(),
            with: text(&deployment, &[std::slice::from_ref(&args.skill), &others].concat()),
            installation,
            _folder: folder,
        };
        let file = scene.installation.deployment_file(&args.deployment);
        std::fs::create_dir_all(file.parent().context("a folder")?)?;
        std::fs::write(&file, text(&deployment, &others))?;
        Ok(scene)
    }

    /// Runs this program in another process, then replaces the deployment's file; sends when it was done.
    fn change(&self, arguments: &[&str], line: Option<String>) -> Receiver<anyhow::Result<f64>> {
        let (done, receiver) = channel();
        let arguments: Vec<String> = arguments.iter().map(|word| (*word).to_owned()).collect();
        let (root, file) =
            (self.installation.root.clone(), self.installation.deployment_file(&self.deployment));
        let plugin_path = std::env::join_paths(&self.installation.plugin_path);
        std::thread::spawn(move || {
            // A loop that runs at a priority of its own does not lend it to those who install something.
            give_way();
            let change = || {
                let output = Command::new(std::env::current_exe()?)
                    .args(&arguments)
                    .env("VOCALOCO_ROOT", &root)
                    .env("VOCALOCO_PLUGIN_PATH", plugin_path?)
                    .output()?;
                let narration = String::from_utf8_lossy(&output.stderr).into_owned();
                ensure!(output.status.success(), "vocaloco {}: {narration}", arguments.join(" "));
                if let Some(line) = line {
                    let new = root.join("deployment.toml");
                    std::fs::write(&new, line)?;
                    std::fs::rename(&new, &file)?;
                }
                Ok(clock().as_secs_f64())
            };
            // Who no longer waits has said why.
            let _ = done.send(change());
        });
        receiver
    }
}

fn ended(change: &Receiver<anyhow::Result<f64>>) -> anyhow::Result<f64> {
    change.recv().context("found no end of the other process, wanted one")?
}

/// The deployment with other skills.
fn text(deployment: &Deployment, skills: &[String]) -> String {
    let Deployment { robot, rate_hz, switch_window, stop_window, resume_window, heightfield, .. } =
        deployment;
    format!(
        "schema = 1\nrobot = {robot:?}\nskills = {skills:?}\nrate_hz = {rate_hz:?}\nswitch_window = {switch_window}\n\
         stop_window = {stop_window}\nresume_window = {resume_window}\n\n[heightfield]\nmax_age_s = {:?}\n",
        heightfield.max_age_s
    )
}

fn copy(from: &Path, to: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(to.parent().context("a folder")?)?;
    std::fs::copy(from, to).with_context(|| from.display().to_string())?;
    Ok(())
}

fn copy_folder(from: &Path, to: &Path) -> anyhow::Result<()> {
    for entry in std::fs::read_dir(from).with_context(|| from.display().to_string())? {
        let entry = entry?;
        if entry.path().is_file() {
            copy(&entry.path(), &to.join(entry.file_name()))?;
        }
    }
    Ok(())
}

/// A tick that was waited for.
struct Reached {
    at_s: f64,
    took_us: f64,
    active: String,
}

/// The loop, tick by tick at its rate.
struct Beats {
    runtime: Runtime,
    observation: Observation,
    began: Duration,
    beat: u32,
    period: Duration,
    /// Of every tick, from its beat to its end.
    lateness: Vec<Duration>,
}

impl Beats {
    fn start(scene: &Scene) -> anyhow::Result<Self> {
        let followed = Followed::now(&scene.installation, &scene.deployment);
        let loaded = load_deployment(&scene.installation, &scene.deployment)?;
        let supervision = Supervision { clock, deadlines: loaded.deployment.deadlines, pace: Pace::Real };
        let (deployment, robot) = (loaded.deployment.clone(), loaded.robot.clone());
        let runtime = Runtime::new(loaded)?.supervised(supervision)?;
        let running: Vec<String> = runtime.rules().iter().map(|rule| rule.name.clone()).collect();
        let follower = Follower::start(followed, deployment, robot, running, Some(supervision))?;
        let period = Duration::from_secs_f64(1.0 / runtime.config().rate_hz);
        Ok(Self {
            observation: observation(runtime.robot(), f64::INFINITY),
            runtime: runtime.following(follower),
            began: clock(),
            beat: 0,
            period,
            lateness: Vec::new(),
        })
    }

    /// Waits for the next beat, ticks, and gives what came of it and how long it took.
    fn tick(&mut self) -> (&Decision, Duration) {
        self.beat += 1;
        let beat = self.began + self.beat * self.period;
        let t_s = (self.beat * self.period).as_secs_f64();
        self.observation.t_s = t_s;
        if let Some(elevation) = &mut self.observation.elevation {
            elevation.t_s = t_s;
        }
        std::thread::sleep(beat.saturating_sub(clock()));
        let woken = clock();
        let decision = self.runtime.tick(&self.observation).decision;
        let ended = clock();
        self.lateness.push(ended.saturating_sub(beat));
        (decision, ended.saturating_sub(woken))
    }

    fn go_on(&mut self, ticks: usize) {
        for _ in 0..ticks {
            self.tick();
        }
    }

    /// The first tick that is as `wanted` says.
    fn until(&mut self, what: &str, wanted: impl Fn(&Decision) -> bool) -> anyhow::Result<Reached> {
        for _ in 0..(PATIENCE_S / self.period.as_secs_f64()) as usize {
            let (decision, took) = self.tick();
            if wanted(decision) {
                let active = decision.active.clone();
                return Ok(Reached {
                    at_s: clock().as_secs_f64(),
                    took_us: 1e6 * took.as_secs_f64(),
                    active,
                });
            }
        }
        anyhow::bail!("found no tick within {PATIENCE_S} s in which {what}, wanted one")
    }
}
