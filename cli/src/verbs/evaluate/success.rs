//! `evaluate success`: how often a course is reached, by step height and by who chooses.

use anyhow::{Context, bail, ensure};
use serde::Serialize;
use vocaloco_core::{installation::Installation, registry::load_deployment, runtime::Runtime};
use vocaloco_sim::{
    course::{CourseConfig, CourseError, Selector, SuccessRow, success},
    driver::SensorNoise,
    rollout::RolledSkill,
    terrain::CourseKind,
    threads::with_threads,
};

use crate::{exit::Exit, output, progress, verbs::Shared};

#[derive(clap::Args)]
pub(crate) struct Args {
    /// `stairs_up` or `stairs_down`
    #[arg(long, value_parser = parse_course)]
    course: CourseKind,
    /// Step heights, m
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    size_m: Vec<f32>,
    /// Rollouts for each height
    #[arg(long, default_value_t = 100, value_name = "N")]
    rollouts: u64,
    /// Who chooses: `vocaloco`, or `skill:NAME` for one skill alone
    #[arg(long, default_value = "vocaloco", value_name = "WHO")]
    selector: String,
    /// Number of steps
    #[arg(long, default_value_t = 6, value_name = "N")]
    steps: usize,
    /// Deployment whose skills may run
    #[arg(long, default_value = "anymal_stairs", value_name = "NAME")]
    deployment: String,
    /// Half-width of the noise on every height that the predictors see, m
    #[arg(long, default_value_t = 0.1, value_name = "M")]
    field_noise_m: f32,
    /// Half-width of the noise on every height that the skills see, m
    #[arg(long, default_value_t = 0.02, value_name = "M")]
    patch_noise_m: f32,
    /// Threads; 0 for as many as there are processors
    #[arg(long, default_value_t = 0, value_name = "N")]
    threads: usize,
    #[command(flatten)]
    shared: Shared,
}

pub(super) fn parse_course(text: &str) -> Result<CourseKind, String> {
    let ids = CourseKind::ALL.map(CourseKind::id).join(" ");
    CourseKind::from_id(text).ok_or_else(|| format!("found {text:?}, wanted one of {ids}"))
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!(!args.size_m.is_empty(), "--size-m: found nothing, wanted one height or more");
    ensure!(args.rollouts > 0, "--rollouts: found 0, wanted 1 or more");
    ensure!((1..=40).contains(&args.steps), "--steps: found {}, wanted 1 to 40", args.steps);
    for size_m in &args.size_m {
        ensure!((0.0..=1.0).contains(size_m), "--size-m: found {size_m}, wanted 0 to 1");
    }
    for (flag, noise_m) in [("field", args.field_noise_m), ("patch", args.patch_noise_m)] {
        ensure!((0.0..=1.0).contains(&noise_m), "--{flag}-noise-m: found {noise_m}, wanted 0 to 1");
    }
    let installation = Installation::find()?;
    let loaded = load_deployment(&installation, &args.deployment)
        .with_context(|| format!("deployment `{}`", args.deployment))?;
    for refusal in &loaded.refused {
        eprintln!("refused: {refusal}");
    }
    let robot = loaded.robot.clone();
    let skill;
    let runtime = || -> Result<Runtime, CourseError> {
        Ok(Runtime::new(load_deployment(&installation, &args.deployment)?)?)
    };
    let selector = match args.selector.split_once(':') {
        None if args.selector == "vocaloco" => Selector::Vocaloco(&runtime),
        Some(("skill", name)) => {
            let found = loaded.skills.iter().find(|skill| skill.manifest.name == name);
            let found = found.with_context(|| format!("--selector: `{name}` is not in the deployment"))?;
            skill = RolledSkill::from_loaded(found, &robot)?;
            Selector::Skill(&skill)
        }
        _ => bail!("--selector: found {:?}, wanted vocaloco or skill:NAME", args.selector),
    };
    let bar = progress::bar(
        &format!("{} with {}", args.course.id(), args.selector),
        args.rollouts * args.size_m.len() as u64,
    );
    let row = |size_m: &f32| -> anyhow::Result<SuccessRow> {
        let config = CourseConfig {
            steps: args.steps,
            noise: SensorNoise { patch_m: args.patch_noise_m, ..SensorNoise::default() },
            field_noise_m: args.field_noise_m,
            ..CourseConfig::evaluation(args.course, *size_m, args.shared.seed, 0)
        };
        let rollouts = args.rollouts;
        Ok(with_threads(args.threads, || success(&robot, &config, rollouts, &selector, &|| bar.inc(1)))??)
    };
    let rows = args.size_m.iter().map(row).collect::<anyhow::Result<Vec<_>>>();
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
    rows: &'a [SuccessRow],
}

fn report(args: &Args, rows: &[SuccessRow]) -> anyhow::Result<()> {
    let command = command(args);
    if args.shared.json {
        let seed = args.shared.seed;
        return Ok(output::json(&Report { command, seed, version: env!("CARGO_PKG_VERSION"), rows })?);
    }
    output::line("step      n  reached  95 % interval   crashed  95 % interval   stuck  stopped    CoT")?;
    for row in rows {
        let cot = row.cot_mean.map_or_else(|| "-".to_owned(), |cot| format!("{cot:.3}"));
        output::line(&format!(
            "{:<5.3} {:>5}  {:>7.3}  {:.3} to {:.3}  {:>7.3}  {:.3} to {:.3}  {:>6.3}  {:>7.3}  {cot:>5}",
            row.size_m,
            row.n,
            row.reached,
            row.reached_low,
            row.reached_high,
            row.crashed,
            row.crashed_low,
            row.crashed_high,
            row.stuck,
            row.stopped
        ))?;
    }
    output::line(&command)?;
    Ok(())
}

/// The command that repeats the table, on any number of threads.
fn command(args: &Args) -> String {
    let sizes: Vec<String> = args.size_m.iter().map(ToString::to_string).collect();
    format!(
        "vocaloco evaluate success --course {} --size-m {} --rollouts {} --selector {} --steps {} \
         --deployment {} --field-noise-m {} --patch-noise-m {} --seed {}",
        args.course.id(),
        sizes.join(","),
        args.rollouts,
        args.selector,
        args.steps,
        args.deployment,
        args.field_noise_m,
        args.patch_noise_m,
        args.shared.seed
    )
}
