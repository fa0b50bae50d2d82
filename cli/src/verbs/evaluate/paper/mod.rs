//! `evaluate all`: every experiment of docs/method.md, and the ablations, as tables, figures and one
//! page that holds the paper's claims beside what was measured.

mod claims;
mod figures;
mod findings;
mod pictures;
mod plan;
mod roles;
mod tables;

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use serde::Serialize;
use vocaloco_core::{installation::Installation, predictor::backend};

use self::claims::{Claim, Evidence, Verdict};
use self::findings::{Findings, Measuring};
use self::plan::Plan;
use super::arena::Arena;
use super::course::palette;
use super::store::Store;
use super::who::Who;
use crate::report::{ClaimLine, Figure, Paper};
use crate::{exit::Exit, output, progress, verbs::Shared};

/// Measures everything that the paper reports, and writes it down beside its claims.
///
/// A killed run goes on where it was: every result stands in a file of its own, found again by the
/// configuration and the hashes of all models; delete `measured/` or say --fresh to measure anew.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// A few rollouts of everything, within minutes
    #[arg(long)]
    quick: bool,
    /// Rollouts a height and selector; the ablations take at most as many
    #[arg(long, value_name = "N")]
    rollouts: Option<u64>,
    /// Fresh poses a skill, terrain and height
    #[arg(long, value_name = "N")]
    samples: Option<u64>,
    /// Deployment whose skills may run
    #[arg(long, default_value = "anymal_stairs", value_name = "NAME")]
    deployment: String,
    /// The end-to-end skill to compare with: it runs alone and never stops
    #[arg(long, default_value = "end_to_end", value_name = "NAME")]
    baseline: String,
    /// Deployment of the same skills whose thresholds promise something, compared on the staircases; the
    /// deployment's name with `_promised` behind it where there is one
    #[arg(long, value_name = "NAME")]
    promised: Option<String>,
    /// Deployment of the same skills and others added to them, for the course of obstacles; `anymal_obstacles` where
    /// there is one
    #[arg(long, value_name = "NAME")]
    added: Option<String>,
    /// Folder for the page, tables, figures, logs and what was measured
    #[arg(long, default_value = "out/paper", value_name = "DIR")]
    out: PathBuf,
    /// Measure even what stands
    #[arg(long)]
    fresh: bool,
    /// Threads; 0 for as many as there are processors
    #[arg(long, default_value_t = 0, value_name = "N")]
    threads: usize,
    #[command(flatten)]
    shared: Shared,
}

#[derive(Serialize)]
struct Summary<'a> {
    command: &'a str,
    seed: u64,
    version: &'static str,
    backend: &'a str,
    deployment: &'a str,
    baseline: &'a str,
    roles: &'a roles::Roles,
    plan: &'a Plan,
    claims: &'a [Claim],
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    for (flag, count) in [("rollouts", args.rollouts), ("samples", args.samples)] {
        ensure!(count != Some(0), "--{flag}: found 0, wanted 1 or more");
    }
    let plan = if args.quick { Plan::quick(args.shared.seed) } else { Plan::full(args.shared.seed) };
    let plan = plan.with_counts(args.rollouts, args.samples);
    for folder in ["tables", "figures", "logs"] {
        let folder = args.out.join(folder);
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    let store = Store::open(&args.out.join("measured"), args.fresh)?;
    let arena = Arena::load(&args.deployment, &[&args.baseline], (store.clone(), args.threads))?;
    let (promised, added) = (promised(args)?, added(args)?);
    let another = |name: &String| Arena::load(name, &[], (store.clone(), args.threads));
    let promised_arena = promised.as_ref().map(another).transpose()?;
    let added_arena = added.as_ref().map(another).transpose()?;
    if let Some(promised) = &promised_arena {
        let (found, wanted) = (promised.names().join(", "), arena.names().join(", "));
        ensure!(
            found == wanted,
            "deployment `{}`: skills: found {found}, wanted {wanted}, those of `{}` it is compared with",
            promised.deployment,
            arena.deployment
        );
    }
    let new_skills: Vec<String> = added_arena.as_ref().map_or_else(Vec::new, |added| new_in(added, &arena));
    if let Some(added) = &added_arena {
        ensure!(
            new_skills.len() + arena.names().len() == added.names().len() && !new_skills.is_empty(),
            "deployment `{}`: skills: found {}, wanted those of `{}`, {}, and others",
            added.deployment,
            added.names().join(", "),
            arena.deployment,
            arena.names().join(", ")
        );
    }
    let baseline = Who::Skill(args.baseline.clone());
    let bar = progress::bar("", 0);
    let measuring = Measuring {
        arena: &arena,
        promised: promised_arena.as_ref(),
        added: added_arena.as_ref(),
        plan: &plan,
        baseline: &baseline,
        out: &args.out,
        bar: &bar,
    };
    bar.set_length(measuring.pieces());
    let findings = measuring.all()?;
    bar.finish_and_clear();

    let skills = arena.names();
    let all_skills = added_arena.as_ref().map(Arena::names);
    let mut palette = palette(&arena, std::slice::from_ref(&baseline));
    palette.extend(new_skills);
    let roles = findings.roles(&skills).context("no skill is 90 % viable on flat ground")?;
    let evidence = Evidence {
        findings: &findings,
        plan: &plan,
        roles: &roles,
        skills: &skills,
        baseline: &args.baseline,
        deployment: &args.deployment,
        promised: promised.as_deref(),
        added: added.as_deref().zip(all_skills.as_deref()),
        palette: &palette,
    };
    let (claims, figures) = (evidence.claims(), figures::figures(&evidence));
    let backend = backend();
    let backend = format!("{} {}", backend.name, backend.version);
    let command = command(args);
    let summary = Summary {
        command: &command,
        seed: args.shared.seed,
        version: env!("CARGO_PKG_VERSION"),
        backend: &backend,
        deployment: &args.deployment,
        baseline: &args.baseline,
        roles: &roles,
        plan: &plan,
        claims: &claims,
    };
    write(&args.out.join("report.json"), &(serde_json::to_string_pretty(&summary)? + "\n"))?;
    tables::write(&args.out.join("tables"), &evidence, &claims)?;
    pictures::write(&args.out.join("figures"), &figures)?;
    let page = args.out.join("report.html");
    write(&page, &paper(&summary, &arena, palette.clone(), findings, figures).html()?)?;
    if args.shared.json {
        output::json(&summary)?;
    } else {
        print(&claims, &page, &command)?;
    }
    Ok(Exit::Fine)
}

/// The deployment whose thresholds promise something, if there is one.
fn promised(args: &Args) -> anyhow::Result<Option<String>> {
    if args.promised.is_some() {
        return Ok(args.promised.clone());
    }
    let name = format!("{}_promised", args.deployment);
    Ok(Installation::find()?.deployment_file(&name).exists().then_some(name))
}

/// The deployment with skills added, if there is one.
fn added(args: &Args) -> anyhow::Result<Option<String>> {
    if args.added.is_some() {
        return Ok(args.added.clone());
    }
    let name = "anymal_obstacles".to_owned();
    Ok(Installation::find()?.deployment_file(&name).exists().then_some(name))
}

/// Skills of a deployment that another does not have, in its order.
fn new_in(added: &Arena, arena: &Arena) -> Vec<String> {
    let known = arena.names();
    added.names().into_iter().filter(|name| !known.contains(name)).map(str::to_owned).collect()
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

fn paper(
    summary: &Summary<'_>,
    arena: &Arena,
    palette: Vec<String>,
    findings: Findings,
    figures: Vec<Figure>,
) -> Paper {
    let plan = summary.plan;
    let (ablations, results): (Vec<Figure>, Vec<Figure>) =
        figures.into_iter().partition(|figure| figure.title.starts_with("Ablation"));
    let (dangers, results): (Vec<Figure>, Vec<Figure>) =
        results.into_iter().partition(|figure| figure.id.starts_with("danger"));
    Paper {
        version: summary.version,
        command: summary.command.to_owned(),
        seed: summary.seed,
        backend: summary.backend.to_owned(),
        lead: format!(
            "What Wu et al. (2025) report, measured again: {} in the simulator, skills {}, against the end-to-end skill {} that runs \
             alone and never stops.",
            arena.robot.name,
            arena.names().join(", "),
            summary.baseline
        ),
        caveat: if plan.quick {
            format!(
                "The short version: {} rollouts a height and selector, {} poses a skill and height. Intervals are wide and verdicts may \
                 turn; without --quick it is measured in full.",
                plan.rollouts, plan.samples
            )
        } else {
            String::new()
        },
        claims: summary.claims.iter().map(claim_line).collect(),
        figures: vec![
            ("Results".to_owned(), results),
            ("Where is the danger?".to_owned(), dangers),
            ("Ablations".to_owned(), ablations),
        ],
        courses: findings.runs.into_iter().map(|run| run.packed).collect(),
        palette,
        field_caption: "Heights around the base as the networks see them, each with ±0.1 m of noise; blue is low.".to_owned(),
        conditions: vec![
            format!("Deployment {}: viability thresholds {}.", summary.deployment, arena.thresholds_in_words()),
            format!(
                "Skills by what they turned out to be good at: cheapest on the level {}, most viable up stairs {}, down stairs {}.",
                summary.roles.level, summary.roles.up, summary.roles.down
            ),
            "rapier at 200 Hz, decisions at 50 Hz, 0.6 m/s straight ahead; friction 0.5 to 1.25, base mass ±5 kg, sensor noise; ±10 cm \
             on every height that predictors see, ±2 cm on those that skills see."
                .to_owned(),
            "Reached: within 0.5 m of the target on the far flat. Crashed: the base touched something. Stopped: stood for 2 s by the \
             selector's verdict. Stuck: three times the time at 0.6 m/s. The first that happens counts."
                .to_owned(),
            "The oracle is the selector fed with collected viability and cost by skill, terrain under the field, and height.".to_owned(),
        ],
    }
}

fn claim_line(claim: &Claim) -> ClaimLine {
    ClaimLine {
        claim: claim.words.clone(),
        by: claim.by.to_owned(),
        ours: claim.ours.clone(),
        verdict: match claim.verdict {
            Verdict::Agrees => "agrees",
            Verdict::Differs => "differs",
            Verdict::NotMeasured => "unmeasured",
        },
        why: claim.why.clone(),
        n: claim.n.clone(),
        seed: claim.seed,
        command: claim.command.clone(),
        figure: claim.figure.map(str::to_owned),
    }
}

fn print(claims: &[Claim], page: &Path, command: &str) -> anyhow::Result<()> {
    for claim in claims {
        let verdict = match claim.verdict {
            Verdict::Agrees => "agrees",
            Verdict::Differs => "differs",
            Verdict::NotMeasured => "not measured",
        };
        output::line(&format!("{verdict:<13} {}\n              {}", claim.words, claim.ours))?;
    }
    output::line(&format!("\nRead it: {}\nRepeat it: {command}", page.display()))?;
    Ok(())
}

/// The command that repeats it, on any number of threads.
fn command(args: &Args) -> String {
    let mut words = vec!["vocaloco evaluate all".to_owned()];
    if args.quick {
        words.push("--quick".to_owned());
    }
    words.extend(args.rollouts.map(|rollouts| format!("--rollouts {rollouts}")));
    words.extend(args.samples.map(|samples| format!("--samples {samples}")));
    words.extend(args.promised.as_ref().map(|name| format!("--promised {name}")));
    words.extend(args.added.as_ref().map(|name| format!("--added {name}")));
    words.push(format!(
        "--deployment {} --baseline {} --seed {}",
        args.deployment, args.baseline, args.shared.seed
    ));
    words.join(" ")
}
