//! `run --source stdio`.

use std::io;
use std::ops::ControlFlow;

use vocaloco_core::decision_log::{LogError, LogWriter, Setup};
use vocaloco_core::stdio::{Greeting, serve};

use super::input::until_asked_to_end;
use super::{Args, pace, start};
use crate::exit::Exit;

pub(super) fn run(args: &Args) -> anyhow::Result<Exit> {
    let (mut runtime, refused) = start(args, true)?;
    let greeting = Greeting::of(&runtime, &args.deployment, refused);
    let setup = Setup::of(&runtime, &args.deployment);
    let mut log = args.log.as_deref().map(|file| LogWriter::create(file, &setup)).transpose()?;
    let served = serve(&mut runtime, &greeting, until_asked_to_end()?, io::stdout().lock(), |decision| {
        match log.as_mut().map(|log| log.write(decision)) {
            Some(Err(error)) => {
                report(&error);
                log = None;
                ControlFlow::Break(())
            }
            _ => ControlFlow::Continue(()),
        }
    })?;
    let ended = log.map_or(Ok(()), LogWriter::finish);
    if let Err(error) = &ended {
        report(error);
    }
    let logged = !served.unseen && ended.is_ok();
    eprintln!("{} lines answered, {} of them with an error", served.lines, served.errors);
    pace::narrate(&runtime.times(), args.shared.json)?;
    Ok(if served.errors == 0 && logged { Exit::Fine } else { Exit::Finding })
}

/// A log that fails ends alone: whoever waits for joint targets still gets them.
fn report(error: &LogError) {
    eprintln!("error: --log: {error}; the log ends here");
}
