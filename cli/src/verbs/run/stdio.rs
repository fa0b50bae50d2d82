//! `run --source stdio`.

use std::io;

use vocaloco_core::decision_log::{LogWriter, Setup};
use vocaloco_core::runtime::Runtime;
use vocaloco_core::stdio::{Greeting, serve};

use super::{Args, load};
use crate::exit::Exit;

pub(super) fn run(args: &Args) -> anyhow::Result<Exit> {
    let (loaded, refused) = load(args)?;
    let mut runtime = Runtime::new(loaded)?;
    let greeting = Greeting::of(&runtime, &args.deployment, refused);
    let setup = Setup::of(&runtime, &args.deployment);
    let mut log = args.log.as_deref().map(|file| LogWriter::create(file, &setup)).transpose()?;
    let served = serve(&mut runtime, &greeting, io::stdin().lock(), io::stdout().lock(), |decision| {
        log.as_mut().map_or(Ok(()), |log| log.write(decision)).map_err(io::Error::other)
    })?;
    if let Some(log) = log {
        log.finish()?;
    }
    eprintln!("{} lines answered, {} of them with an error", served.lines, served.errors);
    Ok(if served.errors == 0 { Exit::Fine } else { Exit::Finding })
}
