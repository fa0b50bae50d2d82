//! `evaluate transfer`: what `evaluate viability` measures, in rapier and in MuJoCo side by side.

use serde::Serialize;
use vocaloco_sim::{
    evaluate::{ViabilityRow, summarise_rollouts},
    rollout::{Outcome, Rollout},
    threads::with_threads,
    transfer::{Agreement, Interpreter, Pair, Peers, SUBSTEPS, agreement, sample_pairs},
};

use super::viability;
use crate::{exit::Exit, output};

#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    protocol: viability::Args,
    /// Python interpreter that has the package `mujoco`
    #[arg(long, default_value = "python3", value_name = "PATH")]
    python: String,
}

/// What both simulators say about one size.
#[derive(Serialize)]
struct Difference {
    size_m: f32,
    /// Poses that stood in rapier and not in MuJoCo; they are in neither row.
    poses_dropped: u64,
    /// MuJoCo's viability minus rapier's.
    #[serde(flatten)]
    agreement: Agreement,
}

/// What `--json` prints; rows come in pairs, rapier first.
#[derive(Serialize)]
struct Report<'a> {
    command: String,
    seed: u64,
    version: &'static str,
    rows: &'a [ViabilityRow],
    differences: &'a [Difference],
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    let protocol = &args.protocol;
    let (rolled, rules) = protocol.prepare()?;
    let interpreter = Interpreter(args.python.clone());
    let peers = Peers::start(interpreter, rolled.installation.robots_folder(), &rolled.robot)?;
    let bar = protocol.bar(&format!("{} in rapier and MuJoCo {}", protocol.skill, peers.version()));
    let (mut rows, mut differences) = (Vec::new(), Vec::new());
    for size_m in &protocol.size_m {
        let query = protocol.query(*size_m, rules);
        let progress = || bar.inc(1);
        let pairs = with_threads(protocol.threads, || {
            sample_pairs(&rolled.robot, &rolled.skill, &query, &peers, &progress)
        })??;
        let stood: Vec<&Pair> = pairs.iter().flatten().collect();
        let row = |of: fn(&Pair) -> &Rollout| {
            let rollouts: Vec<&Rollout> = stood.iter().map(|pair| of(pair)).collect();
            summarise_rollouts(&rolled.skill, &query, &rollouts)
        };
        rows.push(row(|pair| &pair.rapier));
        rows.push(ViabilityRow {
            simulator: format!("mujoco {}", peers.version()),
            plant: format!("{SUBSTEPS} substeps"),
            ..row(|pair| &pair.mujoco)
        });
        let reached = |rollout: &Rollout| rollout.outcome == Outcome::Reached;
        differences.push(Difference {
            size_m: *size_m,
            poses_dropped: (pairs.len() - stood.len()) as u64,
            agreement: agreement(stood.iter().map(|pair| (reached(&pair.rapier), reached(&pair.mujoco)))),
        });
    }
    bar.finish_and_clear();
    let command = format!("{} --python {}", protocol.command("transfer", &rules), args.python);
    if protocol.shared.json {
        let (seed, version) = (protocol.shared.seed, env!("CARGO_PKG_VERSION"));
        output::json(&Report { command, seed, version, rows: &rows, differences: &differences })?;
    } else {
        table(&rows, &differences)?;
        output::line(&command)?;
    }
    Ok(Exit::Fine)
}

fn table(rows: &[ViabilityRow], differences: &[Difference]) -> anyhow::Result<()> {
    output::line(
        "size   simulator            n  viable  95 % interval    collision  timeout  fault    CoT   speed m/s",
    )?;
    for (pair, difference) in rows.chunks(2).zip(differences) {
        for row in pair {
            let cot = row.cot_mean.map_or_else(|| "-".to_owned(), |cot| format!("{cot:.3}"));
            output::line(&format!(
                "{:<6.3} {:<15} {:>6}  {:>6.3}  {:.3} to {:.3}  {:>9.3}  {:>7.3}  {:>5.3}  {cot:>5}  {:>10.2}",
                row.size_m,
                row.simulator,
                row.n,
                row.viable,
                row.viable_low,
                row.viable_high,
                row.base_collision,
                row.timeout,
                row.fault,
                row.mean_speed_m_per_s
            ))?;
        }
        let Agreement { points, points_low, points_high, .. } = difference.agreement;
        let dropped = match difference.poses_dropped {
            0 => String::new(),
            n => format!("; {n} poses did not stand in MuJoCo and are in neither row"),
        };
        output::line(&format!(
            "       MuJoCo − rapier: {points:+.1} points, {points_low:+.1} to {points_high:+.1}{dropped}"
        ))?;
    }
    Ok(())
}
