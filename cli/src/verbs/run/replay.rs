//! `run --source replay:FILE`: the recorded fields through this installation's predictors, selector
//! and switch filter, compared with what was decided then.

use std::path::Path;

use serde::Serialize;
use vocaloco_core::decision::Decision;
use vocaloco_core::decision_log::DecisionLog;
use vocaloco_core::predictor::{Predictor, backend};
use vocaloco_core::registry::LoadedDeployment;
use vocaloco_core::replay::replay;
use vocaloco_core::runtime::{RuntimeConfig, Skill};
use vocaloco_core::selector::{Prediction, Rule};

use super::{Args, load};
use crate::exit::Exit;
use crate::output;

/// Backends agree to 1e-5 on these networks; the record is rounded to single precision besides.
const SAME_PREDICTION: f32 = 1e-4;

#[derive(Serialize)]
struct Report {
    command: String,
    seed: u64,
    version: &'static str,
    backend: String,
    recorded_backend: String,
    ticks: usize,
    /// Ticks with another choice or another active skill.
    differing_ticks: usize,
    /// The first few of them.
    differences: Vec<Difference>,
    /// Largest distance between a prediction and its record.
    prediction_error: f32,
    truncated: Option<String>,
}

#[derive(Serialize)]
struct Difference {
    t_s: f64,
    tick: u64,
    recorded: [String; 2],
    replayed: [String; 2],
}

pub(super) fn run(args: &Args, file: &Path) -> anyhow::Result<Exit> {
    anyhow::ensure!(!args.real_time, "--real-time: found it, wanted nothing with --source replay:");
    if let Some(log) = &args.log {
        // A replay decides choice and driver only: with the recorded reasons and predictions beside
        // them, such a log would contradict itself.
        anyhow::bail!(
            "--log: found {}, wanted nothing with --source replay: (its report says what differs)",
            log.display()
        );
    }
    let recorded = DecisionLog::read(file)?;
    if let Some(changed) = recorded.decisions.iter().find(|decision| decision.roster.is_some()) {
        anyhow::bail!(
            "{}: found other skills from {:.2} s on, wanted the record of one set of skills",
            file.display(),
            changed.t_s
        );
    }
    let (loaded, _) = load(args)?;
    let mut fresh = Fresh::of(loaded);
    let windows = fresh.config.windows;
    let rules = fresh.rules.clone();
    let (names, setup): (Vec<_>, Vec<_>) = (
        rules.iter().map(|rule| rule.name.as_str()).collect(),
        recorded.setup.skills.iter().map(|skill| skill.name.as_str()).collect(),
    );
    anyhow::ensure!(
        names == setup,
        "{}: skills: found {}, wanted {} as deployment `{}` has them",
        file.display(),
        setup.join(", "),
        names.join(", "),
        args.deployment
    );
    let replayed =
        replay(&rules, windows, &recorded.decisions, |decision, skill| fresh.predict(decision, skill));
    let differences = || {
        let pairs = replayed.iter().zip(&recorded.decisions);
        pairs.filter(|(again, decision)| !again.agrees_with(decision)).map(|(again, decision)| Difference {
            t_s: decision.t_s,
            tick: decision.tick,
            recorded: [decision.choice.clone(), decision.active.clone()],
            replayed: [again.choice.clone(), again.active.clone()],
        })
    };
    let report = Report {
        command: format!("vocaloco run --deployment {} --source replay:{}", args.deployment, file.display()),
        seed: args.shared.seed,
        version: env!("CARGO_PKG_VERSION"),
        backend: format!("{} {}", backend().name, backend().version),
        recorded_backend: recorded.setup.backend,
        ticks: replayed.len(),
        differing_ticks: differences().count(),
        differences: differences().take(20).collect(),
        prediction_error: fresh.largest_error,
        truncated: recorded.truncated,
    };
    if args.shared.json {
        output::json(&report)?;
    } else {
        say(&report)?;
    }
    let same = report.differing_ticks == 0 && report.prediction_error <= SAME_PREDICTION;
    Ok(if same { Exit::Fine } else { Exit::Finding })
}

fn say(report: &Report) -> anyhow::Result<()> {
    output::line(&format!(
        "{} ticks decided again: {} differ, predictions within {:.1e} of the record",
        report.ticks, report.differing_ticks, report.prediction_error
    ))?;
    for difference in &report.differences {
        let [choice, active] = &difference.recorded;
        let [choice_now, active_now] = &difference.replayed;
        output::line(&format!(
            "  {:8.2} s, tick {}: chose {choice}, {active} drove; now {choice_now}, {active_now}",
            difference.t_s, difference.tick
        ))?;
    }
    if let Some(why) = &report.truncated {
        eprintln!("the log ends early: {why}");
    }
    Ok(())
}

/// The predictors of this installation.
struct Fresh {
    rules: Vec<Rule>,
    config: RuntimeConfig,
    networks: Vec<[Option<Predictor>; 2]>,
    largest_error: f32,
}

impl Fresh {
    fn of(loaded: LoadedDeployment) -> Self {
        Self {
            rules: loaded.skills.iter().map(Skill::rule_of).collect(),
            config: RuntimeConfig::from(&loaded.deployment),
            networks: loaded.skills.into_iter().map(|skill| [skill.viability, skill.cot]).collect(),
            largest_error: 0.0,
        }
    }

    /// The prediction for a recorded field, compared with the recorded one.
    fn predict(&mut self, decision: &Decision, skill: usize) -> Prediction {
        let (Some(field), then) = (&decision.field, &decision.skills[skill]) else { return Prediction::NONE };
        // A skill that was out of service was not asked.
        if then.reason.is_out_of_service() && then.viability.is_none() && then.cot.is_none() {
            return Prediction::NONE;
        }
        let [viability, cot] = self.networks[skill].each_mut().map(|network| {
            network.as_mut().and_then(|network| network.predict(field).ok()).unwrap_or(f32::NAN)
        });
        let before = then.prediction();
        for (now, then) in [(viability, before.viability), (cot, before.cot)] {
            // Phrased so that a number where there was none, and the other way round, counts.
            let error = if now.is_nan() && then.is_nan() { 0.0 } else { (now - then).abs() };
            self.largest_error = if error.is_nan() { f32::INFINITY } else { self.largest_error.max(error) };
        }
        let strangeness = self.networks[skill][0].as_ref().and_then(|network| network.strangeness(field));
        Prediction { viability, cot, strangeness }
    }
}
