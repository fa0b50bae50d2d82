//! `evaluate handover`: how often one skill clears the last step that another has climbed to.

use anyhow::ensure;
use serde::Serialize;
use vocaloco_sim::{
    handover::{HandoverQuery, HandoverRow, hand_over, summarise},
    plant::PlantKind,
    rollout::{Perturbations, RolloutRules},
    terrain::CourseKind,
    threads::with_threads,
};

use super::viability::parse_perturb;
use crate::{
    exit::Exit,
    output, progress,
    verbs::{
        Shared,
        rolled::{Plant, Rolled},
    },
};

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Skill that comes to the last step
    #[arg(long, default_value = "ascend_network", value_name = "SKILL")]
    from: String,
    /// Skill that takes over there
    #[arg(long, default_value = "walk", value_name = "SKILL")]
    to: String,
    /// `stairs_up` or `stairs_down`, three steps
    #[arg(long, default_value = "stairs_up")]
    course: CourseKind,
    /// Step heights, m
    #[arg(long, value_delimiter = ',', default_value = "0.12", value_name = "LIST")]
    size_m: Vec<f32>,
    /// Handovers for each height
    #[arg(long, default_value_t = 200, value_name = "N")]
    samples: u64,
    /// What is drawn for each approach: protocol (noise, friction, mass, phase), all (these and push,
    /// latency, motor), none, or a list
    #[arg(long, default_value = "protocol", value_name = "LIST", value_parser = parse_perturb)]
    perturb: Perturbations,
    /// Plant to roll out on
    #[arg(long, value_enum, default_value_t = Plant::Reference)]
    plant: Plant,
    /// Uniform noise on every height that the plugins see, ± metres
    #[arg(long, default_value_t = 0.02, value_name = "M")]
    patch_noise_m: f32,
    /// Threads; 0 for as many as there are processors
    #[arg(long, default_value_t = 0, value_name = "N")]
    threads: usize,
    /// Robot to roll out
    #[arg(long, default_value = "anymal_d")]
    robot: String,
    #[command(flatten)]
    shared: Shared,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!(args.samples > 0, "--samples: found 0, wanted 1 or more");
    let noise_m = args.patch_noise_m;
    ensure!((0.0..=1.0).contains(&noise_m), "--patch-noise-m: found {noise_m}, wanted 0 to 1");
    let course = args.course.id();
    let has_one_flight = matches!(args.course, CourseKind::StairsUp | CourseKind::StairsDown);
    ensure!(has_one_flight, "--course: found {course}, wanted stairs_up or stairs_down");
    for size_m in &args.size_m {
        ensure!((0.0..=1.0).contains(size_m), "--size-m: found {size_m}, wanted 0 to 1");
    }
    let from = Rolled::load(&args.robot, &args.from)?;
    let to = Rolled::load(&args.robot, &args.to)?;
    let skills = [&from.skill, &to.skill];
    let what = format!("{} to {} on {}", args.from, args.to, course);
    let bar = progress::bar(&what, args.samples * args.size_m.len() as u64);
    let rows = args.size_m.iter().map(|size_m| {
        let query = HandoverQuery {
            rules: RolloutRules::of(&to.loaded.manifest.rollout),
            perturb: args.perturb.clone(),
            patch_noise_m: args.patch_noise_m,
            plant: args.plant.into(),
            ..HandoverQuery::new(args.course, *size_m, args.samples, args.shared.seed)
        };
        let handovers =
            with_threads(args.threads, || hand_over(&from.robot, skills, &query, &|| bar.inc(1)))??;
        Ok(summarise(skills, &query, &handovers))
    });
    let rows = rows.collect::<anyhow::Result<Vec<HandoverRow>>>();
    bar.finish_and_clear();
    report(args, &rows?)?;
    Ok(Exit::Fine)
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'a> {
    command: String,
    seed: u64,
    version: &'static str,
    rows: &'a [HandoverRow],
}

fn report(args: &Args, rows: &[HandoverRow]) -> anyhow::Result<()> {
    let command = command(args);
    if args.shared.json {
        let (seed, version) = (args.shared.seed, env!("CARGO_PKG_VERSION"));
        return Ok(output::json(&Report { command, seed, version, rows })?);
    }
    output::line(
        "step      n  cleared  95 % interval    collision  timeout  fault  not handed over  speed m/s",
    )?;
    for row in rows {
        let speed =
            row.speed_at_handover_m_per_s.map_or_else(|| "-".to_owned(), |speed| format!("{speed:.2}"));
        output::line(&format!(
            "{:<5.3} {:>5}  {:>7.3}  {:.3} to {:.3}  {:>9.3}  {:>7.3}  {:>5.3}  {:>15}  {speed:>9}",
            row.size_m,
            row.n,
            row.cleared,
            row.cleared_low,
            row.cleared_high,
            row.base_collision,
            row.timeout,
            row.fault,
            row.not_handed_over
        ))?;
    }
    output::line(&command)?;
    Ok(())
}

/// The command that repeats the table, on any number of threads.
fn command(args: &Args) -> String {
    let sizes: Vec<String> = args.size_m.iter().map(ToString::to_string).collect();
    format!(
        "vocaloco evaluate handover --from {} --to {} --course {} --size-m {} --samples {} --perturb {} \
         --plant {} --patch-noise-m {} --robot {} --seed {}",
        args.from,
        args.to,
        args.course.id(),
        sizes.join(","),
        args.samples,
        args.perturb,
        PlantKind::from(args.plant).id(),
        args.patch_noise_m,
        args.robot,
        args.shared.seed
    )
}
