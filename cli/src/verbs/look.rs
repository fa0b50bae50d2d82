//! `look`: one rollout of a skill as pictures.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail, ensure};
use serde::Serialize;
use vocaloco_sim::{
    evaluate::Query,
    plant::PlantKind,
    rollout::{Outcome, Rollout, RolloutRules},
    spawn::SpawnRules,
    terrain::TerrainKind,
    watched::{Watched, watch},
};

use crate::{
    exit::Exit,
    output,
    report::{page, strip},
    verbs::{
        Shared,
        evaluate::parse_terrain,
        rolled::{Plant, Rolled},
    },
};

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Skill to look at; it needs no predictors
    #[arg(long)]
    skill: String,
    /// flat, rough, slope, discrete, `stairs_up`, `stairs_down`, wall or gap
    #[arg(long, value_parser = parse_terrain)]
    terrain: TerrainKind,
    /// Its size, m: step or obstacle height, gap width, roughness; rise per metre of a slope
    #[arg(long, default_value_t = 0.0, value_name = "M")]
    size_m: f32,
    /// Distance to watch, m, in proportion to 1.5 m in 4 s
    #[arg(long, default_value_t = 1.5, value_name = "M")]
    horizon_m: f64,
    /// Which pose of the seed
    #[arg(long, default_value_t = 0, value_name = "N")]
    pose: u64,
    /// Frames of the strip, at equal times
    #[arg(long, default_value_t = 8, value_name = "N")]
    frames: usize,
    /// Plant to roll out on
    #[arg(long, value_enum, default_value_t = Plant::Reference)]
    plant: Plant,
    /// Where the strip goes, an SVG
    #[arg(long, default_value = "out/look.svg", value_name = "FILE")]
    out: PathBuf,
    /// Where a page with the moving picture goes, if anywhere
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    /// Robot to roll out
    #[arg(long, default_value = "anymal_d")]
    robot: String,
    #[command(flatten)]
    shared: Shared,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    let Args { size_m, horizon_m, frames, .. } = *args;
    ensure!((0.0..=2.0).contains(&size_m), "--size-m: found {size_m}, wanted 0 to 2");
    ensure!((0.1..=4.0).contains(&horizon_m), "--horizon-m: found {horizon_m}, wanted 0.1 to 4");
    ensure!((1..=40).contains(&frames), "--frames: found {frames}, wanted 1 to 40");
    for (option, file, wanted) in [("--out", Some(&args.out), "svg"), ("--page", args.page.as_ref(), "html")]
    {
        let fits = |file: &PathBuf| file.extension().is_some_and(|found| found == wanted);
        if let Some(file) = file.filter(|file| !fits(file)) {
            bail!("{option}: found {}, wanted a file that ends in .{wanted}", file.display());
        }
    }
    let rolled = Rolled::load(&args.robot, &args.skill)?;
    let own = RolloutRules::of(&rolled.loaded.manifest.rollout);
    let query = Query {
        rules: RolloutRules { horizon_m, time_limit_s: own.time_limit_s * horizon_m / own.horizon_m, ..own },
        spawn: SpawnRules { yaw_rad: 0.1, any_yaw_share: 0.0, ..SpawnRules::default() },
        plant: args.plant.into(),
        ..Query::new(args.terrain, size_m, 1, args.shared.seed)
    };
    let watched = watch(&rolled.robot, &rolled.skill, &query, args.pose)?;
    let (title, command) = (title(args, &watched), command(args));
    write(&args.out, &strip(&rolled.robot, &watched, &title, frames))?;
    if let Some(file) = &args.page {
        write(file, &page(&rolled.robot, &watched, [&args.skill, &title, &command])?)?;
    }
    if args.shared.json {
        let Rollout { outcome, distance_m, duration_s, .. } = watched.rollout;
        let (seed, version) = (args.shared.seed, env!("CARGO_PKG_VERSION"));
        output::json(&Report { command, seed, version, outcome, distance_m, duration_s })?;
    } else {
        output::line(&title)?;
        output::line(&command)?;
    }
    Ok(Exit::Fine)
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    command: String,
    seed: u64,
    version: &'static str,
    outcome: Outcome,
    distance_m: f64,
    duration_s: f64,
}

fn write(file: &Path, content: &str) -> anyhow::Result<()> {
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder).with_context(|| format!("{}", folder.display()))?;
    }
    fs::write(file, content).with_context(|| format!("{}", file.display()))
}

/// What one sees.
fn title(args: &Args, watched: &Watched) -> String {
    let size = match args.terrain {
        TerrainKind::Flat => String::new(),
        TerrainKind::Slope => format!(" of {}", args.size_m),
        _ => format!(" of {} cm", (args.size_m * 100.0 * 10.0).round() / 10.0),
    };
    let rollout = &watched.rollout;
    format!(
        "{} on {}{size}: {} after {:.2} m and {:.2} s",
        args.skill,
        args.terrain,
        rollout.outcome.id(),
        rollout.distance_m,
        rollout.duration_s
    )
}

/// The command that repeats the picture.
fn command(args: &Args) -> String {
    format!(
        "vocaloco look --skill {} --terrain {} --size-m {} --horizon-m {} --pose {} --frames {} --plant {} \
         --out {} --robot {} --seed {}",
        args.skill,
        args.terrain,
        args.size_m,
        args.horizon_m,
        args.pose,
        args.frames,
        PlantKind::from(args.plant).id(),
        args.out.display(),
        args.robot,
        args.shared.seed
    )
}
