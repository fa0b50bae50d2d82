//! `bench tick`: how long the runtime takes from an observation to joint targets.

use std::collections::BTreeMap;

use anyhow::{Context, ensure};
use serde::Serialize;
use vocaloco_core::{
    decision::STAND,
    installation::Installation,
    manifest::Deadlines,
    plugin::PluginLibrary,
    predictor::backend,
    registry::{LoadedDeployment, LoadedSkill, ModelPolicy, load_deployment, load_skill},
    runtime::{Pace, Runtime, Supervision},
};

use super::{
    approach::{APPROACH_TICKS, approach, stairs},
    tick_parts::{self, Parts},
    tick_peer::{self, Peer},
};
use crate::{
    allocations,
    exit::Exit,
    output, progress,
    verbs::{Shared, run::pace::clock},
};

/// Time of a whole tick of the runtime: observation, field, two networks a skill, choice, plugin, checks.
///
/// The robot is told that it walks at 0.6 m/s towards stairs that come nearer tick by tick, over a patch
/// of 5 cm resolution; nothing is simulated and nothing is written, so the figures are the loop's alone,
/// on one thread. `driven_share` is the share of ticks in which a skill, not the stand, gave the targets.
///
/// The same ticks are timed again with every call on a thread of its own, as in real time
/// (`real_time`, with budgets that nothing exceeds), and with every plugin in a process of its own
/// (`isolated`); `added_p50_us` is what that costs.
///
/// More skills than the deployment has are its own over again, each with a plugin instance and networks
/// of its own. `allocations_per_tick` is this program's; what a plugin's library allocates is not seen.
/// `parts` is what the networks, and the check whether their terrain is known, take by themselves.
/// `peer` runs the networks alone, two a skill, on one thread of Python's onnxruntime, where the
/// interpreter has that package, and must answer as ours do.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Skills to choose from; by default the deployment's, beyond them those again under other names
    #[arg(long, value_name = "N")]
    skills: Option<usize>,
    /// Ticks to time, after a hundred that are not
    #[arg(long, default_value_t = 2000, value_name = "N")]
    ticks: usize,
    /// Deployment whose skills tick
    #[arg(long, default_value = "anymal_stairs", value_name = "NAME")]
    deployment: String,
    /// Python interpreter that may have the package `onnxruntime`
    #[arg(long, default_value = "python3", value_name = "PATH")]
    python: String,
    #[command(flatten)]
    shared: Shared,
}

/// Ticks before time is taken: caches fill and buffers find their sizes.
const WARM_UP_TICKS: usize = 100;

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    command: String,
    seed: u64,
    version: &'static str,
    deployment: String,
    skills: usize,
    ticks: usize,
    p50_us: f64,
    p99_us: f64,
    max_us: f64,
    driven_share: f64,
    /// What of it the networks and the check of the terrain take.
    parts: Parts,
    real_time: Otherwise,
    isolated: Option<Otherwise>,
    allocations_per_tick: f64,
    /// What computes each kind of network, and how many there are of it.
    networks: BTreeMap<&'static str, usize>,
    backend: String,
    peer: Option<Peer>,
}

/// The same ticks with calls made otherwise, µs.
#[derive(Serialize)]
#[expect(clippy::struct_field_names, reason = "all of them are microseconds, and names end in their unit")]
struct Otherwise {
    p50_us: f64,
    p99_us: f64,
    max_us: f64,
    /// Half of the ticks take this much longer.
    added_p50_us: f64,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!(args.ticks > 0, "--ticks: found 0, wanted 1 or more");
    ensure!(args.skills != Some(0), "--skills: found 0, wanted 1 or more");
    let installation = Installation::find()?;
    let mut loaded = args.load(&installation)?;
    for refusal in &loaded.refused {
        eprintln!("{refusal}");
    }
    let skills = loaded.skills.len();
    let mut networks = BTreeMap::new();
    for predictor in loaded.skills.iter().flat_map(|skill| skill.viability.iter().chain(&skill.cot)) {
        *networks.entry(predictor.runs_on()).or_default() += 1;
        if let Some(note) = predictor.note() {
            eprintln!("{}: {note}", predictor.file().display());
        }
    }
    let field = stairs(0.4, loaded.robot.description.stand_height_m).heightfield()?.prepare(None)?;
    let parts = tick_parts::time(&mut loaded.skills, &field, args.ticks)?;
    let peer = tick_peer::time(&args.python, &mut loaded.skills, &field, args.ticks)?;
    let plain = args.time(Runtime::new(loaded)?);
    let otherwise = |runtime: Runtime| {
        let times_us = args.time(runtime).times_us;
        Otherwise {
            p50_us: quantile(&times_us, 0.5),
            p99_us: quantile(&times_us, 0.99),
            max_us: quantile(&times_us, 1.0),
            added_p50_us: quantile(&times_us, 0.5) - quantile(&plain.times_us, 0.5),
        }
    };
    // What a thread costs is asked here, not whether this machine keeps to the deployment's budgets.
    let deadlines = Deadlines { act_s: 10.0, predict_s: 10.0 };
    let supervision = Supervision { clock, deadlines, pace: Pace::Real };
    let real_time = otherwise(Runtime::new(args.load(&installation)?)?.supervised(supervision)?);
    let isolated = if cfg!(target_os = "linux") {
        let mut loaded = args.load(&installation)?;
        for skill in &mut loaded.skills {
            skill.library =
                PluginLibrary::open_isolated(&installation.plugin_path, &skill.manifest.plugin, &|_, _| {
                    Ok(())
                })?;
        }
        Some(otherwise(Runtime::new(loaded)?))
    } else {
        None
    };
    let report = Report {
        command: args.command(skills),
        seed: args.shared.seed,
        version: env!("CARGO_PKG_VERSION"),
        deployment: args.deployment.clone(),
        skills,
        ticks: args.ticks,
        p50_us: quantile(&plain.times_us, 0.5),
        p99_us: quantile(&plain.times_us, 0.99),
        max_us: quantile(&plain.times_us, 1.0),
        driven_share: plain.driven as f64 / args.ticks as f64,
        parts,
        real_time,
        isolated,
        allocations_per_tick: plain.allocations as f64 / args.ticks as f64,
        networks,
        backend: format!("{} {}", backend().name, backend().version),
        peer,
    };
    if args.shared.json {
        output::json(&report)?;
    } else {
        say(&report)?;
    }
    Ok(Exit::Fine)
}

fn say(report: &Report) -> anyhow::Result<()> {
    let Report { skills, ticks, p50_us, p99_us, max_us, .. } = report;
    let networks = report.networks.iter().map(|(name, count)| format!("{count} by {name}"));
    output::line(&format!(
        "{skills} skills, {ticks} ticks, networks {}: p50 {p50_us:.0} µs, p99 {p99_us:.0} µs, max {max_us:.0} \
         µs; a skill drove in {:.0} %; {:.2} allocations a tick",
        networks.collect::<Vec<_>>().join(", "),
        100.0 * report.driven_share,
        report.allocations_per_tick
    ))?;
    let Parts { networks_p50_us, known_terrain_p50_us } = report.parts;
    output::line(&format!(
        "of it, each alone: networks {networks_p50_us:.0} µs, check of the terrain {known_terrain_p50_us:.0} µs"
    ))?;
    if let Some(Peer { name, p50_us: theirs_us, .. }) = &report.peer {
        output::line(&format!(
            "the networks alone by {name}: p50 {theirs_us:.0} µs, {:.1} times as long as the whole tick",
            theirs_us / p50_us
        ))?;
    }
    let otherwise = [
        ("calls on threads of their own", Some(&report.real_time)),
        ("plugins in processes of their own", report.isolated.as_ref()),
    ];
    for (how, timed) in otherwise {
        if let Some(Otherwise { p50_us, p99_us, max_us, added_p50_us }) = timed {
            output::line(&format!(
                "{how}: p50 {p50_us:.0} µs ({added_p50_us:+.0}), p99 {p99_us:.0} µs, max {max_us:.0} µs"
            ))?;
        }
    }
    output::line(&report.command)?;
    Ok(())
}

/// Durations of ticks in order of size, and the number in which a skill drove.
struct Timed {
    times_us: Vec<f64>,
    driven: usize,
    allocations: u64,
}

impl Args {
    fn load(&self, installation: &Installation) -> anyhow::Result<LoadedDeployment> {
        let mut loaded = load_deployment(installation, &self.deployment)
            .with_context(|| format!("deployment `{}`", self.deployment))?;
        resize(&mut loaded, installation, self.skills)?;
        Ok(loaded)
    }

    fn time(&self, mut runtime: Runtime) -> Timed {
        let mut observations = approach(runtime.robot());
        let bar = progress::bar(&format!("{} skills", runtime.rules().len()), self.ticks as u64);
        let mut timed = Timed { times_us: Vec::with_capacity(self.ticks), driven: 0, allocations: 0 };
        for tick in 0..WARM_UP_TICKS + self.ticks {
            let observation = &mut observations[tick % APPROACH_TICKS];
            let t_s = 0.02 * tick as f64;
            observation.t_s = t_s;
            if let Some(elevation) = &mut observation.elevation {
                elevation.t_s = t_s;
            }
            let (start, allocations) = (clock(), allocations::count());
            let ticked = runtime.tick(observation);
            let time_us = 1e6 * clock().saturating_sub(start).as_secs_f64();
            if tick >= WARM_UP_TICKS {
                timed.allocations += allocations::count() - allocations;
                timed.times_us.push(time_us);
                timed.driven += usize::from(ticked.decision.active != STAND);
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        timed.times_us.sort_by(f64::total_cmp);
        timed
    }

    fn command(&self, skills: usize) -> String {
        format!(
            "vocaloco bench tick --skills {skills} --ticks {} --deployment {} --python {} --seed {}",
            self.ticks, self.deployment, self.python, self.shared.seed
        )
    }
}

/// Brings a deployment to `wanted` skills: its first ones, or all and copies of them under other names.
fn resize(
    loaded: &mut LoadedDeployment,
    installation: &Installation,
    wanted: Option<usize>,
) -> anyhow::Result<()> {
    let wanted = wanted.unwrap_or(loaded.skills.len());
    loaded.skills.truncate(wanted);
    let originals: Vec<String> = loaded.skills.iter().map(|skill| skill.manifest.name.clone()).collect();
    while loaded.skills.len() < wanted {
        let number = loaded.skills.len();
        let name = &originals[number % originals.len()];
        let mut copy: LoadedSkill =
            load_skill(installation, name, &loaded.robot.description, ModelPolicy::Required)?;
        copy.manifest.name = format!("{name}_{}", number / originals.len() + 1);
        loaded.skills.push(copy);
    }
    Ok(())
}

/// The least of `sorted` that a share of them does not exceed.
pub(super) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted[rank.clamp(1, sorted.len()) - 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantile_is_one_of_the_values_and_the_last_is_the_greatest() {
        let sorted: Vec<f64> = (1..=200).map(f64::from).collect();
        assert_eq!([0.5, 0.99, 1.0].map(|share| quantile(&sorted, share)), [100.0, 198.0, 200.0]);
        assert_eq!([0.0, 0.5, 1.0].map(|share| quantile(&[7.0], share)), [7.0; 3]);
    }
}
