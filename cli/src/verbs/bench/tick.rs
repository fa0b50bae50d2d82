//! `bench tick`: how long the runtime takes from an observation to joint targets.

use std::time::Instant;

use anyhow::{Context, ensure};
use serde::Serialize;
use vocaloco_core::{
    decision::STAND,
    elevation::Elevation,
    installation::Installation,
    observation::Observation,
    predictor::backend,
    registry::{LoadedDeployment, LoadedSkill, ModelPolicy, load_deployment, load_skill},
    robot::RobotModel,
    runtime::Runtime,
};
use vocaloco_plugin_api::Command;

use crate::{exit::Exit, output, progress, verbs::Shared};

/// Time of a whole tick of the runtime: observation, field, two networks a skill, choice, plugin, checks.
///
/// The robot is told that it walks at 0.6 m/s towards stairs that come nearer tick by tick, over a patch
/// of 5 cm resolution; nothing is simulated and nothing is written, so the figures are the loop's alone,
/// on one thread. `driven_share` is the share of ticks in which a skill, not the stand, gave the targets.
///
/// More skills than the deployment has are its own over again, each with a plugin instance and networks
/// of its own. Allocations are not counted by this program: `allocations_per_tick` is null. `peer` is
/// null: no other program ticks these skills yet.
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
    #[command(flatten)]
    shared: Shared,
}

/// Ticks before time is taken: caches fill and buffers find their sizes.
const WARM_UP_TICKS: usize = 100;
/// Ticks after which the stairs are as far away as at the start.
const APPROACH_TICKS: usize = 64;

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
    allocations_per_tick: Option<f64>,
    backend: String,
    peer: Option<()>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!(args.ticks > 0, "--ticks: found 0, wanted 1 or more");
    ensure!(args.skills != Some(0), "--skills: found 0, wanted 1 or more");
    let installation = Installation::find()?;
    let mut loaded = load_deployment(&installation, &args.deployment)
        .with_context(|| format!("deployment `{}`", args.deployment))?;
    for refusal in &loaded.refused {
        eprintln!("{refusal}");
    }
    resize(&mut loaded, &installation, args.skills)?;
    let skills = loaded.skills.len();
    let mut observations = approach(&loaded.robot);
    let mut runtime = Runtime::new(loaded)?;
    let bar = progress::bar(&format!("{skills} skills"), args.ticks as u64);
    let mut times_us = Vec::with_capacity(args.ticks);
    let mut driven = 0_usize;
    for tick in 0..WARM_UP_TICKS + args.ticks {
        let observation = &mut observations[tick % APPROACH_TICKS];
        let t_s = 0.02 * tick as f64;
        observation.t_s = t_s;
        if let Some(elevation) = &mut observation.elevation {
            elevation.t_s = t_s;
        }
        #[expect(clippy::disallowed_methods, reason = "this verb measures time")]
        let start = Instant::now();
        let ticked = runtime.tick(observation);
        let time_us = 1e6 * start.elapsed().as_secs_f64();
        if tick >= WARM_UP_TICKS {
            times_us.push(time_us);
            driven += usize::from(ticked.decision.active != STAND);
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    times_us.sort_by(f64::total_cmp);
    let report = Report {
        command: args.command(skills),
        seed: args.shared.seed,
        version: env!("CARGO_PKG_VERSION"),
        deployment: args.deployment.clone(),
        skills,
        ticks: args.ticks,
        p50_us: quantile(&times_us, 0.5),
        p99_us: quantile(&times_us, 0.99),
        max_us: quantile(&times_us, 1.0),
        driven_share: driven as f64 / args.ticks as f64,
        allocations_per_tick: None,
        backend: format!("{} {}", backend().name, backend().version),
        peer: None,
    };
    if args.shared.json {
        output::json(&report)?;
    } else {
        let Report { p50_us, p99_us, max_us, .. } = report;
        output::line(&format!(
            "{skills} skills, {} ticks on {}: p50 {p50_us:.0} µs, p99 {p99_us:.0} µs, max {max_us:.0} µs; a \
             skill drove in {:.0} %\n{}",
            args.ticks,
            report.backend,
            100.0 * report.driven_share,
            report.command
        ))?;
    }
    Ok(Exit::Fine)
}

impl Args {
    fn command(&self, skills: usize) -> String {
        format!(
            "vocaloco bench tick --skills {skills} --ticks {} --deployment {} --seed {}",
            self.ticks, self.deployment, self.shared.seed
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

/// The robot as it stands, told that it walks, before stairs of 12 cm that come nearer.
fn approach(robot: &RobotModel) -> Vec<Observation> {
    let observation = |tick: usize| {
        let nearest_m = 0.8 - 0.012 * tick as f64;
        Observation {
            t_s: 0.0,
            joint_position_rad: robot.stand_position_rad(),
            joint_velocity_rad_per_s: vec![0.0; robot.joint_count()],
            joint_torque_nm: Some(vec![0.0; robot.joint_count()]),
            foot_contact: Some(vec![true; robot.description.feet.len()]),
            base_linear_velocity: [0.6, 0.0, 0.0],
            base_angular_velocity: [0.0; 3],
            projected_gravity: [0.0, 0.0, -1.0],
            base_in_odom: None,
            elevation: Some(stairs(nearest_m, robot.description.stand_height_m)),
            command: Command::velocity(0.6, 0.0, 0.0),
            field_noise: None,
        }
    };
    (0..APPROACH_TICKS).map(observation).collect()
}

/// Four steps up of 12 cm, 30 cm deep, the first `nearest_m` ahead of a base `height_m` over the floor.
fn stairs(nearest_m: f64, height_m: f64) -> Elevation {
    let mut elevation = Elevation {
        t_s: 0.0,
        resolution_m: 0.05,
        back_m: 1.2,
        front_m: 2.2,
        half_width_m: 0.7,
        height_m: Vec::new(),
    };
    let (rows, columns) = (elevation.rows(), elevation.columns());
    for row in 0..rows {
        let x_m = row as f64 * elevation.resolution_m - elevation.back_m;
        let steps = ((x_m - nearest_m) / 0.3 + 1.0).floor().clamp(0.0, 4.0);
        elevation.height_m.extend(std::iter::repeat_n((0.12 * steps - height_m) as f32, columns));
    }
    elevation
}

/// The least of `sorted` that a share of them does not exceed.
fn quantile(sorted: &[f64], share: f64) -> f64 {
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

    #[test]
    fn the_stairs_of_the_patch_are_sound_and_come_nearer() {
        let (far, near) = (stairs(0.8, 0.55), stairs(0.2, 0.55));
        for elevation in [&far, &near] {
            elevation.check().unwrap();
            assert!((elevation.height_m(0.0, 0.0) + 0.55).abs() < 1e-6);
        }
        assert!(near.height_m(0.5, 0.3) > far.height_m(0.5, 0.3) + 0.1);
    }
}
