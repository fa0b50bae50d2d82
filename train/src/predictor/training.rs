//! `train`: a skill's data sets → viability.onnx, cot.onnx and their sections of CARD.md.

mod manifest;
mod section;
#[cfg(test)]
mod tests;

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, ensure};
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use vocaloco_core::installation::Installation;
use vocaloco_sim::dataset::META_FILE;
use vocaloco_sim::identity::sha256_hex;
use vocaloco_sim::scores;

use super::data::DataSet;
use super::export::{Origin, onnx, output_name};
use super::fit::{Fitted, Options, answered, fit};
use super::known::{self, Flags};
use super::sgd::Head;
use crate::card;
use crate::files::write_whole;
use vocaloco_sim::promise::{Promise, Risk, promise};

/// Fit a skill's two predictors to its data set.
///
/// Reads `DATA/SKILL/viability` and `DATA/SKILL/cot`, writes `viability.onnx`, `cot.onnx` and
/// `CARD.md` into the skill's folder. The same data and seed give the same bytes.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The skill whose data is fitted.
    #[arg(long)]
    skill: String,
    /// Folder of data sets, as `collect` writes it.
    #[arg(long, default_value = "data")]
    data: PathBuf,
    /// Which of the two predictors.
    #[arg(long, value_enum, default_value_t = Kind::Both)]
    kind: Kind,
    /// Folder to write to instead of the skill's own.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Times that every sample is seen.
    #[arg(long, default_value_t = Options::default().epochs, value_parser = at_least_one)]
    epochs: usize,
    /// Samples per step.
    #[arg(long, default_value_t = Options::default().batch, value_parser = at_least_one)]
    batch: usize,
    /// Step size at the start.
    #[arg(long, default_value_t = Options::default().learning_rate)]
    learning_rate: f32,
    /// Share of the step size left in the last epoch.
    #[arg(long, default_value_t = Options::default().final_rate_share)]
    final_rate_share: f32,
    /// Never exchange left and right.
    #[arg(long)]
    no_mirror: bool,
    /// Shares of unsafe terrain that thresholds are computed for, each to be kept with 95 % confidence.
    #[arg(long, value_delimiter = ',', default_value = "0.01,0.05", value_parser = share, value_name = "LIST")]
    alpha: Vec<f64>,
    /// Terrain is unsafe, for those thresholds, where a smaller share of the rollouts succeeds.
    #[arg(long, default_value_t = 0.5, value_parser = share, value_name = "SHARE")]
    required_viability: f64,
    /// Folder of other data sets, of another seed, from whose rows thresholds are computed instead of from those
    /// kept back; with several rollouts a row, what is unsafe is better known.
    #[arg(long, value_name = "FOLDER")]
    thresholds_from: Option<PathBuf>,
    /// Write the threshold of this α into the skill's manifest.
    #[arg(long, value_parser = share, value_name = "ALPHA")]
    write_threshold: Option<f64>,
    /// Seed of start values, order and mirroring.
    #[arg(long, default_value_t = Options::default().seed)]
    seed: u64,
    /// Threads; all cores by default. Their number changes no bit.
    #[arg(long)]
    threads: Option<usize>,
    /// Print one JSON object on stdout and nothing else there.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    Viability,
    Cot,
    Both,
}

impl Kind {
    fn heads(self) -> &'static [Head] {
        match self {
            Self::Viability => &[Head::Sigmoid],
            Self::Cot => &[Head::Linear],
            Self::Both => &[Head::Sigmoid, Head::Linear],
        }
    }
}

fn at_least_one(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n) if n >= 1 => Ok(n),
        _ => Err(format!("found {text}, wanted a number from 1 up")),
    }
}

fn share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(share) if (1e-6..1.0).contains(&share) => Ok(share),
        _ => Err(format!("found {text}, wanted a share above 0 and below 1")),
    }
}

/// What one model scores, as `--json` tells it.
#[derive(Debug, Serialize)]
struct Report {
    kind: &'static str,
    file: PathBuf,
    sha256: String,
    data_sha256: String,
    n: usize,
    left_out: usize,
    held_out: usize,
    kept_back: usize,
    best_epoch: usize,
    training_mse: f64,
    held_out_mse: f64,
    kept_back_mse: f64,
    brier: Option<f64>,
    ece: Option<f64>,
    auc: Option<f64>,
    mae: Option<f64>,
    r2: Option<f64>,
    /// Of viability: one an α.
    promises: Vec<Promise>,
    /// Of viability: how many of the rows kept back are flagged as terrain never seen.
    flags: Option<Flags>,
}

/// Runs the verb.
///
/// # Errors
/// No data, data of another kind or robot, a fit that diverges, a file that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let folder = match &args.out {
        Some(folder) => folder.clone(),
        None => Installation::find()?.skill_folder(&args.skill),
    };
    ensure!(
        args.write_threshold.is_none() || args.kind != Kind::Cot,
        "--write-threshold: found --kind cot, wanted viability, which a threshold is for"
    );
    ensure!(
        args.thresholds_from.is_none() || args.kind != Kind::Cot,
        "--thresholds-from: found --kind cot, wanted viability, which thresholds are for"
    );
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.threads.unwrap_or(0)).build()?;
    let sets =
        args.kind.heads().iter().map(|head| Ok((*head, DataSet::read(&args.data, &args.skill, *head)?)));
    // Both sets are read before either is fitted: what is missing is said at once.
    let sets = sets.collect::<anyhow::Result<Vec<_>>>()?;
    let other = args.thresholds_from.as_deref();
    let other = other.map(|folder| other_rows(folder, &args.skill, &sets[0].1)).transpose()?;
    let mut reports = Vec::new();
    for (head, set) in &sets {
        let fitted = fit_with_progress(&pool, set, *head, &args.options())
            .with_context(|| set.folder.display().to_string())?;
        reports.push(write(args, &folder, (set, other.as_ref()), *head, &fitted)?);
    }
    if let Some(alpha) = args.write_threshold {
        let promise = reports.iter().flat_map(|report| &report.promises).find(|p| p.risk.alpha == alpha);
        let promise = promise.context("--write-threshold: found no viability report, wanted one")?;
        manifest::write_threshold(&Installation::find()?.skill_file(&args.skill), promise)?;
    }
    print(args, &reports)?;
    Ok(ExitCode::SUCCESS)
}

/// The rows that thresholds are computed from where they are not those kept back: of another seed, since rows of
/// one seed have the same terrain and pose.
fn other_rows(folder: &Path, skill: &str, trained: &DataSet) -> anyhow::Result<DataSet> {
    let set = DataSet::read(folder, skill, Head::Sigmoid)?;
    ensure!(
        set.seed != trained.seed,
        "{}: config.seed: found {}, the training data's, wanted another: the same rows would be promised with that \
         were trained on",
        set.folder.join(META_FILE).display(),
        set.seed
    );
    ensure!(
        set.skill == trained.skill,
        "{}: skill: found {:?}, wanted the training data's, {:?}: a promise is about the skill that is predicted",
        set.folder.join(META_FILE).display(),
        set.skill,
        trained.skill
    );
    Ok(set)
}

impl Args {
    fn options(&self) -> Options {
        Options {
            epochs: self.epochs,
            batch: self.batch,
            learning_rate: self.learning_rate,
            final_rate_share: self.final_rate_share,
            mirror: !self.no_mirror,
            seed: self.seed,
            ..Options::default()
        }
    }

    /// The thresholds of every α asked for; a cost of transport has none.
    fn promises(&self, head: Head, pairs: &[(f32, f32)]) -> Vec<Promise> {
        if head == Head::Linear {
            return Vec::new();
        }
        let required_viability = self.required_viability as f32;
        let written = self.write_threshold.filter(|alpha| !self.alpha.contains(alpha));
        let all = self.alpha.iter().copied().chain(written);
        all.map(|alpha| promise(pairs, Risk { required_viability, alpha })).collect()
    }

    /// The command that repeats a model, threads left out since they change nothing.
    fn command(&self, kind: &str) -> String {
        let mut command = format!(
            "vocaloco train --skill {} --data {} --kind {kind} --epochs {} --batch {} --learning-rate {} \
             --final-rate-share {}",
            self.skill,
            self.data.display(),
            self.epochs,
            self.batch,
            self.learning_rate,
            self.final_rate_share,
        );
        if self.no_mirror {
            command.push_str(" --no-mirror");
        }
        if kind == output_name(Head::Sigmoid) {
            let alpha: Vec<String> = self.alpha.iter().map(ToString::to_string).collect();
            let _ = write!(
                command,
                " --alpha {} --required-viability {}",
                alpha.join(","),
                self.required_viability
            );
            if let Some(folder) = &self.thresholds_from {
                let _ = write!(command, " --thresholds-from {}", folder.display());
            }
        }
        format!("{command} --seed {}", self.seed)
    }
}

fn fit_with_progress(
    pool: &rayon::ThreadPool,
    set: &DataSet,
    head: Head,
    options: &Options,
) -> anyhow::Result<Fitted> {
    let style = ProgressStyle::with_template("{prefix:9} {bar:24} epoch {pos}/{len}, {msg}, {eta} left")?;
    let bar = ProgressBar::new(options.epochs as u64).with_style(style).with_prefix(output_name(head));
    let fitted = pool.install(|| {
        fit(&set.samples, head, options, &mut |epoch| {
            bar.set_message(format!("loss {:.5}, held out {:.5}", epoch.training, epoch.validation));
            bar.set_position(epoch.epoch as u64);
        })
    });
    bar.finish_and_clear();
    Ok(fitted?)
}

fn write(
    args: &Args,
    folder: &Path,
    (set, other): (&DataSet, Option<&DataSet>),
    head: Head,
    fitted: &Fitted,
) -> anyhow::Result<Report> {
    let kind = output_name(head);
    let origin = Origin {
        skill: args.skill.clone(),
        robot: set.robot.clone(),
        data_sha256: set.sha256.clone(),
        seed: args.seed,
    };
    let known = if head == Head::Sigmoid { known::fit(&set.samples) } else { None };
    let bytes = onnx(&fitted.parameters, head, &origin, known.as_ref().map(|fitted| &fitted.known));
    let file = folder.join(format!("{kind}.onnx"));
    let viability = head == Head::Sigmoid;
    let pairs = fitted.kept_back.as_slice();
    let promised = other.map(|other| answered(&fitted.parameters, head, &other.samples));
    let report = Report {
        kind,
        sha256: sha256_hex(&bytes),
        data_sha256: set.sha256.clone(),
        n: set.samples.len(),
        left_out: set.left_out,
        held_out: fitted.held_out_rows,
        kept_back: pairs.len(),
        best_epoch: fitted.best.epoch,
        training_mse: fitted.best.training,
        held_out_mse: fitted.best.validation,
        kept_back_mse: scores::mse(pairs),
        brier: viability.then(|| scores::brier(pairs)),
        ece: viability.then(|| scores::ece(pairs)),
        auc: if viability { scores::auc(pairs) } else { None },
        mae: (!viability).then(|| scores::mae(pairs)),
        r2: if viability { None } else { scores::r2(pairs) },
        promises: args.promises(head, promised.as_deref().unwrap_or(pairs)),
        flags: known.map(|fitted| fitted.flags),
        file,
    };
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    write_whole(&report.file, &bytes)?;
    let section = section::section(args, (set, other), head, fitted, &report);
    card::write_section(folder, &args.skill, &format!("{kind}.onnx"), &section)?;
    Ok(report)
}

#[expect(clippy::print_stdout, reason = "the verb's result")]
fn print(args: &Args, reports: &[Report]) -> anyhow::Result<()> {
    if args.json {
        let result = serde_json::json!({
            "command": "train",
            "skill": args.skill,
            "seed": args.seed,
            "version": env!("CARGO_PKG_VERSION"),
            "options": args.options(),
            "models": reports,
        });
        println!("{}", serde_json::to_string_pretty(&result)?);
        return Ok(());
    }
    let number = |name: &str, value: Option<f64>| {
        value.map(|value| format!(", {name} {value:.4}")).unwrap_or_default()
    };
    for report in reports {
        println!(
            "{}: {} rows ({} held out, {} kept back), best epoch {}, loss {:.5}, held out {:.5}, kept back \
             {:.5}{}{}{}{}{}",
            report.file.display(),
            report.n,
            report.held_out,
            report.kept_back,
            report.best_epoch,
            report.training_mse,
            report.held_out_mse,
            report.kept_back_mse,
            number("Brier", report.brier),
            number("ECE", report.ece),
            number("AUC", report.auc),
            number("MAE", report.mae),
            number("R²", report.r2),
        );
        if let Some(Flags { n, flagged }) = report.flags {
            println!("terrain never seen: {flagged} of {n} rows kept back are flagged");
        }
        for promise in &report.promises {
            println!("{promise}");
        }
    }
    Ok(())
}
