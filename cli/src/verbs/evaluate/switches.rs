//! `evaluate switches`: what a switch does to the joints, by how targets go over.

use anyhow::{Context, ensure};
use serde::Serialize;
use vocaloco_core::{
    installation::Installation,
    registry::load_deployment,
    runtime::{Runtime, Switching},
};
use vocaloco_sim::{
    course::{CourseConfig, Peaks, Runtimes, SwitchesRow, switches},
    terrain::CourseKind,
    threads::with_threads,
};

use crate::{exit::Exit, output, progress, verbs::Shared};

#[derive(clap::Args)]
pub(crate) struct Args {
    /// `stairs_up`, `stairs_down` or `obstacles`
    #[arg(long)]
    course: CourseKind,
    /// Step height, m
    #[arg(long, default_value_t = 0.12, value_name = "M")]
    size_m: f32,
    /// Rollouts for each way of switching
    #[arg(long, default_value_t = 20, value_name = "N")]
    rollouts: u64,
    /// Windows over which targets go over, s; those above 0 are measured with mixing and without
    #[arg(long, value_delimiter = ',', default_value = "0,0.1,0.2", value_name = "LIST")]
    ramp_s: Vec<f64>,
    /// Deployment whose skills may run
    #[arg(long, default_value = "anymal_stairs", value_name = "NAME")]
    deployment: String,
    /// Threads; 0 for as many as there are processors
    #[arg(long, default_value_t = 0, value_name = "N")]
    threads: usize,
    #[command(flatten)]
    shared: Shared,
}

#[derive(Serialize)]
struct Report<'a> {
    command: String,
    seed: u64,
    version: &'static str,
    rows: &'a [SwitchesRow],
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!(args.rollouts > 0, "--rollouts: found 0, wanted 1 or more");
    ensure!((0.0..=1.0).contains(&args.size_m), "--size-m: found {}, wanted 0 to 1", args.size_m);
    for ramp_s in &args.ramp_s {
        ensure!((0.0..=1.0).contains(ramp_s), "--ramp-s: found {ramp_s}, wanted 0 to 1");
    }
    let installation = Installation::find()?;
    let loaded = load_deployment(&installation, &args.deployment)
        .with_context(|| format!("deployment `{}`", args.deployment))?;
    let ways: Vec<Switching> = args
        .ramp_s
        .iter()
        .flat_map(|&ramp_s| {
            let mixed: &[bool] = if ramp_s > 0.0 { &[false, true] } else { &[false] };
            mixed.iter().map(move |&mixing| Switching { ramp_s, mixing })
        })
        .collect();
    let bar = progress::bar(args.course.id(), args.rollouts * ways.len() as u64);
    let config = CourseConfig::evaluation(args.course, args.size_m, args.shared.seed, 0);
    let row = |&switching: &Switching| -> anyhow::Result<SwitchesRow> {
        let runtimes = Runtimes::new("vocaloco", || {
            let loaded = load_deployment(&installation, &args.deployment)?;
            Ok(Runtime::new(loaded)?.with_switching(switching).into())
        });
        let by = (switching, &runtimes);
        let measure = || switches(&loaded.robot, &config, args.rollouts, by, &|| bar.inc(1));
        Ok(with_threads(args.threads, measure)??)
    };
    let rows = ways.iter().map(row).collect::<anyhow::Result<Vec<_>>>();
    bar.finish_and_clear();
    report(args, &rows?)?;
    Ok(Exit::Fine)
}

fn report(args: &Args, rows: &[SwitchesRow]) -> anyhow::Result<()> {
    let ramps: Vec<String> = args.ramp_s.iter().map(ToString::to_string).collect();
    let command = format!(
        "vocaloco evaluate switches --course {} --size-m {} --rollouts {} --ramp-s {} --deployment {} --seed {}",
        args.course.id(),
        args.size_m,
        args.rollouts,
        ramps.join(","),
        args.deployment,
        args.shared.seed
    );
    if args.shared.json {
        let seed = args.shared.seed;
        return Ok(output::json(&Report { command, seed, version: env!("CARGO_PKG_VERSION"), rows })?);
    }
    output::line(
        "window        n  reached   peak rad/s², p50 p95 max: at switches, before them, within, at starts, at stops   peak \
         N·m: the same",
    )?;
    for row in rows {
        let way = if row.mixing { " mixed" } else { "" };
        output::line(&format!(
            "{:<12} {:>3}  {:>6.3}   {}",
            format!("{:.2} s{way}", row.ramp_s),
            row.n,
            row.reached,
            [
                &row.acceleration_at_switches,
                &row.acceleration_before,
                &row.acceleration_within,
                &row.acceleration_at_starts,
                &row.acceleration_at_stops,
                &row.torque_at_switches,
                &row.torque_before,
                &row.torque_within,
                &row.torque_at_starts,
                &row.torque_at_stops,
            ]
            .map(|of| peaks(of.as_ref()))
            .join("   "),
        ))?;
    }
    output::line(&command)?;
    Ok(())
}

fn peaks(peaks: Option<&Peaks>) -> String {
    peaks.map_or_else(
        || "none".to_owned(),
        |peaks| format!("{:.0} {:.0} {:.0} (n {})", peaks.p50, peaks.p95, peaks.max, peaks.n),
    )
}
