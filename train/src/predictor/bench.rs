//! `bench-train`: samples a second in which a predictor is fitted, beside PyTorch in the same run.

mod peer;

use std::process::ExitCode;
use std::time::Instant;

use anyhow::ensure;
use rand::RngExt;
use rand::seq::SliceRandom;
use serde::Serialize;
use vocaloco_sim::stream::{stream, uniform};

use super::kernel::FieldCells;
use super::network::start_values;
use super::sgd::{Example, Head, Rate, Sgd};
use peer::{Peer, Task};

/// Samples a second in which a predictor is fitted, beside `PyTorch` on the same data and start.
///
/// Fields are stairs of random height and distance with ±10 cm of noise, labels the chance to climb
/// them; what a field shows changes no running time. Both sides see the same samples in the same order,
/// from the same start values, with the same loss, step size, momentum and number of threads, and each
/// trains for the same epochs; reading data and validation are not timed. `gradient_difference` is the
/// largest of all parameters' on the first batch, as a share of the largest gradient.
///
/// `PyTorch` is timed where the interpreter has the package `torch`: `python3 -m venv pt && pt/bin/pip
/// install torch numpy`, then `--python pt/bin/python3`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Samples.
    #[arg(long, default_value_t = 10_000, value_name = "N")]
    samples: usize,
    /// Times that every sample is seen.
    #[arg(long, default_value_t = 3, value_name = "N")]
    epochs: usize,
    /// Samples per step.
    #[arg(long, default_value_t = 32, value_name = "N")]
    batch: usize,
    /// Threads, on both sides.
    #[arg(long, default_value_t = 2, value_name = "N")]
    threads: usize,
    /// Python interpreter that may have the package `torch`.
    #[arg(long, default_value = "python3", value_name = "PATH")]
    python: String,
    /// Seed of fields, order and start values.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    command: String,
    seed: u64,
    version: &'static str,
    samples: usize,
    epochs: usize,
    batch: usize,
    threads: usize,
    samples_per_s: f64,
    /// Mean squared error of every epoch, each sample as it was seen.
    losses: Vec<f64>,
    peer: Option<Peer>,
    /// How many times the peer's rate ours is.
    ratio: Option<f64>,
    gradient_difference: Option<f64>,
    largest_loss_difference: Option<f64>,
}

const RATE: Rate = Rate { learning_rate: 0.005, momentum: 0.9 };

/// Runs the verb.
///
/// # Errors
/// Nothing to time, or a peer that breaks off.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    for (flag, value) in [("samples", args.samples), ("epochs", args.epochs), ("batch", args.batch)] {
        ensure!(value > 0, "--{flag}: found 0, wanted 1 or more");
    }
    ensure!(args.threads > 0, "--threads: found 0, wanted 1 or more");
    let (fields, labels): (Vec<FieldCells>, Vec<f32>) =
        (0..args.samples as u64).map(|row| stairs(args.seed, row)).unzip();
    let orders: Vec<Vec<usize>> = (0..args.epochs as u64).map(|epoch| order(args, epoch)).collect();
    let start = start_values(&mut stream(args.seed, "train/start", &[]));
    let task = Task { fields: &fields, labels: &labels, start: &start, orders: &orders, batch: args.batch };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.threads).build()?;
    let ours = pool.install(|| fit(&task));
    let theirs = peer::fit(&args.python, &task, args.threads)?;
    let samples_per_s = (args.samples * args.epochs) as f64 / ours.seconds;
    let difference = |pairs: &mut dyn Iterator<Item = (f64, f64)>, scale: f64| {
        pairs.map(|(a, b)| (a - b).abs() / scale).fold(0.0, f64::max)
    };
    let largest = ours.gradient.iter().fold(0.0_f32, |largest, g| largest.max(g.abs()));
    let report = Report {
        command: args.command(),
        seed: args.seed,
        version: env!("CARGO_PKG_VERSION"),
        samples: args.samples,
        epochs: args.epochs,
        batch: args.batch,
        threads: args.threads,
        samples_per_s,
        ratio: theirs.as_ref().map(|theirs| samples_per_s / theirs.peer.samples_per_s),
        gradient_difference: theirs.as_ref().map(|theirs| {
            let pairs = ours.gradient.iter().zip(&theirs.gradient);
            difference(&mut pairs.map(|(a, b)| (f64::from(*a), f64::from(*b))), f64::from(largest))
        }),
        largest_loss_difference: theirs.as_ref().map(|theirs| {
            let pairs = ours.losses.iter().zip(&theirs.peer.losses);
            pairs.map(|(a, b)| (a - b).abs() / b).fold(0.0, f64::max)
        }),
        losses: ours.losses,
        peer: theirs.map(|theirs| theirs.peer),
    };
    print(args, &report)?;
    Ok(ExitCode::SUCCESS)
}

struct Ours {
    seconds: f64,
    losses: Vec<f64>,
    gradient: Vec<f32>,
}

fn fit(task: &Task<'_>) -> Ours {
    let example =
        |row: &usize| Example { field: &task.fields[*row], label: task.labels[*row], mirrored: false };
    let mut parameters = task.start.to_vec();
    let mut sgd = Sgd::default();
    let first: Vec<Example<'_>> = task.orders[0].iter().take(task.batch).map(example).collect();
    let gradient = sgd.gradient(&parameters, Head::Sigmoid, &first);
    let mut batch = Vec::with_capacity(task.batch);
    let began = now();
    let losses = task.orders.iter().map(|order| {
        let mut squared_error = 0.0;
        for rows in order.chunks(task.batch) {
            batch.clear();
            batch.extend(rows.iter().map(example));
            squared_error += sgd.step(&mut parameters, Head::Sigmoid, &batch, RATE);
        }
        squared_error / order.len() as f64
    });
    let losses = losses.collect();
    Ours { seconds: began.elapsed().as_secs_f64(), losses, gradient }
}

#[expect(clippy::disallowed_methods, reason = "a measurement of time")]
fn now() -> Instant {
    Instant::now()
}

/// A staircase ahead, ±10 cm of noise in every cell, and how likely it is to be climbed.
fn stairs(seed: u64, row: u64) -> (FieldCells, f32) {
    let mut rng = stream(seed, "bench/stairs", &[row]);
    let (height_m, edge) = (uniform(&mut rng, 0.0, 0.45), rng.random_range(10..28));
    let mut field = [0.0; 31 * 11];
    for (at, cell) in field.iter_mut().enumerate() {
        let step = (at / 11 + 3).saturating_sub(edge) / 3;
        *cell = height_m * step as f32 + uniform(&mut rng, -0.1, 0.1);
    }
    let centre = field[15 * 11 + 5];
    for cell in &mut field {
        *cell -= centre;
    }
    (field, 1.0 / (1.0 + libm::expf(40.0 * (height_m - 0.25))))
}

fn order(args: &Args, epoch: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..args.samples).collect();
    order.shuffle(&mut stream(args.seed, "bench/order", &[epoch]));
    order
}

impl Args {
    fn command(&self) -> String {
        format!(
            "vocaloco bench train --samples {} --epochs {} --batch {} --threads {} --python {} --seed {}",
            self.samples, self.epochs, self.batch, self.threads, self.python, self.seed
        )
    }
}

#[expect(clippy::print_stdout, reason = "the verb's result")]
fn print(args: &Args, report: &Report) -> anyhow::Result<()> {
    if args.json {
        println!("{}", serde_json::to_string_pretty(report)?);
        return Ok(());
    }
    let losses =
        |losses: &[f64]| losses.iter().map(|loss| format!("{loss:.5}")).collect::<Vec<_>>().join(", ");
    println!(
        "{:.0} samples/s on {} threads, batches of {}: 100,000 samples, an epoch, in {:.1} s; losses {}",
        report.samples_per_s,
        report.threads,
        report.batch,
        1e5 / report.samples_per_s,
        losses(&report.losses)
    );
    if let (Some(peer), Some(ratio), Some(gradient)) =
        (&report.peer, report.ratio, report.gradient_difference)
    {
        println!(
            "{}: {:.0} samples/s, ours is {ratio:.1} times that; losses {}; gradients differ by {gradient:.1e}",
            peer.name,
            peer.samples_per_s,
            losses(&peer.losses)
        );
    }
    println!("{}", report.command);
    Ok(())
}
