//! `bench rollouts`: what `collect` makes a second, and a physics step beside MuJoCo's.

use anyhow::ensure;
use serde::Serialize;
use vocaloco_sim::{
    collect::{CollectConfig, speed},
    dataset::Kind,
    plant::{
        PlantKind,
        speed::{rollout_scene, rollouts_step_us, standing_step_us},
    },
    scene::Scene,
    threads::with_threads,
    transfer::{Interpreter, PeerSpeed, TransferError, time_peer},
};

use crate::{
    exit::Exit,
    output, progress,
    verbs::{
        Shared,
        collect::KindArg,
        rolled::{Plant, Rolled},
    },
};

/// Rollouts a second of collection, and the time of a physics step beside MuJoCo's.
///
/// The rows are those of `collect` with the same seed, thrown away: tile, settling, rollouts, field and
/// label each; `physics_steps_per_s` counts the steps of settling too. `cpu_ms_per_rollout` is the time
/// that processors spent, which other work on the machine moves less than the wall's.
///
/// `us_per_step` is one physics step of 5 ms alone: the robot stands on flat ground, one thread, the
/// fastest of 20 rounds of 100 steps. MuJoCo's `mj_step` (one step of 5 ms, the same robot file, motors
/// as position servos with the same gains, 100 steps a call) is timed in the same way where the
/// interpreter has the package `mujoco`: `python3 -m venv mj && mj/bin/pip install mujoco`, then
/// `--python mj/bin/python3`.
///
/// `rollouts_of_steps` times many robots at once that stand on stairs of 15 cm, 32 rollouts of 200 steps from
/// one pose, on 1 and on 2 threads: wall time over all steps. The peer is `mujoco.rollout` on the same robot,
/// terrain, pose and steps.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Threads; 0 for as many as there are processors
    #[arg(long, default_value_t = 0, value_name = "N")]
    threads: usize,
    /// Plant to roll out on
    #[arg(long, value_enum, default_value_t = Plant::Reference)]
    plant: Plant,
    /// Skill to roll out; it needs no predictors
    #[arg(long, default_value = "walk")]
    skill: String,
    /// What the labels of the rows are
    #[arg(long, value_enum, default_value_t = KindArg::Cot)]
    kind: KindArg,
    /// Rows to time; 1 rollout each for cost, 10 for viability
    #[arg(long, default_value_t = 256, value_name = "N")]
    samples: u64,
    /// Python interpreter that may have the package `mujoco`
    #[arg(long, default_value = "python3", value_name = "PATH")]
    python: String,
    /// Robot to roll out
    #[arg(long, default_value = "anymal_d")]
    robot: String,
    #[command(flatten)]
    shared: Shared,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    command: String,
    seed: u64,
    version: &'static str,
    skill: String,
    kind: Kind,
    plant: PlantKind,
    #[serde(flatten)]
    collection: speed::CollectionSpeed,
    us_per_step: f64,
    peer: Option<Peer>,
    rollouts_of_steps: Vec<Parallel>,
}

#[derive(Serialize)]
struct Peer {
    name: String,
    us_per_step: f64,
}

/// Many robots at once.
#[derive(Serialize)]
struct Parallel {
    threads: usize,
    us_per_step: f64,
    /// Of `mujoco.rollout`.
    peer_us_per_step: Option<f64>,
}

/// Numbers of threads on which rollouts of steps are timed.
const THREADS: [usize; 2] = [1, 2];

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!(args.samples > 0, "--samples: found 0, wanted 1 or more");
    let rolled = Rolled::load(&args.robot, &args.skill)?;
    let kind = args.kind.into();
    let config = CollectConfig {
        plant: args.plant.into(),
        ..CollectConfig::new(kind, args.shared.seed).for_skill(&rolled.loaded.manifest.rollout)
    };
    let bar = progress::bar(&format!("{} on the {} plant", args.skill, config.plant.id()), args.samples);
    let progress = || bar.inc(1);
    let collection = with_threads(args.threads, || {
        speed::measure(&rolled.robot, &rolled.skill, kind, &config, args.samples, &progress)
    })?;
    bar.finish_and_clear();
    let scene = rollout_scene(&rolled.robot, config.plant)?;
    let peer = peer(args, &rolled, &scene)?;
    let report = Report {
        command: args.command(),
        seed: args.shared.seed,
        version: env!("CARGO_PKG_VERSION"),
        skill: args.skill.clone(),
        kind,
        plant: config.plant,
        collection: collection?,
        us_per_step: standing_step_us(&rolled.robot, config.plant),
        rollouts_of_steps: parallel(&scene, peer.as_ref())?,
        peer: peer.map(|peer| Peer { name: format!("mujoco {}", peer.version), us_per_step: peer.step_us }),
    };
    if args.shared.json {
        output::json(&report)?;
    } else {
        table(&report)?;
    }
    Ok(Exit::Fine)
}

/// MuJoCo where it is installed; that it is not is no fault.
fn peer(args: &Args, rolled: &Rolled, scene: &Scene) -> anyhow::Result<Option<PeerSpeed>> {
    let interpreter = Interpreter(args.python.clone());
    match time_peer(&interpreter, &rolled.installation.robots_folder(), &rolled.robot, scene, &THREADS) {
        Ok(speed) => Ok(Some(speed)),
        Err(error @ (TransferError::NoInterpreter { .. } | TransferError::NoMujoco { .. })) => {
            eprintln!("peer: none: {error}");
            Ok(None)
        }
        Err(error) => Err(error.into()),
    }
}

fn parallel(scene: &Scene, peer: Option<&PeerSpeed>) -> anyhow::Result<Vec<Parallel>> {
    let on = |(index, threads): (usize, usize)| {
        let us_per_step = with_threads(threads, || rollouts_step_us(scene))?;
        let peer_us_per_step = peer.and_then(|peer| peer.rollouts_step_us.get(index).copied());
        Ok(Parallel { threads, us_per_step, peer_us_per_step })
    };
    THREADS.into_iter().enumerate().map(on).collect()
}

fn table(report: &Report) -> anyhow::Result<()> {
    let speed::CollectionSpeed {
        threads,
        rollouts,
        wall_s,
        rollouts_per_s,
        physics_steps_per_s,
        cpu_ms_per_rollout,
    } = report.collection;
    let plant = report.plant.id();
    output::line(&format!(
        "{rollouts} rollouts of {} on the {plant} plant in {wall_s:.1} s on {threads} threads: \
         {rollouts_per_s:.1} rollouts/s, {physics_steps_per_s:.0} physics steps/s",
        report.skill
    ))?;
    if let Some(cpu_ms) = cpu_ms_per_rollout {
        output::line(&format!("time of one processor for each: {cpu_ms:.1} ms"))?;
    }
    output::line(&format!("a physics step, standing on flat ground: {:.1} µs", report.us_per_step))?;
    if let Some(Peer { name, us_per_step }) = &report.peer {
        output::line(&format!("the same in {name}: {us_per_step:.1} µs"))?;
    }
    for Parallel { threads, us_per_step, peer_us_per_step } in &report.rollouts_of_steps {
        let peer = peer_us_per_step.map_or_else(String::new, |us| format!("; mujoco.rollout: {us:.1} µs"));
        output::line(&format!(
            "a step of many robots that stand on stairs, {threads} threads: {us_per_step:.1} µs{peer}"
        ))?;
    }
    output::line(&report.command)?;
    Ok(())
}

impl Args {
    fn command(&self) -> String {
        format!(
            "vocaloco bench rollouts --skill {} --kind {} --plant {} --samples {} --threads {} --robot {} --python {} --seed {}",
            self.skill,
            Kind::from(self.kind).id(),
            PlantKind::from(self.plant).id(),
            self.samples,
            self.threads,
            self.robot,
            self.python,
            self.shared.seed
        )
    }
}
