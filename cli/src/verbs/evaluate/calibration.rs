//! `evaluate calibration`: what the predictors say against what rollouts give, by terrain and size.

use std::path::PathBuf;

use anyhow::{Context, anyhow, ensure};
use serde_json::json;
use vocaloco_core::predictor::backend;
use vocaloco_sim::calibration::{Calibration, Predictors, Row, Summary};
use vocaloco_sim::collect::CollectConfig;
use vocaloco_sim::dataset::Kind;
use vocaloco_sim::evaluate::Query;
use vocaloco_sim::rollout::RolledSkill;
use vocaloco_sim::terrain::TerrainKind;
use vocaloco_sim::threads::with_threads;

use super::viability::parse_terrain;
use super::{calibration_figures, calibration_page};
use crate::exit::Exit;
use crate::verbs::Shared;
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
    /// Uniform noise on every height that the predictors see, ± metres
    #[arg(long, default_value_t = 0.1, value_name = "M")]
    field_noise_m: f32,
    /// Uniform noise on every height that the plugin sees, ± metres
    #[arg(long, default_value_t = 0.02, value_name = "M")]
    patch_noise_m: f32,
    /// Threads; 0 for as many as there are processors
    #[arg(long, default_value_t = 0, value_name = "N")]
    threads: usize,
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

/// METHOD, section 6: steps of 2.5 cm.
const SIZES_M: &str = "0.025,0.05,0.075,0.1,0.125,0.15,0.175,0.2,0.225,0.25,0.275,0.3,0.325,0.35";

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!(args.samples > 0, "--samples: found 0, wanted 1 or more");
    for (flag, noise_m) in [("field-noise-m", args.field_noise_m), ("patch-noise-m", args.patch_noise_m)] {
        ensure!((0.0..=1.0).contains(&noise_m), "--{flag}: found {noise_m}, wanted 0 to 1");
    }
    for size_m in &args.size_m {
        ensure!((0.0..=2.0).contains(size_m), "--size-m: found {size_m}, wanted 0 to 2");
    }
    // All are loaded before the first is rolled out: what is missing is said at once.
    let subjects = args.skill.iter().map(|skill| Subject::load(&args.robot, skill));
    let mut subjects = subjects.collect::<anyhow::Result<Vec<_>>>()?;
    let pieces = args.samples * (args.size_m.len() * args.terrain.len()) as u64;
    let (mut rows, mut summaries) = (Vec::new(), Vec::new());
    for subject in &mut subjects {
        let bar = progress::bar(&subject.skill.name, pieces);
        let calibration = subject.measure(args, &|| bar.inc(1));
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
    skill: RolledSkill,
    predictors: Predictors,
}

impl Subject {
    fn load(robot: &str, name: &str) -> anyhow::Result<Self> {
        let mut rolled = Rolled::load(robot, name)?;
        let missing = |kind: &str| {
            anyhow!(
                "skill {name}: found no {kind}.onnx, wanted both predictors; `vocaloco train --skill {name}` makes them"
            )
        };
        let predictors = Predictors {
            viability: rolled.loaded.viability.take().ok_or_else(|| missing("viability"))?,
            cot: rolled.loaded.cot.take().ok_or_else(|| missing("cot"))?,
        };
        let skill = rolled.skill.clone();
        Ok(Self { rolled, skill, predictors })
    }

    fn measure(&mut self, args: &Args, progress: &(dyn Fn() + Sync)) -> anyhow::Result<Calibration> {
        let own =
            CollectConfig::new(Kind::Viability, 0).for_skill(&self.rolled.loaded.manifest.rollout).rollout;
        let mut calibration = Calibration::of(&self.skill.name);
        for terrain in &args.terrain {
            for size_m in &args.size_m {
                let query = Query {
                    rules: own,
                    patch_noise_m: args.patch_noise_m,
                    field_noise_m: args.field_noise_m,
                    plant: args.plant.into(),
                    ..Query::new(*terrain, *size_m, args.samples, args.shared.seed)
                };
                let Self { rolled, skill, predictors } = &mut *self;
                let measured = with_threads(args.threads, || {
                    calibration.measure(&rolled.robot, skill, predictors, &query, progress)
                })?;
                measured.with_context(|| format!("skill {} on {terrain} of {size_m} m", skill.name))?;
            }
        }
        Ok(calibration)
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
        args.field_noise_m,
        args.patch_noise_m,
        backend().name,
    )
}

/// The command that repeats the tables, on any number of threads.
fn command(args: &Args) -> String {
    let list = |items: &mut dyn Iterator<Item = String>| items.collect::<Vec<_>>().join(",");
    format!(
        "vocaloco evaluate calibration --skill {} --terrain {} --size-m {} --samples {} --plant {} \
         --field-noise-m {} --patch-noise-m {} --robot {} --seed {}",
        args.skill.join(","),
        list(&mut args.terrain.iter().map(ToString::to_string)),
        list(&mut args.size_m.iter().map(ToString::to_string)),
        args.samples,
        plant(args.plant),
        args.field_noise_m,
        args.patch_noise_m,
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
