//! `data`: shows what a data set holds, and merges parts that were collected apart.

use std::{collections::BTreeMap, path::PathBuf};

use serde::Serialize;
use serde_json::json;
use vocaloco_sim::{
    dataset::{self, Dataset, Kind},
    terrain::TerrainKind,
};

use super::Shared;
use crate::{exit::Exit, output};

#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Rows, labels and what is missing, by terrain and difficulty
    Show {
        /// Folder with meta.json, such as data/walk/viability
        folder: PathBuf,
        #[command(flatten)]
        shared: Shared,
    },
    /// Bring the shards of several data sets of the same make into one folder
    Merge {
        /// Folders with meta.json
        #[arg(required = true)]
        folders: Vec<PathBuf>,
        /// Folder that takes all their shards
        #[arg(long, value_name = "FOLDER")]
        into: PathBuf,
        #[command(flatten)]
        shared: Shared,
    },
}

pub(crate) fn run(args: Args) -> anyhow::Result<Exit> {
    match args.what {
        What::Show { folder, shared } => show(&folder, shared),
        What::Merge { folders, into, shared } => {
            let copied = dataset::merge(&folders, &into)?;
            let (merged, missing) = dataset::read_incomplete(&into)?;
            if shared.json {
                output::json(&json!({
                    "command": format!("vocaloco data merge --into {}", into.display()),
                    "seed": merged.meta.config.seed,
                    "version": env!("CARGO_PKG_VERSION"),
                    "folder": into,
                    "shards_copied": copied,
                    "shards_missing": missing.len(),
                    "rows_stored": merged.len(),
                }))?;
            } else {
                output::line(&format!(
                    "{}: {copied} shards copied, {} rows, {} shards missing",
                    into.display(),
                    merged.len(),
                    missing.len()
                ))?;
            }
            Ok(if missing.is_empty() { Exit::Fine } else { Exit::Finding })
        }
    }
}

/// Rows of a terrain in a band of difficulty.
#[derive(Serialize)]
struct Band {
    terrain: TerrainKind,
    size_from_m: f32,
    size_to_m: f32,
    rows: usize,
    trainable: usize,
    label_mean: Option<f64>,
    spawn_attempts_mean: f64,
}

/// Bands to a terrain's range.
const BANDS: usize = 5;

fn show(folder: &std::path::Path, shared: Shared) -> anyhow::Result<Exit> {
    let (data, missing) = dataset::read_incomplete(folder)?;
    let bands = bands(&data);
    let meta = &data.meta;
    if shared.json {
        output::json(&json!({
            "command": format!("vocaloco data show {}", folder.display()),
            "seed": meta.config.seed,
            "version": env!("CARGO_PKG_VERSION"),
            "skill": meta.skill.name,
            "kind": meta.kind,
            "rows": meta.rows,
            "rows_stored": data.len(),
            "shards_missing": missing.len(),
            "bands": bands,
        }))?;
    } else {
        output::line(&format!(
            "{} {}: {} of {} rows stored, seed {}, {} shards missing",
            meta.skill.name,
            meta.kind.id(),
            data.len(),
            meta.rows,
            meta.config.seed,
            missing.len()
        ))?;
        if meta.kind == Kind::Cot {
            output::line("rows whose rollout crashed are not stored; means are over rows for training")?;
        }
        output::line("terrain       size              rows  for training  mean label  poses drawn")?;
        for band in &bands {
            let label = band.label_mean.map_or_else(|| "-".to_owned(), |mean| format!("{mean:.3}"));
            output::line(&format!(
                "{:<12}  {:.3} to {:.3} m  {:>6}  {:>12}  {label:>10}  {:>11.1}",
                band.terrain.id(),
                band.size_from_m,
                band.size_to_m,
                band.rows,
                band.trainable,
                band.spawn_attempts_mean
            ))?;
        }
    }
    Ok(if missing.is_empty() { Exit::Fine } else { Exit::Finding })
}

fn bands(data: &Dataset) -> Vec<Band> {
    let mut rows: BTreeMap<(TerrainKind, usize), Vec<usize>> = BTreeMap::new();
    for row in 0..data.len() {
        let terrain = data.terrain[row];
        let band = (terrain.difficulty(data.size_m[row]) * BANDS as f32) as usize;
        rows.entry((terrain, band.min(BANDS - 1))).or_default().push(row);
    }
    rows.into_iter()
        .map(|((terrain, band), rows)| {
            let edge = |edge: usize| terrain.size_m(edge as f32 / BANDS as f32);
            let trained: Vec<usize> = rows.iter().copied().filter(|row| data.trainable[*row]).collect();
            let labels: f64 = trained.iter().map(|row| f64::from(data.labels[*row])).sum();
            let attempts: f64 = rows.iter().map(|row| f64::from(data.spawn_attempts[*row])).sum();
            Band {
                terrain,
                size_from_m: edge(band),
                size_to_m: edge(band + 1),
                label_mean: (!trained.is_empty()).then(|| labels / trained.len() as f64),
                trainable: trained.len(),
                spawn_attempts_mean: attempts / rows.len() as f64,
                rows: rows.len(),
            }
        })
        .collect()
}
