//! `bench hot-add`: what a loop notices of a skill that is installed, and removed, while it drives a robot.

mod scene;

use std::time::Duration;

use anyhow::ensure;
use serde::Serialize;
use vocaloco_core::decision::{Decision, STAND};
use vocaloco_core::installation::Installation;
use vocaloco_core::observation::Observation;
use vocaloco_core::predictor::backend;
use vocaloco_core::registry::load_deployment;
use vocaloco_core::runtime::{Followed, Follower, Pace, Runtime, Supervision};

use self::scene::{Scene, ended};
use super::approach::observation;
use super::tick::quantile;
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
/// ticks whose targets came after the next beat.
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
    fn of(phase: &[Duration], period: Duration) -> Self {
        let mut sorted: Vec<f64> = phase.iter().map(|lateness| 1e6 * lateness.as_secs_f64()).collect();
        sorted.sort_by(f64::total_cmp);
        let [p50_us, p99_us, max_us] = [0.5, 0.99, 1.0].map(|share| quantile(&sorted, share));
        let late = phase.iter().filter(|lateness| **lateness > period).count();
        Self { ticks: phase.len(), p50_us, p99_us, max_us, late }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!((0.1..=3600.0).contains(&args.seconds), "--seconds: found {}, wanted 0.1 to 3600", args.seconds);
    let scene = Scene::set(&Installation::find()?, &args.deployment, &args.skill)?;
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
        quiet: Lateness::of(&quiet, beats.period),
        adding: Lateness::of(&adding, beats.period),
        removing: Lateness::of(&removing, beats.period),
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
             {late} after the next beat"
        ))?;
    }
    output::line(&report.command)?;
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
