//! `data show`: what a data set holds, in tables and a picture.

use std::{collections::BTreeMap, path::Path};

use anyhow::Context;
use serde::Serialize;
use serde_json::json;
use vocaloco_sim::{
    dataset::{self, Dataset, Kind},
    terrain::TerrainKind,
};

use super::histogram::{self, Histogram};
use crate::{exit::Exit, output, report, verbs::Shared};

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

pub(super) fn run(folder: &Path, picture: Option<&Path>, shared: Shared) -> anyhow::Result<Exit> {
    let (data, missing) = dataset::read_incomplete(folder)?;
    let (bands, histograms) = (bands(&data), Histogram::by_terrain(&data));
    if let Some(path) = picture {
        let title =
            format!("{} {}, seed {}", data.meta.skill.name, data.meta.kind.id(), data.meta.config.seed);
        let svg = report::fields(&title, data.meta.kind, &samples(&data));
        std::fs::write(path, svg).with_context(|| path.display().to_string())?;
    }
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
            "histograms": histograms,
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
        output::line(&histogram::table(meta.kind, &histograms))?;
    }
    Ok(if missing.is_empty() { Exit::Fine } else { Exit::Finding })
}

fn band_of(data: &Dataset, row: usize) -> usize {
    ((data.terrain[row].difficulty(data.size_m[row]) * BANDS as f32) as usize).min(BANDS - 1)
}

/// The first row for training in each band, by terrain.
fn samples(data: &Dataset) -> Vec<report::FieldRow<'_>> {
    let mut rows: BTreeMap<TerrainKind, [Option<report::SampleField<'_>>; BANDS]> = BTreeMap::new();
    for row in (0..data.len()).filter(|row| data.trainable[*row]) {
        let sample = &mut rows.entry(data.terrain[row]).or_default()[band_of(data, row)];
        if sample.is_none() {
            let (field_m, label, size_m) = (&data.fields[row], data.labels[row], data.size_m[row]);
            *sample = Some(report::SampleField { field_m, label, size_m });
        }
    }
    rows.into_iter().map(|(terrain, samples)| (terrain, samples.to_vec())).collect()
}

fn bands(data: &Dataset) -> Vec<Band> {
    let mut rows: BTreeMap<(TerrainKind, usize), Vec<usize>> = BTreeMap::new();
    for row in 0..data.len() {
        rows.entry((data.terrain[row], band_of(data, row))).or_default().push(row);
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
