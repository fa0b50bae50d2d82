//! `run --source stdio`.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use serde_json::json;
use vocaloco_core::decision_log::{LogBeside, LogError, LogWriter, Setup};
use vocaloco_core::stdio::{Greeting, serve};

use super::input::until_asked_to_end;
use super::{Args, start};
use crate::exit::Exit;
use crate::output;

pub(super) fn run(args: &Args) -> anyhow::Result<Exit> {
    let lines = until_asked_to_end()?;
    let (mut runtime, refused) = start(args, true)?;
    let greeting = Greeting::of(&runtime, &args.deployment, refused);
    let setup = Setup::of(&runtime, &args.deployment);
    let mut log = args.log.as_deref().map(|file| begin_log(file, &setup, !args.real_time)).transpose()?;
    let served = serve(&mut runtime, &greeting, lines, output::results(), |decision| {
        match log.as_mut().map(|log| log.write(decision)) {
            Some(Err(error)) => {
                report(&error);
                ControlFlow::Break(())
            }
            _ => ControlFlow::Continue(()),
        }
    });
    // However it ended, the log is whole, and what ticks took is said.
    let ended = log.map_or(Ok(()), LogBeside::finish);
    if let Err(error) = &ended {
        report(error);
    }
    let served = match served {
        Ok(served) => served,
        Err(error) => {
            let times = runtime.times();
            output::narrate(if args.shared.json {
                json!({ "timing": times }).to_string()
            } else {
                times.to_string()
            });
            return Err(error.into());
        }
    };
    if served.unheard {
        output::narrate("error: stdout: found nobody who reads the answers any more; the loop ends here");
    }
    let (times, answers) = (runtime.times(), &served.times);
    if args.shared.json {
        output::narrate(json!({ "timing": times, "answers": {
            "lines": served.lines, "errors": served.errors,
            "p50_us": answers.p50_us, "p99_us": answers.p99_us, "max_us": answers.max_us, "missed": answers.missed,
        } }));
    } else {
        output::narrate(format_args!(
            "{} lines answered, {} of them with an error: p50 {:.0} µs, p99 {:.0} µs, max {:.0} µs from a line to the \
             next, {} longer than a period",
            served.lines, served.errors, answers.p50_us, answers.p99_us, answers.max_us, answers.missed
        ));
        output::narrate(times);
    }
    let logged = !served.unseen && ended.is_ok();
    Ok(if served.errors == 0 && logged && !served.unheard { Exit::Fine } else { Exit::Finding })
}

/// A log beside the loop. One of an earlier run is set aside: it may be that of a fall, and a bridge that starts
/// the loop again does so with the same words.
fn begin_log(file: &Path, setup: &Setup, waits: bool) -> anyhow::Result<LogBeside> {
    if file.is_file() && file.metadata().is_ok_and(|about| about.len() > 0) {
        let aside = unused(file);
        std::fs::rename(file, &aside)
            .with_context(|| format!("--log: {} to {}", file.display(), aside.display()))?;
        output::narrate(format_args!("{} is set aside as {}", file.display(), aside.display()));
    }
    Ok(LogBeside::start(LogWriter::create(file, setup)?, waits)?)
}

/// The first of `decisions.1.mcap`, `decisions.2.mcap`, … that is not there.
fn unused(file: &Path) -> PathBuf {
    let extension = file.extension().map(|it| format!(".{}", it.to_string_lossy())).unwrap_or_default();
    let numbered = (1_u32..).map(|number| file.with_extension(format!("{number}{extension}")));
    numbered.into_iter().find(|other| !other.exists()).unwrap_or_else(|| file.to_owned())
}

/// A log that fails ends alone: whoever waits for joint targets still gets them.
fn report(error: &LogError) {
    output::narrate(format_args!("error: --log: {error}; the log ends here"));
}
