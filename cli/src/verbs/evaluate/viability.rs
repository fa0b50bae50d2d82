//! `evaluate viability`: how often a skill passes the horizon, by terrain and size.

use anyhow::ensure;
use indicatif::ProgressBar;
use serde::Serialize;
use vocaloco_sim::{
    evaluate::{Query, ViabilityRow, sample, summarise},
    rollout::{Perturbations, RolloutRules},
    spawn::SpawnRules,
    terrain::TerrainKind,
    threads::with_threads,
};

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
    /// Skill to measure; it needs no predictors
    #[arg(long)]
    pub(super) skill: String,
    /// flat, rough, slope, discrete, `stairs_up`, `stairs_down`, wall or gap
    #[arg(long, value_parser = parse_terrain)]
    pub(super) terrain: TerrainKind,
    /// Sizes, m: step or obstacle height, gap width, roughness; rise per metre of a slope
    #[arg(long, value_delimiter = ',', default_value = "0", value_name = "LIST")]
    pub(super) size_m: Vec<f32>,
    /// Fresh poses for each size, one rollout each
    #[arg(long, default_value_t = 200, value_name = "N")]
    pub(super) samples: u64,
    /// Distance to cover, m; by default the skill's own, 1.5 unless its manifest says otherwise
    #[arg(long, value_name = "M")]
    horizon_m: Option<f64>,
    /// Time for it, s; by default the skill's own (4 for 1.5 m), in proportion to the horizon
    #[arg(long, value_name = "S")]
    time_limit_s: Option<f64>,
    /// Yaw about the terrain's direction, ± radians; any yaw on undirected terrain
    #[arg(long, default_value_t = 0.3, value_name = "RAD")]
    yaw_rad: f32,
    /// On directed terrain only poses whose base is this far before the obstacle, least and most, m;
    /// without it anywhere on the tile, as in collection
    #[arg(long, value_name = "LEAST,MOST", value_parser = parse_range)]
    start_before_m: Option<Range>,
    /// What is drawn for each rollout: protocol (noise, friction, mass, phase), all (these and push,
    /// latency, motor), none, or a list
    #[arg(long, default_value = "protocol", value_name = "LIST", value_parser = parse_perturb)]
    perturb: Perturbations,
    /// Plant to roll out on
    #[arg(long, value_enum, default_value_t = Plant::Reference)]
    plant: Plant,
    /// Uniform noise on every height that the plugin sees, ± metres
    #[arg(long, default_value_t = 0.02, value_name = "M")]
    patch_noise_m: f32,
    /// Threads; 0 for as many as there are processors
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub(super) threads: usize,
    /// Robot to roll out
    #[arg(long, default_value = "anymal_d")]
    robot: String,
    #[command(flatten)]
    pub(super) shared: Shared,
}

pub(crate) fn parse_terrain(text: &str) -> Result<TerrainKind, String> {
    let ids = TerrainKind::ALL.map(TerrainKind::id).join(" ");
    TerrainKind::from_id(text).ok_or_else(|| format!("found {text:?}, wanted one of {ids}"))
}

/// Least and most, m.
type Range = [f32; 2];

fn parse_range(text: &str) -> Result<Range, String> {
    let numbers = text.split_once(',').and_then(|(least, most)| least.parse().ok().zip(most.parse().ok()));
    // Phrased as "is inside", so that NaN is refused too.
    match numbers {
        Some((least, most)) if 0.0 <= least && least <= most && most <= 3.0 => Ok([least, most]),
        _ => Err(format!("found {text:?}, wanted LEAST,MOST in metres, 0 to 3, such as 0.4,0.6")),
    }
}

pub(super) fn parse_perturb(text: &str) -> Result<Perturbations, String> {
    Perturbations::parse(text)
        .ok_or_else(|| format!("found {text:?}, wanted protocol, all, none, or a list of noise, friction, mass, phase, push, latency, motor"))
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    let (rolled, rules) = args.prepare()?;
    let bar = args.bar(&args.skill);
    let rows = args.size_m.iter().map(|size_m| {
        let query = args.query(*size_m, rules);
        let samples =
            with_threads(args.threads, || sample(&rolled.robot, &rolled.skill, &query, &|| bar.inc(1)))??;
        Ok(summarise(&rolled.skill, &query, &samples))
    });
    let rows = rows.collect::<anyhow::Result<Vec<ViabilityRow>>>();
    bar.finish_and_clear();
    report(args, &rules, &rows?)?;
    Ok(Exit::Fine)
}

impl Args {
    /// Checks what clap cannot, and loads robot and skill.
    pub(super) fn prepare(&self) -> anyhow::Result<(Rolled, RolloutRules)> {
        ensure!(self.samples > 0, "--samples: found 0, wanted 1 or more");
        ensure!((0.0..=3.15).contains(&self.yaw_rad), "--yaw-rad: found {}, wanted 0 to 3.14", self.yaw_rad);
        let noise_m = self.patch_noise_m;
        ensure!((0.0..=1.0).contains(&noise_m), "--patch-noise-m: found {noise_m}, wanted 0 to 1");
        for size_m in &self.size_m {
            ensure!((0.0..=2.0).contains(size_m), "--size-m: found {size_m}, wanted 0 to 2");
        }
        let rolled = Rolled::load(&self.robot, &self.skill)?;
        let rules = rules(self, &rolled)?;
        Ok((rolled, rules))
    }

    /// What is asked at one size.
    pub(super) fn query(&self, size_m: f32, rules: RolloutRules) -> Query {
        Query {
            rules,
            spawn: SpawnRules {
                yaw_rad: self.yaw_rad,
                any_yaw_share: 0.0,
                start_before_m: self.start_before_m,
                ..SpawnRules::default()
            },
            perturb: self.perturb.clone(),
            patch_noise_m: self.patch_noise_m,
            plant: self.plant.into(),
            ..Query::new(self.terrain, size_m, self.samples, self.shared.seed)
        }
    }

    /// Over all poses of all sizes.
    pub(super) fn bar(&self, what: &str) -> ProgressBar {
        progress::bar(&format!("{what} on {}", self.terrain), self.samples * self.size_m.len() as u64)
    }

    /// The command that repeats the table, on any number of threads.
    pub(super) fn command(&self, experiment: &str, rules: &RolloutRules) -> String {
        let sizes: Vec<String> = self.size_m.iter().map(ToString::to_string).collect();
        let start = self
            .start_before_m
            .map_or_else(String::new, |[least_m, most_m]| format!(" --start-before-m {least_m},{most_m}"));
        format!(
            "vocaloco evaluate {experiment} --skill {} --terrain {} --size-m {} --samples {} --horizon-m {} \
             --time-limit-s {} --yaw-rad {}{start} --perturb {} --plant {} --patch-noise-m {} --robot {} --seed {}",
            self.skill,
            self.terrain,
            sizes.join(","),
            self.samples,
            rules.horizon_m,
            rules.time_limit_s,
            self.yaw_rad,
            self.perturb,
            match self.plant {
                Plant::Reference => "reference",
                Plant::Fast => "fast",
            },
            self.patch_noise_m,
            self.robot,
            self.shared.seed
        )
    }
}

fn rules(args: &Args, rolled: &Rolled) -> anyhow::Result<RolloutRules> {
    let own = RolloutRules::of(&rolled.loaded.manifest.rollout);
    let horizon_m = args.horizon_m.unwrap_or(own.horizon_m);
    ensure!((0.1..=4.0).contains(&horizon_m), "--horizon-m: found {horizon_m}, wanted 0.1 to 4");
    let time_limit_s = args.time_limit_s.unwrap_or(own.time_limit_s * horizon_m / own.horizon_m);
    ensure!((0.1..=60.0).contains(&time_limit_s), "--time-limit-s: found {time_limit_s}, wanted 0.1 to 60");
    Ok(RolloutRules { horizon_m, time_limit_s, ..own })
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'a> {
    command: String,
    seed: u64,
    version: &'static str,
    rows: &'a [ViabilityRow],
}

fn report(args: &Args, rules: &RolloutRules, rows: &[ViabilityRow]) -> anyhow::Result<()> {
    let command = args.command("viability", rules);
    if args.shared.json {
        let seed = args.shared.seed;
        return Ok(output::json(&Report { command, seed, version: env!("CARGO_PKG_VERSION"), rows })?);
    }
    output::line(
        "size      n  viable  95 % interval    collision  timeout  fault    CoT  speed m/s  after 1 s",
    )?;
    for row in rows {
        let or_dash = |value: Option<f64>, digits: usize| {
            value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
        };
        let (cot, cruise) = (or_dash(row.cot_mean, 3), or_dash(row.cruise_speed_m_per_s, 2));
        output::line(&format!(
            "{:<5.3} {:>5}  {:>6.3}  {:.3} to {:.3}  {:>9.3}  {:>7.3}  {:>5.3}  {cot:>5}  {:>9.2}  {cruise:>9}",
            row.size_m,
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
    output::line(&command)?;
    Ok(())
}
