//! `evaluate agreement`: whether the fast plant gives the labels that the reference gives.

use std::{fmt::Write, path::PathBuf};

use anyhow::{Context, ensure};
use serde::Serialize;
use vocaloco_sim::{
    collect::CollectConfig,
    dataset::Kind,
    evaluate::Query,
    plant_agreement::{COT_PERCENT, PlantAgreement, VIABILITY_POINTS, plant_agreement},
    terrain::TerrainKind,
    threads::with_threads,
};

use super::viability::parse_terrain;
use crate::{
    exit::Exit,
    output, progress,
    verbs::{Shared, rolled::Rolled},
};

/// The same rows on both plants: difference in viability, in points, and in mean cost of transport over
/// the rows that reach the horizon on both, in percent, with 95 % intervals.
///
/// A size agrees within 3 points and 3 %; exit code 1 says that one does not.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Skill to roll out; it needs no predictors
    #[arg(long)]
    skill: String,
    /// Terrains, such as `stairs_up,stairs_down`
    #[arg(long, value_delimiter = ',', value_parser = parse_terrain, required = true, value_name = "LIST")]
    terrain: Vec<TerrainKind>,
    /// Sizes, m
    #[arg(long, value_delimiter = ',', default_value = "0", value_name = "LIST")]
    size_m: Vec<f32>,
    /// Rows for each size, one rollout each on each plant
    #[arg(long, default_value_t = 500, value_name = "N")]
    samples: u64,
    /// Threads; 0 for as many as there are processors
    #[arg(long, default_value_t = 0, value_name = "N")]
    threads: usize,
    /// Robot to roll out
    #[arg(long, default_value = "anymal_d")]
    robot: String,
    /// Also write the table into this Markdown file
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    #[command(flatten)]
    shared: Shared,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'a> {
    command: String,
    seed: u64,
    version: &'static str,
    limit_points: f64,
    limit_percent: f64,
    rows: &'a [PlantAgreement],
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!(args.samples > 0, "--samples: found 0, wanted 1 or more");
    for size_m in &args.size_m {
        ensure!((0.0..=2.0).contains(size_m), "--size-m: found {size_m}, wanted 0 to 2");
    }
    let rolled = Rolled::load(&args.robot, &args.skill)?;
    let rules = CollectConfig::new(Kind::Viability, 0).for_skill(&rolled.loaded.manifest.rollout).rollout;
    let cells = args.terrain.iter().flat_map(|terrain| args.size_m.iter().map(|size_m| (*terrain, *size_m)));
    let pieces = 2 * args.samples * (args.terrain.len() * args.size_m.len()) as u64;
    let bar = progress::bar(&format!("{} on both plants", args.skill), pieces);
    let rows = cells.map(|(terrain, size_m)| {
        let query = Query { rules, ..Query::new(terrain, size_m, args.samples, args.shared.seed) };
        let progress = || bar.inc(1);
        Ok(with_threads(args.threads, || plant_agreement(&rolled.robot, &rolled.skill, &query, &progress))??)
    });
    let rows = rows.collect::<anyhow::Result<Vec<PlantAgreement>>>();
    bar.finish_and_clear();
    let rows = rows?;
    report(args, &rows)?;
    Ok(if rows.iter().all(|row| row.agrees) { Exit::Fine } else { Exit::Finding })
}

fn report(args: &Args, rows: &[PlantAgreement]) -> anyhow::Result<()> {
    let command = command(args);
    let table = table(rows);
    if let Some(file) = &args.markdown {
        std::fs::write(file, format!("{table}\n`{command}`\n"))
            .with_context(|| file.display().to_string())?;
    }
    if args.shared.json {
        let (seed, version) = (args.shared.seed, env!("CARGO_PKG_VERSION"));
        let (limit_points, limit_percent) = (VIABILITY_POINTS, COT_PERCENT);
        output::json(&Report { command, seed, version, limit_points, limit_percent, rows })?;
    } else {
        output::line(&table)?;
        output::line(&command)?;
    }
    Ok(())
}

/// The table in Markdown.
fn table(rows: &[PlantAgreement]) -> String {
    let mut table = "| skill | terrain | size, m | n | viable, reference | viable, fast | points (95 %) | CoT, reference \
                     | CoT, fast | percent (95 %) | agrees |\n|---|---|---|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    for row in rows {
        let viability = &row.viability;
        let cost = row.cot.map_or_else(
            || "- | - | -".to_owned(),
            |cot| {
                format!(
                    "{:.3} | {:.3} | {:+.1} ({:+.1} to {:+.1})",
                    cot.reference, cot.fast, cot.percent, cot.percent_low, cot.percent_high
                )
            },
        );
        let _ = writeln!(
            table,
            "| {} | {} | {} | {} | {:.3} | {:.3} | {:+.1} ({:+.1} to {:+.1}) | {cost} | {} |",
            row.skill,
            row.terrain,
            row.size_m,
            viability.n,
            row.viable_reference,
            row.viable_fast,
            viability.points,
            viability.points_low,
            viability.points_high,
            if row.agrees { "yes" } else { "no" }
        );
    }
    table
}

/// The command that repeats the table, on any number of threads.
fn command(args: &Args) -> String {
    let sizes: Vec<String> = args.size_m.iter().map(ToString::to_string).collect();
    let terrains: Vec<&str> = args.terrain.iter().map(|terrain| terrain.id()).collect();
    format!(
        "vocaloco evaluate agreement --skill {} --terrain {} --size-m {} --samples {} --robot {} --seed {}",
        args.skill,
        terrains.join(","),
        sizes.join(","),
        args.samples,
        args.robot,
        args.shared.seed
    )
}
