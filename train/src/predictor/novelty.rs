//! `novelty`: what the check of terrain never seen finds, told on terrain that it was not fitted to.

mod made;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use serde::Serialize;
use vocaloco_core::heightfield::{CENTRE, COLUMNS};
use vocaloco_core::predictor::known_terrain::KnownTerrain;
use vocaloco_sim::collect::{CollectConfig, field_noise};
use vocaloco_sim::dataset::{self, Dataset};
use vocaloco_sim::scene::row_seed;
use vocaloco_sim::terrain::TerrainKind;

use super::kernel::FieldCells;
use super::known::{self, Flags};
use super::samples::{Part, Sample, part};

/// How much known terrain the check flags, and how much that it was not fitted to.
///
/// Fits the check of `train` to a data set without the kinds left out, then counts what it flags: of the
/// known kinds the rows kept back, of the others all rows, by size, and terrain made here: cells that
/// are noise alone, and rolling, broken ground as an elevation map of a real place shows it. Each field
/// is told with the fields' noise and without. No rollout is needed: the data set has the fields.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Skill whose viability data set has the fields.
    #[arg(long, default_value = "walk")]
    skill: String,
    /// Folder of data sets, as `collect` writes it.
    #[arg(long, default_value = "data")]
    data: PathBuf,
    /// Terrain kinds that the check is not fitted to.
    #[arg(long, value_delimiter = ',', default_value = "wall,gap", value_parser = terrain, value_name = "LIST")]
    leave_out: Vec<TerrainKind>,
    /// Fields of each kind that is made here.
    #[arg(long, default_value_t = 500, value_name = "N")]
    samples: u64,
    /// Seed of what is made here.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

fn terrain(text: &str) -> Result<TerrainKind, String> {
    TerrainKind::from_id(text).ok_or_else(|| format!("found {text:?}, wanted a terrain's id"))
}

/// What is flagged of one kind.
#[derive(Debug, Serialize)]
struct Row {
    /// `known`, `left_out` or `made`.
    from: &'static str,
    terrain: String,
    /// Sizes, from and up to, m; none where all are together.
    size_m: Option<[f32; 2]>,
    n: usize,
    flagged: usize,
    flagged_without_noise: usize,
}

/// Runs the verb.
///
/// # Errors
/// No data, or none of the known kinds.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let folder = args.data.join(&args.skill).join("viability");
    let set = dataset::read(&folder)?;
    let is_known = |at: &usize| !args.leave_out.contains(&set.terrain[*at]);
    let sample = |at: usize| Sample { row: set.rows[at], field: set.fields[at], label: 0.0 };
    let known: Vec<Sample> = (0..set.len()).filter(is_known).map(sample).collect();
    let fitted = known::fit(&known)
        .with_context(|| format!("{}: found too few rows of known terrain", folder.display()))?;
    let check = &fitted.known;
    let mut rows = of_data(&set, args, check);
    rows.extend(made::all(args.samples, args.seed, set.meta.config.field_noise_m).into_iter().map(
        |(name, noisy, clean)| {
            Row::count("made", name.to_owned(), None, check, &noisy.iter().collect::<Vec<_>>(), &clean)
        },
    ));
    print(args, &rows)?;
    Ok(ExitCode::SUCCESS)
}

impl Row {
    fn count(
        from: &'static str,
        terrain: String,
        size_m: Option<[f32; 2]>,
        check: &KnownTerrain,
        noisy: &[&FieldCells],
        clean: &[FieldCells],
    ) -> Self {
        let Flags { n, flagged } = Flags::count(check, noisy.iter().copied());
        let flagged_without_noise = Flags::count(check, clean.iter()).flagged;
        Self { from, terrain, size_m, n, flagged, flagged_without_noise }
    }
}

/// Known kinds, their rows kept back, then the kinds left out by quarters of their range.
fn of_data(set: &Dataset, args: &Args, check: &KnownTerrain) -> Vec<Row> {
    let mut groups: BTreeMap<(bool, &str, usize), Vec<usize>> = BTreeMap::new();
    for at in 0..set.len() {
        let kind = set.terrain[at];
        let is_left_out = args.leave_out.contains(&kind);
        let [low, high] = kind.range_m();
        let quarter = (4.0 * (set.size_m[at] - low) / (high - low).max(1e-6)) as usize;
        if is_left_out || part(set.rows[at]) == Part::KeptBack {
            let quarter = if is_left_out { quarter.min(3) } else { 0 };
            groups.entry((is_left_out, kind.id(), quarter)).or_default().push(at);
        }
    }
    let row = |((is_left_out, id, quarter), rows): ((bool, &str, usize), Vec<usize>)| {
        let size_m = TerrainKind::from_id(id).filter(|_| is_left_out).map(|kind| {
            let [low, high] = kind.range_m();
            [quarter, quarter + 1].map(|end| low + (high - low) * end as f32 / 4.0)
        });
        let noisy: Vec<&FieldCells> = rows.iter().map(|at| &set.fields[*at]).collect();
        let clean: Vec<FieldCells> =
            rows.iter().map(|at| without_noise(&set.fields[*at], set.rows[*at], &set.meta.config)).collect();
        let from = if is_left_out { "left_out" } else { "known" };
        Row::count(from, id.to_owned(), size_m, check, &noisy, &clean)
    };
    groups.into_iter().map(row).collect()
}

/// A row's field less the noise that was added when it was collected.
fn without_noise(field: &FieldCells, row: u64, config: &CollectConfig) -> FieldCells {
    let noise = field_noise(config.field_noise_m, row_seed(config.seed, row));
    let centre = noise[CENTRE[0]][CENTRE[1]];
    let mut field = *field;
    for (cell, noise) in field.iter_mut().zip(noise.as_flattened()) {
        *cell -= noise - centre;
    }
    debug_assert!(field[CENTRE[0] * COLUMNS + CENTRE[1]].abs() < 1e-5);
    field
}

#[expect(clippy::print_stdout, reason = "the verb's result")]
fn print(args: &Args, rows: &[Row]) -> anyhow::Result<()> {
    let left_out: Vec<&str> = args.leave_out.iter().map(|kind| kind.id()).collect();
    let command = format!(
        "vocaloco evaluate novelty --skill {} --data {} --leave-out {} --samples {} --seed {}",
        args.skill,
        args.data.display(),
        left_out.join(","),
        args.samples,
        args.seed
    );
    if args.json {
        let result = serde_json::json!({
            "command": command,
            "seed": args.seed,
            "version": env!("CARGO_PKG_VERSION"),
            "rows": rows,
        });
        println!("{}", serde_json::to_string_pretty(&result)?);
        return Ok(());
    }
    println!("| terrain | size (m) | n | flagged | without the fields' noise |\n|---|---|---|---|---|");
    for row in rows {
        let size = row.size_m.map_or("all".to_owned(), |[low, high]| format!("{low:.2} to {high:.2}"));
        let share = |flagged: usize| 100.0 * flagged as f64 / row.n as f64;
        println!(
            "| {} ({}) | {size} | {} | {:.1} % | {:.1} % |",
            row.terrain,
            row.from.replace('_', " "),
            row.n,
            share(row.flagged),
            share(row.flagged_without_noise)
        );
    }
    let known = || rows.iter().filter(|row| row.from == "known");
    let sum = |count: fn(&Row) -> usize| known().map(count).sum::<usize>();
    println!(
        "\nof {} known fields {} are flagged, {} without the fields' noise\n{command}",
        sum(|row| row.n),
        sum(|row| row.flagged),
        sum(|row| row.flagged_without_noise)
    );
    Ok(())
}
