//! `data`: shows what a data set holds, scores a model on it, and merges parts that were collected apart.

mod histogram;
mod score;
mod show;

use std::path::PathBuf;

use serde_json::json;
use vocaloco_sim::dataset;

use super::Shared;
use crate::{exit::Exit, output};

#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Rows, labels and what is missing, by terrain and difficulty; histograms and a picture
    Show {
        /// Folder with meta.json, such as data/walk/viability
        folder: PathBuf,
        /// Also draw sample fields with their labels into this SVG
        #[arg(long, value_name = "FILE")]
        picture: Option<PathBuf>,
        #[command(flatten)]
        shared: Shared,
    },
    /// A model's predictions against the labels of a data set that it was not fitted to
    Score {
        /// Folder with meta.json
        folder: PathBuf,
        /// The model, such as skills/walk/viability.onnx
        #[arg(long, value_name = "FILE")]
        model: PathBuf,
        /// Shares of unsafe terrain for which thresholds are computed, with 95 % confidence; needs viability
        #[arg(long, value_delimiter = ',', value_name = "LIST")]
        alpha: Vec<f64>,
        /// Terrain is unsafe, for those thresholds, where a smaller share of the rollouts succeeds
        #[arg(long, default_value_t = 0.5, value_name = "SHARE")]
        required_viability: f32,
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
        What::Show { folder, picture, shared } => show::run(&folder, picture.as_deref(), shared),
        What::Score { folder, model, alpha, required_viability, shared } => {
            score::run(&folder, &model, &score::Risks { alpha, required_viability }, shared)
        }
        What::Merge { folders, into, shared } => {
            let copied = dataset::merge(&folders, &into)?;
            let dataset::Stored { rows, shards_missing } = dataset::stored(&into)?;
            if shared.json {
                output::json(&json!({
                    "command": format!("vocaloco data merge --into {}", into.display()),
                    "seed": dataset::Meta::read(&into)?.config.seed,
                    "version": env!("CARGO_PKG_VERSION"),
                    "folder": into,
                    "shards_copied": copied,
                    "shards_missing": shards_missing,
                    "rows_stored": rows,
                }))?;
            } else {
                output::line(&format!(
                    "{}: {copied} shards copied, {rows} rows, {shards_missing} shards missing",
                    into.display()
                ))?;
            }
            Ok(if shards_missing == 0 { Exit::Fine } else { Exit::Finding })
        }
    }
}
