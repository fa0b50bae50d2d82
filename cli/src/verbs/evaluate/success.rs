//! `evaluate success`: how often a course is reached, by step height and by who chooses.

use std::collections::BTreeSet;

use anyhow::ensure;
use serde::Serialize;
use vocaloco_sim::{
    course::{CourseConfig, SuccessRow},
    occlusion::Occlusion,
    terrain::CourseKind,
};

use super::arena::{Arena, Variation};
use super::arena_args::{ArenaArgs, courses_flag, sizes_m};
use super::store::StoreArgs;
use super::who::Who;
use crate::{exit::Exit, output, progress, verbs::Shared};

/// Rolls courses out by step height, with several selectors side by side.
///
/// What was measured stays in --store: a run that is killed goes on where it was, and what stands is not
/// measured again until a model, a skill, the deployment or the configuration changes.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Courses: `stairs_up`, `stairs_down`, `mixed`, `obstacles`
    #[arg(long, value_delimiter = ',', default_value = "stairs_up,stairs_down", value_name = "LIST")]
    course: Vec<CourseKind>,
    /// Step heights, m; on `obstacles`, whose steps are of 12 cm, the height of the wall and the width of the gap.
    /// By default 0.025 to 0.4 by 0.025, and 0.5 on obstacles
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    size_m: Vec<f32>,
    /// Rollouts for each height
    #[arg(long, default_value_t = 100, value_name = "N")]
    rollouts: u64,
    /// Steps of a flight
    #[arg(long, default_value_t = 6, value_name = "N")]
    steps: usize,
    #[command(flatten)]
    arena: ArenaArgs,
    #[command(flatten)]
    store: StoreArgs,
    #[command(flatten)]
    shared: Shared,
}

/// docs/method.md: 2.5 to 40 cm by 2.5.
pub(super) const STAIRS_M: [f32; 16] =
    [0.025, 0.05, 0.075, 0.1, 0.125, 0.15, 0.175, 0.2, 0.225, 0.25, 0.275, 0.3, 0.325, 0.35, 0.375, 0.4];

/// `--occlusion`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Sight {
    /// True heights everywhere
    None,
    /// What the cameras have seen, the rest filled from behind
    Camera,
    /// What the cameras have seen, the rest read as level with the ground under the base
    CameraUnfilled,
}

impl Sight {
    /// As a command names it, after a space; nothing where nothing is hidden.
    pub(super) const fn flag(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Camera => " --occlusion camera",
            Self::CameraUnfilled => " --occlusion camera-unfilled",
        }
    }
}

impl From<Sight> for Occlusion {
    fn from(sight: Sight) -> Self {
        match sight {
            Sight::None => Self::None,
            Sight::Camera => Self::Camera,
            Sight::CameraUnfilled => Self::CameraUnfilled,
        }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!(args.rollouts > 0, "--rollouts: found 0, wanted 1 or more");
    args.arena.check(args.steps, &args.size_m)?;
    let alone: Vec<&str> = args.arena.selector.iter().filter_map(Who::alone).collect();
    let arena = Arena::load(&args.arena.deployment, &alone, args.store.open()?)?;
    let sizes_m = |course: CourseKind| sizes_m(course, &args.size_m, &STAIRS_M);
    let sizes: usize = args.course.iter().map(|course| sizes_m(*course).len()).sum();
    let rows_wanted = sizes * args.arena.selector.len();
    let bar = progress::bar("rollouts", args.rollouts * rows_wanted as u64);
    let mut rows = Vec::new();
    for course in &args.course {
        for who in &args.arena.selector {
            for size_m in &sizes_m(*course) {
                bar.set_message(format!("{} of {:.3} m, {who}", course.id(), size_m));
                let config = CourseConfig {
                    steps: args.steps,
                    occlusion: args.arena.occlusion.into(),
                    ..CourseConfig::evaluation(*course, *size_m, args.shared.seed, 0)
                };
                let config = args.arena.noise.on(config);
                let who = (who, Variation::default());
                rows.push(
                    arena.row(&config, args.rollouts, who, args.arena.oracle_samples, &|n| bar.inc(n))?,
                );
            }
        }
    }
    bar.finish_and_clear();
    report(args, &rows)?;
    Ok(Exit::Fine)
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'a> {
    command: String,
    seed: u64,
    version: &'static str,
    rows: &'a [SuccessRow],
}

fn report(args: &Args, rows: &[SuccessRow]) -> anyhow::Result<()> {
    let command = command(args);
    if args.shared.json {
        let seed = args.shared.seed;
        return Ok(output::json(&Report { command, seed, version: env!("CARGO_PKG_VERSION"), rows })?);
    }
    let width = rows.iter().map(|row| row.selector.len()).max().unwrap_or(0).max(8);
    for course in args.course.iter().collect::<BTreeSet<_>>() {
        output::line(&format!(
            "{}, {} steps a flight\nsize   {:<width$}    n  reached           crashed           stuck  stopped    CoT   time  switches",
            course.id(),
            args.steps,
            "selector"
        ))?;
        for size_m in &sizes_m(*course, &args.size_m, &STAIRS_M) {
            let of = |row: &&SuccessRow| row.course == *course && row.size_m == *size_m;
            for row in rows.iter().filter(of) {
                output::line(&line(row, width))?;
            }
        }
    }
    output::line(&command)?;
    Ok(())
}

fn line(row: &SuccessRow, width: usize) -> String {
    let number = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "–".to_owned(), |value| format!("{value:.digits$}"))
    };
    format!(
        "{:<5.3}  {:<width$} {:>4}  {:.2} ({:.2}–{:.2})  {:.2} ({:.2}–{:.2})  {:>5.2}  {:>7.2}  {:>5}  {:>5}  {:>8.1}",
        row.size_m,
        row.selector,
        row.n,
        row.reached,
        row.reached_low,
        row.reached_high,
        row.crashed,
        row.crashed_low,
        row.crashed_high,
        row.stuck,
        row.stopped,
        number(row.cot_mean, 3),
        number(row.duration_mean_s, 1),
        row.switches_mean,
    )
}

/// The command that repeats the table, on any number of threads.
fn command(args: &Args) -> String {
    let list = |items: Vec<String>| items.join(",");
    let mut words = vec![format!(
        "vocaloco evaluate success {} --rollouts {} --selector {} --steps {} --deployment {}",
        courses_flag(&args.course, &args.size_m, &STAIRS_M),
        args.rollouts,
        list(args.arena.selector.iter().map(ToString::to_string).collect()),
        args.steps,
        args.arena.deployment,
    )];
    if args.arena.selector.contains(&Who::Oracle) {
        words.push(format!("--oracle-samples {}", args.arena.oracle_samples));
    }
    words.push(format!("{}{} --seed {}", args.arena.noise, args.arena.occlusion.flag(), args.shared.seed));
    words.join(" ")
}
