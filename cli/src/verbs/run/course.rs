//! `run --source sim`: a course in the simulator, on simulated time.

use serde::Serialize;
use vocaloco_core::decision_log::{LogWriter, Setup};
use vocaloco_core::predictor::backend;
use vocaloco_core::runtime::TickSummary;
use vocaloco_plugin_api::Command;
use vocaloco_sim::course::{
    CourseConfig, CourseError, CourseRun, CourseStage, Outcome, Pilot, PilotTick, SelectorPilot, Switch,
    drive,
};
use vocaloco_sim::plant::Plant;
use vocaloco_sim::terrain::CourseKind;

use super::pace::{self, Metronome};
use super::{Args, start};
use crate::exit::Exit;
use crate::verbs::noise::NoiseArgs;
use crate::{output, progress};

#[derive(clap::Args)]
pub(super) struct CourseArgs {
    /// Course of --source sim: `stairs_up`, `stairs_down`, `mixed`, `obstacles`
    #[arg(long, default_value = "stairs_up", value_name = "COURSE")]
    course: CourseKind,
    /// Step height of the course, m; on `obstacles`, whose steps are of 12 cm, the height of the wall and the width
    /// of the gap. By default 0.12, and 0.5 on obstacles
    #[arg(long, value_name = "M")]
    size_m: Option<f32>,
    /// Number of steps of the course
    #[arg(long, default_value_t = 3, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=50))]
    steps: u16,
    #[command(flatten)]
    noise: NoiseArgs,
}

impl CourseArgs {
    fn size_m(&self) -> f32 {
        self.size_m.unwrap_or_else(|| self.course.demo_size_m())
    }
}

#[derive(Serialize)]
struct Report<'a> {
    command: String,
    seed: u64,
    version: &'static str,
    backend: String,
    course: &'static str,
    size_m: f32,
    steps: usize,
    #[serde(flatten)]
    noise: NoiseArgs,
    outcome: Outcome,
    duration_s: f64,
    distance_m: f64,
    cot: Option<f64>,
    switches: &'a [Switch],
    refused: Vec<String>,
    /// What ticks took on this machine; nothing else here depends on it unless it ran in real time.
    timing: TickSummary,
}

pub(super) fn run(args: &Args) -> anyhow::Result<Exit> {
    let course = &args.course;
    let size_m = course.size_m();
    anyhow::ensure!((0.0..=2.0).contains(&size_m), "--size-m: found {size_m}, wanted 0 to 2");
    course.noise.check()?;
    let config = CourseConfig {
        steps: usize::from(course.steps),
        ..course.noise.on(CourseConfig::demo(course.course, size_m, args.shared.seed))
    };
    let (mut runtime, refused) = start(args, args.real_time)?;
    let metronome = args.real_time.then(|| Metronome::new(runtime.config().rate_hz));
    let setup = Setup::of(&runtime, &args.deployment);
    let spinner = progress::spinner("driving");
    let CourseStage { terrain, mut plant } = CourseStage::set(runtime.robot(), &config)?;
    let pilot = SelectorPilot::new(&config, &mut plant, &terrain, &mut runtime);
    let run = drive(&config, &mut PacedPilot { pilot, metronome })?;
    spinner.finish_and_clear();
    if let Some(file) = &args.log {
        let mut log = LogWriter::create(file, &setup)?;
        for decision in run.ticks.iter().filter_map(|tick| tick.decision.as_ref()) {
            log.write(decision)?;
        }
        log.finish()?;
    }
    let report = Report {
        command: command(args),
        seed: args.shared.seed,
        version: env!("CARGO_PKG_VERSION"),
        backend: format!("{} {}", backend().name, backend().version),
        course: run.kind.id(),
        size_m: run.size_m,
        steps: run.steps,
        noise: course.noise,
        outcome: run.outcome,
        duration_s: run.duration_s,
        distance_m: run.distance_m,
        cot: run.cot,
        switches: &run.switches,
        refused,
        timing: runtime.times(),
    };
    if args.shared.json {
        output::json(&report)?;
    } else {
        say(&run, &report)?;
        pace::narrate(&report.timing, false);
    }
    Ok(Exit::Fine)
}

/// A pilot that keeps to the clock, where it has a metronome.
struct PacedPilot<'a> {
    pilot: SelectorPilot<'a>,
    metronome: Option<Metronome>,
}

impl Pilot for PacedPilot<'_> {
    fn plant(&self) -> &Plant {
        self.pilot.plant()
    }

    fn reset_work(&mut self) {
        self.pilot.reset_work();
    }

    fn tick(&mut self, command: &Command) -> Result<PilotTick, CourseError> {
        self.metronome.iter_mut().for_each(Metronome::wait);
        self.pilot.tick(command)
    }
}

fn command(args: &Args) -> String {
    let course = &args.course;
    format!(
        "vocaloco run --deployment {} --source sim --course {} --size-m {} --steps {} {} --seed {}{}",
        args.deployment,
        course.course.id(),
        course.size_m(),
        course.steps,
        course.noise,
        args.shared.seed,
        args.real_time_flag()
    )
}

fn say(run: &CourseRun, report: &Report<'_>) -> anyhow::Result<()> {
    for switch in &run.switches {
        output::line(&format!("{:8.2} s  {} → {}", switch.t_s, switch.from, switch.to))?;
    }
    let cot = run.cot.map_or_else(|| "none".to_owned(), |cot| format!("{cot:.2}"));
    output::line(&format!(
        "{:8.2} s  {} after {:.2} m, cost of transport {cot} ({})",
        run.duration_s, run.outcome, run.distance_m, report.backend
    ))?;
    eprintln!("{}", report.command);
    Ok(())
}
