//! `evaluate course`: one rollout of each course, every tick kept: predictions, choice and active skill
//! over time, as decisions logs and as a page on which the robot can be watched.

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Serialize;
use vocaloco_core::decision_log::{LogWriter, Setup};
use vocaloco_core::predictor::backend;
use vocaloco_sim::{
    course::{CourseConfig, CourseRun, Outcome, Switch},
    terrain::{CourseKind, OBSTACLES_RISE_M, Terrain},
};

use super::arena::{Arena, Variation};
use super::arena_args::{ArenaArgs, courses_flag, sizes_m};
use super::store::Store;
use super::who::Who;
use crate::report::{PackedCourse, Report, Story, path, told};
use crate::{exit::Exit, output, progress, verbs::Shared};

/// Drives courses once each and keeps every tick.
///
/// The staircases of the paper's deployment by default (three steps of 12 cm up, and down), and the course
/// that mixes flat and stairs.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Courses: `stairs_up`, `stairs_down`, `mixed`, `obstacles`
    #[arg(long, value_delimiter = ',', default_value = "stairs_up,stairs_down,mixed", value_name = "LIST")]
    course: Vec<CourseKind>,
    /// Step heights, m; on `obstacles`, whose steps are of 12 cm, the height of the wall and the width of the gap.
    /// By default 0.12, and 0.5 on obstacles
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    size_m: Vec<f32>,
    /// Steps of a flight
    #[arg(long, default_value_t = 3, value_name = "N")]
    steps: usize,
    /// Start as this rollout of `evaluate success` with the same seed: anywhere on the near flat, friction and
    /// mass drawn; by default nominal, in the middle
    #[arg(long, value_name = "N")]
    rollout: Option<u64>,
    #[command(flatten)]
    arena: ArenaArgs,
    /// Folder for report.html and the decisions logs
    #[arg(long, default_value = "out/course", value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    shared: Shared,
}

/// The paper's deployment.
const STAIRS_M: [f32; 1] = [0.12];

#[derive(Serialize)]
struct Summary {
    command: String,
    seed: u64,
    version: &'static str,
    backend: String,
    rows: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    course: CourseKind,
    size_m: f32,
    steps: usize,
    selector: Who,
    outcome: Outcome,
    duration_s: f64,
    distance_m: f64,
    cot: Option<f64>,
    switches: Vec<Switch>,
    skills: String,
    log: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    args.arena.check(args.steps, &args.size_m)?;
    let store = Store::open(&args.out.join("measured"), false)?;
    let alone: Vec<&str> = args.arena.selector.iter().filter_map(Who::alone).collect();
    let arena = Arena::load(&args.arena.deployment, &alone, (store, 0))?;
    let (mut rows, mut courses) = (Vec::new(), Vec::new());
    for course in &args.course {
        for size_m in &sizes_m(*course, &args.size_m, &STAIRS_M) {
            for who in &args.arena.selector {
                let start = match args.rollout {
                    Some(rollout) => CourseConfig::evaluation(*course, *size_m, args.shared.seed, rollout),
                    None => CourseConfig::demo(*course, *size_m, args.shared.seed),
                };
                let config = CourseConfig {
                    steps: args.steps,
                    occlusion: args.arena.occlusion.into(),
                    ..args.arena.noise.on(start)
                };
                let spinner = progress::spinner(&format!("{who} on {} of {size_m} m", course.id()));
                let driven = drive(&arena, &config, who, args.arena.oracle_samples, &args.out)?;
                spinner.finish_and_clear();
                rows.push(Row::new(&driven, &config, who));
                courses.push(driven.packed);
            }
        }
    }
    let backend = backend();
    let backend = format!("{} {}", backend.name, backend.version);
    let command = command(args);
    let report = Report {
        title: "VOCALoco on courses",
        version: env!("CARGO_PKG_VERSION"),
        command: command.clone(),
        seed: args.shared.seed,
        backend: backend.clone(),
        lead: format!(
            "{} in rapier at 200 Hz, deployment {}. Command: 0.6 m/s straight ahead.",
            arena.robot.name, arena.deployment
        ),
        field_caption: format!(
            "Heights around the base as the networks see them, each with ±{} m of noise; blue is low.",
            args.arena.noise.field_noise_m
        ),
        palette: palette(&arena, &args.arena.selector),
        courses,
    };
    let page = args.out.join("report.html");
    std::fs::write(&page, report.html()?).with_context(|| format!("cannot write {}", page.display()))?;
    let summary = Summary { command, seed: args.shared.seed, version: report.version, backend, rows };
    if args.shared.json {
        output::json(&summary)?;
    } else {
        print(&summary, &page)?;
    }
    Ok(Exit::Fine)
}

/// A recorded run, packed for a page.
pub(super) struct Driven {
    pub(super) run: CourseRun,
    pub(super) packed: PackedCourse,
    pub(super) log: Option<PathBuf>,
}

/// Drives one course once; a runtime's decisions go into a log under `out`.
pub(super) fn drive(
    arena: &Arena,
    config: &CourseConfig,
    who: &Who,
    oracle_samples: u64,
    out: &Path,
) -> anyhow::Result<Driven> {
    let config = CourseConfig { recorded: true, ..config.clone() };
    let (run, setup) = arena.run(&config, (who, Variation::default()), oracle_samples)?;
    let id = format!("{}-{:.3}-{}", config.kind.id(), config.size_m, who.to_string().replace(':', "-"));
    let log = setup.map(|setup| log(&run, &setup, &out.join(format!("decisions-{id}.mcap")))).transpose()?;
    let shape = match config.kind {
        CourseKind::StairsUp => format!("{} steps of {:.1} cm up", config.steps, config.size_m * 100.0),
        CourseKind::StairsDown => format!("{} steps of {:.1} cm down", config.steps, config.size_m * 100.0),
        CourseKind::Mixed => {
            format!("{} steps of {:.1} cm up, a flat, and down", config.steps, config.size_m * 100.0)
        }
        CourseKind::Obstacles => format!(
            "{} steps of {:.0} cm up and down, a wall and a gap of {:.1} cm",
            config.steps,
            OBSTACLES_RISE_M * 100.0,
            config.size_m * 100.0
        ),
    };
    let story = Story { id, title: format!("{who}: {shape}"), summary: told(&run), ..Story::default() };
    let terrain = Terrain::course(config.kind, config.size_m, config.steps);
    let thresholds = if who.alone().is_some() { Vec::new() } else { arena.thresholds() };
    let packed = PackedCourse::new(story, &run, &arena.robot, &terrain, &thresholds);
    Ok(Driven { run, packed, log })
}

fn log(run: &CourseRun, setup: &Setup, path: &Path) -> anyhow::Result<PathBuf> {
    let mut log = LogWriter::create(path, setup)?;
    for decision in run.ticks.iter().filter_map(|tick| tick.decision.as_ref()) {
        log.write(decision)?;
    }
    log.finish()?;
    Ok(path.to_owned())
}

/// Names in the order of their colours: the deployment's skills, then those that run alone.
pub(super) fn palette(arena: &Arena, selectors: &[Who]) -> Vec<String> {
    let mut names: Vec<String> = arena.names().into_iter().map(str::to_owned).collect();
    for name in selectors.iter().filter_map(Who::alone) {
        if !names.iter().any(|known| known == name) {
            names.push(name.to_owned());
        }
    }
    names
}

impl Row {
    fn new(driven: &Driven, config: &CourseConfig, who: &Who) -> Self {
        let run = &driven.run;
        Self {
            course: config.kind,
            size_m: config.size_m,
            steps: config.steps,
            selector: who.clone(),
            outcome: run.outcome,
            duration_s: run.duration_s,
            distance_m: run.distance_m,
            cot: run.cot,
            switches: run.switches.clone(),
            skills: path(run),
            log: driven.log.clone(),
        }
    }
}

fn print(summary: &Summary, page: &Path) -> anyhow::Result<()> {
    let width = summary.rows.iter().map(|row| row.selector.to_string().len()).max().unwrap_or(0).max(8);
    output::line(&format!(
        "{:<12} {:>7}  {:<width$}  {:<8} {:>6} {:>9} {:>5}  active skills",
        "course", "step", "selector", "outcome", "time", "distance", "CoT"
    ))?;
    for row in &summary.rows {
        output::line(&format!(
            "{:<12} {:>4.1} cm  {:<width$}  {:<8} {:>4.1} s {:>7.2} m {:>5}  {}",
            row.course.id(),
            row.size_m * 100.0,
            row.selector.to_string(),
            row.outcome,
            row.duration_s,
            row.distance_m,
            row.cot.map_or("–".to_owned(), |cot| format!("{cot:.2}")),
            row.skills,
        ))?;
    }
    output::line(&format!("\nWatch it: {}\nRepeat it: {}", page.display(), summary.command))?;
    Ok(())
}

fn command(args: &Args) -> String {
    let selectors: Vec<String> = args.arena.selector.iter().map(ToString::to_string).collect();
    format!(
        "vocaloco evaluate course {} --steps {} --selector {} --deployment {}{}{} {} --seed {}",
        courses_flag(&args.course, &args.size_m, &STAIRS_M),
        args.steps,
        selectors.join(","),
        args.arena.deployment,
        args.rollout.map_or_else(String::new, |rollout| format!(" --rollout {rollout}")),
        args.arena.occlusion.flag(),
        args.arena.noise,
        args.shared.seed
    )
}
