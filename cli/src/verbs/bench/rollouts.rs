//! `bench rollouts`: what `collect` makes a second, and a physics step beside MuJoCo's.

use anyhow::ensure;
use serde::Serialize;
use vocaloco_sim::{
    collect::{CollectConfig, speed},
    dataset::Kind,
    plant::{PlantKind, speed::standing_step_us},
    threads::with_threads,
    transfer::{Interpreter, PeerSpeed, TransferError, time_peer},
};

use crate::{
    exit::Exit,
    output, progress,
    verbs::{
        Shared,
        rolled::{Plant, Rolled},
    },
};

/// Rollouts a second of collection, and the time of a physics step beside MuJoCo's.
///
/// The rows are those of `collect --kind cot` with the same seed, thrown away: tile, settling, one
/// rollout, field and label each; `physics_steps_per_s` counts the steps of settling too.
///
/// `us_per_step` is one physics step of 5 ms alone: the robot stands on flat ground, one thread, the
/// fastest of 20 rounds of 100 steps. MuJoCo's `mj_step` (one step of 5 ms, the same robot file, motors
/// as position servos with the same gains, 100 steps a call) is timed in the same way where the
/// interpreter has the package `mujoco`: `python3 -m venv mj && mj/bin/pip install mujoco`, then
/// `--python mj/bin/python3`.
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
    /// Rollouts to time
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
    plant: PlantKind,
    #[serde(flatten)]
    collection: speed::CollectionSpeed,
    us_per_step: f64,
    peer: Option<Peer>,
}

#[derive(Serialize)]
struct Peer {
    name: String,
    us_per_step: f64,
}

impl From<PeerSpeed> for Peer {
    fn from(PeerSpeed { version, step_us }: PeerSpeed) -> Self {
        Self { name: format!("mujoco {version}"), us_per_step: step_us }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!(args.samples > 0, "--samples: found 0, wanted 1 or more");
    let rolled = Rolled::load(&args.robot, &args.skill)?;
    let config = CollectConfig {
        plant: args.plant.into(),
        ..CollectConfig::new(Kind::Cot, args.shared.seed).for_skill(&rolled.loaded.manifest.rollout)
    };
    let bar = progress::bar(&format!("{} on the {} plant", args.skill, config.plant.id()), args.samples);
    let progress = || bar.inc(1);
    let collection = with_threads(args.threads, || {
        speed::measure(&rolled.robot, &rolled.skill, Kind::Cot, &config, args.samples, &progress)
    })?;
    bar.finish_and_clear();
    let report = Report {
        command: args.command(),
        seed: args.shared.seed,
        version: env!("CARGO_PKG_VERSION"),
        skill: args.skill.clone(),
        plant: config.plant,
        collection: collection?,
        us_per_step: standing_step_us(&rolled.robot, config.plant),
        peer: peer(args, &rolled)?,
    };
    if args.shared.json {
        output::json(&report)?;
    } else {
        table(&report)?;
    }
    Ok(Exit::Fine)
}

/// MuJoCo where it is installed; that it is not is no fault.
fn peer(args: &Args, rolled: &Rolled) -> anyhow::Result<Option<Peer>> {
    let interpreter = Interpreter(args.python.clone());
    match time_peer(&interpreter, &rolled.installation.robots_folder(), &rolled.robot) {
        Ok(speed) => Ok(Some(speed.into())),
        Err(error @ (TransferError::NoInterpreter { .. } | TransferError::NoMujoco { .. })) => {
            eprintln!("peer: none: {error}");
            Ok(None)
        }
        Err(error) => Err(error.into()),
    }
}

fn table(report: &Report) -> anyhow::Result<()> {
    let speed::CollectionSpeed { threads, rollouts, wall_s, rollouts_per_s, physics_steps_per_s } =
        report.collection;
    let plant = report.plant.id();
    output::line(&format!(
        "{rollouts} rollouts of {} on the {plant} plant in {wall_s:.1} s on {threads} threads: \
         {rollouts_per_s:.1} rollouts/s, {physics_steps_per_s:.0} physics steps/s",
        report.skill
    ))?;
    output::line(&format!("a physics step, standing on flat ground: {:.1} µs", report.us_per_step))?;
    if let Some(Peer { name, us_per_step }) = &report.peer {
        output::line(&format!("the same in {name}: {us_per_step:.1} µs"))?;
    }
    output::line(&report.command)?;
    Ok(())
}

impl Args {
    fn command(&self) -> String {
        format!(
            "vocaloco bench rollouts --skill {} --plant {} --samples {} --threads {} --robot {} --python {} --seed {}",
            self.skill,
            PlantKind::from(self.plant).id(),
            self.samples,
            self.threads,
            self.robot,
            self.python,
            self.shared.seed
        )
    }
}
