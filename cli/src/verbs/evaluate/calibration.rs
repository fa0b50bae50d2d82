//! `evaluate calibration`: what the predictors say against what rollouts give, by terrain and size.

use std::path::PathBuf;

use anyhow::{Context, ensure};
use serde_json::json;
use vocaloco_core::predictor::backend;
use vocaloco_sim::calibration::{Calibration, Row, Summary};
use vocaloco_sim::evaluate::Query;
use vocaloco_sim::terrain::TerrainKind;

use super::cells::{Actor, cell, missing, query_of};
use super::store::{Store, StoreArgs};
use super::viability::parse_terrain;
use super::{calibration_figures, calibration_page};
use crate::exit::Exit;
use crate::verbs::Shared;
use crate::verbs::noise::NoiseArgs;
use crate::verbs::rolled::{Plant, Rolled};
use crate::{output, progress};

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Skills to compare, each with its two predictors
    #[arg(long, value_delimiter = ',', required = true, value_name = "LIST")]
    skill: Vec<String>,
    /// Terrains, such as `stairs_up,stairs_down`
    #[arg(long, value_delimiter = ',', value_parser = parse_terrain, default_value = "stairs_up", value_name = "LIST")]
    terrain: Vec<TerrainKind>,
    /// Sizes, m
    #[arg(long, alias = "sizes", value_delimiter = ',', default_value = SIZES_M, value_name = "LIST")]
    size_m: Vec<f32>,
    /// Fresh poses for each size, one rollout each
    #[arg(long, default_value_t = 500, value_name = "N")]
    samples: u64,
    /// Plant to roll out on
    #[arg(long, value_enum, default_value_t = Plant::Reference)]
    plant: Plant,
    #[command(flatten)]
    noise: NoiseArgs,
    #[command(flatten)]
    store: StoreArgs,
    /// Robot to roll out
    #[arg(long, default_value = "anymal_d")]
    robot: String,
    /// Also write the tables into this Markdown file
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Also draw collected against predicted, and the reliability diagram, as SVG files in this folder
    #[arg(long, value_name = "FOLDER")]
    figures: Option<PathBuf>,
    #[command(flatten)]
    shared: Shared,
}

/// docs/method.md: steps of 2.5 cm.
const SIZES_M: &str = "0.025,0.05,0.075,0.1,0.125,0.15,0.175,0.2,0.225,0.25,0.275,0.3,0.325,0.35";

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!(args.samples > 0, "--samples: found 0, wanted 1 or more");
    args.noise.check()?;
    for size_m in &args.size_m {
        ensure!((0.0..=2.0).contains(size_m), "--size-m: found {size_m}, wanted 0 to 2");
    }
    let store = args.store.open()?;
    // All are loaded before the first is rolled out: what is missing is said at once.
    let subjects = args.skill.iter().map(|skill| Subject::load(&args.robot, skill));
    let subjects = subjects.collect::<anyhow::Result<Vec<_>>>()?;
    let pieces = args.samples * (args.size_m.len() * args.terrain.len()) as u64;
    let (mut rows, mut summaries) = (Vec::new(), Vec::new());
    for subject in &subjects {
        let bar = progress::bar(&subject.actor.id.name, pieces);
        let calibration = subject.measure(args, &store, &|| bar.inc(1));
        bar.finish_and_clear();
        let calibration = calibration?;
        rows.extend(calibration.rows());
        summaries.extend(calibration.summaries());
    }
    report(args, &rows, &summaries)?;
    Ok(Exit::Fine)
}

struct Subject {
    rolled: Rolled,
    actor: Actor,
}

impl Subject {
    fn load(robot: &str, name: &str) -> anyhow::Result<Self> {
        let rolled = Rolled::load(robot, name)?;
        for (kind, predictor) in [("viability", &rolled.loaded.viability), ("cot", &rolled.loaded.cot)] {
            ensure!(predictor.is_some(), missing(name, kind));
        }
        let actor = Actor::new(&rolled.installation, &rolled.loaded, &rolled.robot)?;
        Ok(Self { rolled, actor })
    }

    fn measure(
        &self,
        args: &Args,
        (store, threads): &(Store, usize),
        progress: &(dyn Fn() + Sync),
    ) -> anyhow::Result<Calibration> {
        let Rolled { installation, robot, loaded, .. } = &self.rolled;
        let mut cells = Vec::new();
        for terrain in &args.terrain {
            for size_m in &args.size_m {
                let query = Query {
                    patch_noise_m: args.noise.patch_noise_m,
                    field_noise_m: args.noise.field_noise_m,
                    plant: args.plant.into(),
                    ..Query::new(*terrain, *size_m, args.samples, args.shared.seed)
                };
                let (query, store) = (query_of(loaded, query), (store, *threads));
                cells.push(cell(store, installation, robot, &self.actor, &query, progress)?);
            }
        }
        Ok(Calibration::of(&self.actor.id.name, cells))
    }
}

fn report(args: &Args, rows: &[Row], summaries: &[Summary]) -> anyhow::Result<()> {
    let command = command(args);
    if let Some(file) = &args.markdown {
        let page = calibration_page::page(rows, summaries, &command, &conditions(args));
        std::fs::write(file, page).with_context(|| file.display().to_string())?;
    }
    if let Some(folder) = &args.figures {
        for file in calibration_figures::write(folder, rows, summaries)? {
            eprintln!("{}", file.display());
        }
    }
    if args.shared.json {
        output::json(&json!({
            "command": command,
            "seed": args.shared.seed,
            "version": env!("CARGO_PKG_VERSION"),
            "backend": backend().name,
            "rows": rows,
            "summary": summaries,
        }))?;
        return Ok(());
    }
    output::line(calibration_page::tables(rows, summaries).trim_end())?;
    output::line(&format!("\n{}\n{command}", conditions(args)))?;
    Ok(())
}

/// What the numbers were measured under, in one line.
fn conditions(args: &Args) -> String {
    format!(
        "n = {} fresh poses a size, one rollout each; seed {}; {} plant; field noise ±{} m, patch noise ±{} m; \
         models run by {}.",
        args.samples,
        args.shared.seed,
        plant(args.plant),
        args.noise.field_noise_m,
        args.noise.patch_noise_m,
        backend().name,
    )
}

/// The command that repeats the tables, on any number of threads.
fn command(args: &Args) -> String {
    let list = |items: &mut dyn Iterator<Item = String>| items.collect::<Vec<_>>().join(",");
    format!(
        "vocaloco evaluate calibration --skill {} --terrain {} --size-m {} --samples {} --plant {} \
         {} --robot {} --seed {}",
        args.skill.join(","),
        list(&mut args.terrain.iter().map(ToString::to_string)),
        list(&mut args.size_m.iter().map(ToString::to_string)),
        args.samples,
        plant(args.plant),
        args.noise,
        args.robot,
        args.shared.seed
    )
}

fn plant(plant: Plant) -> &'static str {
    match plant {
        Plant::Reference => "reference",
        Plant::Fast => "fast",
    }
}
