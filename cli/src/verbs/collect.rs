//! `collect`: rolls a skill out in the simulator and writes a data set that `train` reads.

use std::path::PathBuf;

use anyhow::{bail, ensure};
use serde_json::json;
use vocaloco_sim::{
    collect::{CollectConfig, Collected, Collection, Mixture, RunLog},
    dataset::{Kind, Layout, ROWS_PER_SHARD, Shard},
};

use super::{
    Shared,
    noise::NoiseArgs,
    rolled::{Plant, Rolled},
};
use crate::{exit::Exit, output, progress};

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Skill to roll out; it needs no predictors yet
    #[arg(long)]
    skill: String,
    /// What the labels are
    #[arg(long, value_enum)]
    kind: KindArg,
    /// Rows of the data set; one of cost leaves out those that crash
    #[arg(long, value_name = "N")]
    samples: u64,
    /// Rollouts from each pose; always 1 for cost
    #[arg(long, default_value_t = 10, value_name = "N")]
    repeats: u32,
    /// Only this part of the shards, such as 1/4; the parts may share a folder or be merged
    #[arg(long, default_value = "1/1", value_name = "I/N", value_parser = parse_shard)]
    shard: Shard,
    /// Rows to a file: what a killed run loses at most, and what a data set keeps for good
    #[arg(long, default_value_t = ROWS_PER_SHARD, value_name = "N")]
    rows_per_shard: u64,
    /// Threads; 0 for as many as there are processors
    #[arg(long, default_value_t = 0, value_name = "N")]
    threads: usize,
    /// Go on with what is there
    #[arg(long)]
    resume: bool,
    /// Folder of data sets; this one goes to OUT/SKILL/KIND
    #[arg(long, default_value = "data", value_name = "OUT")]
    out: PathBuf,
    /// Plant to roll out on
    #[arg(long, value_enum, default_value_t = Plant::Reference)]
    plant: Plant,
    #[command(flatten)]
    noise: NoiseArgs,
    /// Terrains and their weights, such as `flat=0.1,stairs_up=0.45`; what the method trains on unless given
    #[arg(long, value_name = "LIST")]
    mixture: Option<Mixture>,
    /// Robot to roll out
    #[arg(long, default_value = "anymal_d")]
    robot: String,
    #[command(flatten)]
    shared: Shared,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(super) enum KindArg {
    /// Share of rollouts from a pose that reach the horizon
    Viability,
    /// Cost of transport of one rollout
    Cot,
}

impl From<KindArg> for Kind {
    fn from(kind: KindArg) -> Self {
        match kind {
            KindArg::Viability => Self::Viability,
            KindArg::Cot => Self::Cot,
        }
    }
}

fn parse_shard(text: &str) -> Result<Shard, String> {
    Shard::parse(text).ok_or_else(|| format!("found {text:?}, wanted I/N with I from 1 to N, such as 1/4"))
}

pub(crate) fn run(args: Args) -> anyhow::Result<Exit> {
    let kind = Kind::from(args.kind);
    ensure!(args.samples > 0, "--samples: found 0, wanted 1 or more");
    ensure!(args.rows_per_shard > 0, "--rows-per-shard: found 0, wanted 1 or more");
    args.noise.check()?;
    let rolled = Rolled::load(&args.robot, &args.skill)?;
    let config = CollectConfig {
        repeats: if kind == Kind::Viability { args.repeats } else { 1 },
        plant: args.plant.into(),
        field_noise_m: args.noise.field_noise_m,
        patch_noise_m: args.noise.patch_noise_m,
        mixture: args.mixture.clone().unwrap_or_default(),
        ..CollectConfig::new(kind, args.shared.seed).for_skill(&rolled.loaded.manifest.rollout)
    };
    let collection = Collection {
        robot: &rolled.robot,
        skill: &rolled.skill,
        kind,
        config: &config,
        layout: Layout { rows: args.samples, rows_per_shard: args.rows_per_shard },
        shard: args.shard,
        threads: args.threads,
        resume: args.resume,
        plugin_source_sha256: rolled.plugin_source_sha256()?,
    };
    let folder = args.out.join(&args.skill).join(kind.id());
    let command = command(&args, kind);
    let log = RunLog {
        command: command.clone(),
        shard: args.shard.to_string(),
        threads: args.threads,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        plugin_sha256: rolled.skill.library().sha256().to_owned(),
    };
    log.append(&folder)?;
    let bar = progress::bar(&format!("{} {}", args.skill, kind.id()), collection.rows_of_shard());
    let collected = collection.run(&folder, &|rows| bar.inc(rows));
    bar.finish_and_clear();
    let collected = collected?;
    if collected.rows_stored == 0 && collected.rows_drawn > 0 {
        bail!("{}: none of {} rollouts ended without a crash", folder.display(), collected.rows_drawn);
    }
    report(&args, kind, &folder, &command, collected)?;
    Ok(Exit::Fine)
}

fn report(
    args: &Args,
    kind: Kind,
    folder: &std::path::Path,
    command: &str,
    collected: Collected,
) -> anyhow::Result<()> {
    let Collected { shards_written, shards_kept, rows_drawn, rows_stored } = collected;
    if args.shared.json {
        output::json(&json!({
            "command": command,
            "seed": args.shared.seed,
            "version": env!("CARGO_PKG_VERSION"),
            "skill": args.skill,
            "kind": kind.id(),
            "folder": folder,
            "samples": args.samples,
            "rows_drawn": rows_drawn,
            "rows_stored": rows_stored,
            "shards_written": shards_written,
            "shards_kept": shards_kept,
        }))?;
    } else {
        output::line(&format!(
            "{}: {rows_stored} of {rows_drawn} rows stored in {shards_written} shards, {shards_kept} shards kept\n{command}",
            folder.display()
        ))?;
    }
    Ok(())
}

/// The command that repeats the data set, on any number of threads.
fn command(args: &Args, kind: Kind) -> String {
    let repeats =
        if kind == Kind::Viability { format!(" --repeats {}", args.repeats) } else { String::new() };
    let shard = match args.rows_per_shard {
        ROWS_PER_SHARD => String::new(),
        rows => format!(" --rows-per-shard {rows}"),
    };
    let plant = if args.plant == Plant::Fast { " --plant fast" } else { "" };
    let mixture = args.mixture.as_ref().map(|mixture| format!(" --mixture {mixture}")).unwrap_or_default();
    format!(
        "vocaloco collect --skill {} --kind {} --samples {} --seed {}{repeats}{shard}{plant}{mixture} {} \
         --robot {} --out {}",
        args.skill,
        kind.id(),
        args.samples,
        args.shared.seed,
        args.noise,
        args.robot,
        args.out.display()
    )
}
