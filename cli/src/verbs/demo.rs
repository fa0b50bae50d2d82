//! `demo`: the main job on what is shipped. Drives the stairs courses in the simulator with skills
//! chosen by the selector, prints the table, and writes a page with moving pictures.

mod course;
mod story;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context as _;
use serde::Serialize;
use vocaloco_core::{installation::Installation, predictor, registry::load_deployment, runtime::TickSummary};
use vocaloco_sim::course::{CourseRun, Outcome, Switch};
use vocaloco_sim::terrain::CourseKind;

use self::course::{Driven, Stage};
use super::{Shared, noise::NoiseArgs};
use crate::{
    exit::Exit,
    output,
    report::{Report, path},
};

/// Drives stairs of three steps up and down and writes a page on which the robot can be watched.
///
/// Expected, as in the paper: walk → ascend → walk and walk → descend → walk on 12 cm steps, and a
/// stop before the first of 40 cm. Where walk proves viable and cheaper on 12 cm, the lowest steps
/// where it is not are driven as well. Exit code 1 when an outcome is another than expected.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    shared: Shared,
    /// Deployment whose skills may run
    #[arg(long, default_value = "anymal_stairs", value_name = "NAME")]
    deployment: String,
    /// Folder for report.html, the decision logs and the configuration
    #[arg(long, default_value = "out/demo", value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    noise: NoiseArgs,
}

impl Args {
    fn command(&self) -> String {
        let mut words = vec![format!("vocaloco demo --seed {}", self.shared.seed)];
        if self.deployment != "anymal_stairs" {
            words.push(format!("--deployment {}", self.deployment));
        }
        if self.noise != NoiseArgs::PROTOCOL {
            words.push(self.noise.to_string());
        }
        words.join(" ")
    }
}

/// `--json`, as DESIGN.md promises it.
#[derive(Serialize)]
struct Summary {
    command: String,
    seed: u64,
    version: &'static str,
    backend: String,
    deployment: String,
    #[serde(flatten)]
    noise: NoiseArgs,
    courses: Vec<CourseRow>,
    refused: Vec<String>,
    /// What the ticks of each course took on this machine; nothing but this and the next depends on it.
    timing: Vec<TickSummary>,
    wall_s: f64,
}

#[derive(Serialize)]
struct CourseRow {
    name: &'static str,
    size_m: f32,
    outcome: Outcome,
    duration_s: f64,
    distance_m: f64,
    cot: Option<f64>,
    switches: Vec<Switch>,
    expected: String,
    as_expected: bool,
    note: String,
}

impl CourseRow {
    fn new(driven: &Driven) -> Self {
        let run = &driven.run;
        Self {
            name: run.kind.id(),
            size_m: run.size_m,
            outcome: run.outcome,
            duration_s: run.duration_s,
            distance_m: run.distance_m,
            cot: run.cot,
            switches: run.switches.clone(),
            expected: driven.story.expected.clone().unwrap_or_default(),
            as_expected: driven.story.as_expected,
            note: driven.note.clone(),
        }
    }
}

#[allow(clippy::disallowed_methods, reason = "wall time is reported, and nothing depends on it")]
pub(crate) fn run(args: Args) -> anyhow::Result<Exit> {
    let started = Instant::now();
    args.noise.check()?;
    let installation = Installation::find().context("no installation")?;
    let loaded = load_deployment(&installation, &args.deployment)
        .with_context(|| format!("deployment `{}`", args.deployment))?;
    let refused: Vec<String> = loaded.refused.iter().map(ToString::to_string).collect();
    for line in &refused {
        eprintln!("refused: {line}");
    }
    let stage = Stage::new(installation, &loaded, &args);
    // Each course loads its own: a runtime starts fresh.
    drop(loaded);
    std::fs::create_dir_all(&args.out).with_context(|| format!("cannot make {}", args.out.display()))?;

    let mut driven = vec![
        stage.drive(CourseKind::StairsUp, 0.12, Outcome::Reached)?,
        stage.drive(CourseKind::StairsDown, 0.12, Outcome::Reached)?,
    ];
    for kind in [CourseKind::StairsUp, CourseKind::StairsDown] {
        let walked_through = driven.iter().any(|d| d.run.kind == kind && d.walked_through());
        if walked_through {
            driven.extend(stage.lowest_with_a_switch(kind)?);
        }
    }
    driven.push(stage.drive(CourseKind::StairsUp, 0.4, Outcome::Stopped)?);

    let backend = predictor::backend();
    let backend = format!("{} {}", backend.name, backend.version);
    let report = Report {
        title: "VOCALoco demo",
        version: env!("CARGO_PKG_VERSION"),
        command: args.command(),
        seed: args.shared.seed,
        backend: backend.clone(),
        lead: format!(
            "{} in rapier at 200 Hz; at 50 Hz the cheapest viable skill is chosen from predictions on a \
             31 × 11 heightfield. Command: 0.6 m/s straight ahead.",
            stage.robot.name
        ),
        field_caption: format!(
            "Heights around the base as the networks see them, each with ±{} m of noise; blue is low.",
            args.noise.field_noise_m
        ),
        palette: stage.thresholds.iter().map(|(name, _)| name.clone()).collect(),
        courses: driven.iter().map(|d| stage.packed(d)).collect(),
    };
    let page = args.out.join("report.html");
    write(&page, &report.html()?)?;

    let as_expected = driven.iter().all(|d| d.story.as_expected);
    let summary = Summary {
        command: report.command,
        seed: args.shared.seed,
        version: report.version,
        backend,
        deployment: args.deployment.clone(),
        noise: args.noise,
        courses: driven.iter().map(CourseRow::new).collect(),
        refused,
        timing: driven.iter().map(|driven| driven.timing.clone()).collect(),
        wall_s: started.elapsed().as_secs_f64(),
    };
    write(
        &args.out.join("config.json"),
        &(serde_json::to_string_pretty(&stage.config(&summary.command, &driven))? + "\n"),
    )?;
    if args.shared.json {
        output::json(&summary)?;
    } else {
        print(&summary, &driven, &page)?;
        for Driven { run, timing, .. } in &driven {
            output::narrate(format_args!("{} of {:.0} cm: {timing}", run.kind.id(), run.size_m * 100.0));
        }
    }
    Ok(if as_expected { Exit::Fine } else { Exit::Finding })
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

fn print(summary: &Summary, driven: &[Driven], page: &Path) -> anyhow::Result<()> {
    output::line(&format!(
        "{:<12} {:>6}  {:<8} {:<8} {:>6} {:>9} {:>5}  {}",
        "course", "step", "outcome", "expected", "time", "distance", "CoT", "active skills"
    ))?;
    for Driven { run, story, note, .. } in driven {
        let CourseRun { kind, size_m, outcome, duration_s, distance_m, cot, .. } = run;
        output::line(&format!(
            "{:<12} {:>4.0} cm  {outcome:<8} {:<8} {duration_s:>4.1} s {distance_m:>7.2} m {:>5}  {}{}",
            kind.id(),
            size_m * 100.0,
            story.expected.as_deref().unwrap_or("–"),
            cot.map_or("–".to_owned(), |cot| format!("{cot:.2}")),
            path(run),
            if story.as_expected { "" } else { "  ← not as expected" },
        ))?;
        if !note.is_empty() {
            output::line(&format!("             {note}"))?;
        }
    }
    output::line(&format!(
        "\nWatch it: {}\nRepeat it: {}   (networks run by {}, {:.1} s)",
        page.display(),
        summary.command,
        summary.backend,
        summary.wall_s
    ))?;
    Ok(())
}
