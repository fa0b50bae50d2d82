//! `explain`: why each skill was chosen or refused, from a decisions log, and what would have been.

mod danger;
mod story;
mod what_if;

use std::path::PathBuf;

use serde::Serialize;
use vocaloco_core::decision::Decision;
use vocaloco_core::decision_log::{DecisionLog, Setup};

use self::danger::DangerOf;
use self::story::{Event, Stretch, Turn};
use self::what_if::{Alternative, Changes};
use super::Shared;
use crate::exit::Exit;
use crate::output;

/// Says why each skill was chosen or refused, from a decisions log.
///
/// Without --tick: who drove when, and why each change came. With it: every prediction of that tick
/// against its threshold. --what-if decides the recorded predictions over again under other
/// thresholds and windows; the recorded terrain stays what it was, so it answers for the moments
/// before the robot would have gone elsewhere.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    shared: Shared,
    /// A decisions log (MCAP), as `run --log` and `demo` write it
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Explain this tick
    #[arg(long, value_name = "T")]
    tick: Option<u64>,
    /// Which cells of that tick's field drive each skill's viability, by the installed predictors
    #[arg(long, requires = "tick")]
    danger: bool,
    /// Other rules: `threshold.SKILL=V`, `window=N`, `stop_window=N`, `resume_window=N`, comma-separated
    #[arg(long, value_name = "CHANGES")]
    what_if: Option<Changes>,
}

#[derive(Serialize)]
struct Report<'a> {
    command: String,
    seed: u64,
    version: &'static str,
    setup: &'a Setup,
    ticks: usize,
    stretches: Vec<Stretch>,
    changes: Vec<Turn>,
    events: Vec<Event>,
    #[serde(skip_serializing_if = "Option::is_none")]
    decision: Option<&'a Decision>,
    #[serde(skip_serializing_if = "Option::is_none")]
    what_if: Option<Alternative>,
    #[serde(skip_serializing_if = "Option::is_none")]
    danger: Option<Vec<DangerOf>>,
    truncated: Option<&'a str>,
}

pub(crate) fn run(args: Args) -> anyhow::Result<Exit> {
    let log = DecisionLog::read(&args.file)?;
    let decision = args.tick.map(|tick| find(&log, tick)).transpose()?;
    let what_if = args.what_if.as_ref().map(|changes| what_if::decide(changes, &log)).transpose()?;
    let danger = decision.filter(|_| args.danger).map(danger::of).transpose()?;
    let report = Report {
        command: command(&args),
        seed: args.shared.seed,
        version: env!("CARGO_PKG_VERSION"),
        setup: &log.setup,
        ticks: log.decisions.len(),
        stretches: story::stretches(&log.decisions, |decision| decision.active.clone()),
        changes: story::changes(&log),
        events: story::events(&log.decisions),
        decision,
        what_if,
        danger,
        truncated: log.truncated.as_deref(),
    };
    if args.shared.json {
        output::json(&report)?;
    } else {
        say(&report, decision)?;
    }
    Ok(Exit::Fine)
}

fn command(args: &Args) -> String {
    let mut words = vec![format!("vocaloco explain {}", args.file.display())];
    words.extend(args.tick.map(|tick| format!("--tick {tick}")));
    words.extend(args.danger.then(|| "--danger".to_owned()));
    words.extend(args.what_if.as_ref().map(|changes| format!("--what-if {changes}")));
    words.join(" ")
}

fn find(log: &DecisionLog, tick: u64) -> anyhow::Result<&Decision> {
    log.decisions.iter().find(|decision| decision.tick == tick).ok_or_else(|| {
        let last = log.decisions.last().map_or(0, |decision| decision.tick);
        anyhow::anyhow!("--tick: found {tick}, wanted 0 to {last}")
    })
}

fn say(report: &Report<'_>, decision: Option<&Decision>) -> anyhow::Result<()> {
    if let Some(decision) = decision {
        for line in story::tick(decision, report.setup) {
            output::line(&line)?;
        }
        for line in report.danger.as_deref().map(danger::lines).unwrap_or_default() {
            output::line(&line)?;
        }
    } else if report.what_if.is_none() {
        let setup = report.setup;
        let skills: Vec<_> = setup
            .skills
            .iter()
            .map(|skill| format!("{} {}", skill.name, skill.viability_threshold))
            .collect();
        output::line(&format!(
            "{} ticks of {} on {} ({}); viability thresholds: {}; windows {}, {} to stop, {} to resume",
            report.ticks,
            setup.deployment,
            setup.robot,
            setup.backend,
            skills.join(", "),
            setup.switch_window,
            setup.stop_window,
            setup.resume_window
        ))?;
        for stretch in &report.stretches {
            output::line(&stretch.to_string())?;
        }
        for change in &report.changes {
            output::line(&change.to_string())?;
        }
        for event in &report.events {
            output::line(&event.to_string())?;
        }
    }
    if let Some(alternative) = &report.what_if {
        output::line(&format!(
            "under {}: {} of {} ticks differ",
            alternative.changes, alternative.differing_ticks, report.ticks
        ))?;
        for stretch in &alternative.stretches {
            output::line(&stretch.to_string())?;
        }
    }
    if let Some(why) = report.truncated {
        eprintln!("the log ends early: {why}");
    }
    Ok(())
}
