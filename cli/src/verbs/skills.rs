//! `skills`: what is installed, whether it is sound, and the start of a new one.

mod check;
mod list;
mod new;

use crate::exit::Exit;

#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(clap::Subcommand)]
enum Verb {
    /// List the skills that have a manifest
    List(list::Args),
    /// Check every skill and deployment, or the skills named; exit code 1 when one is not sound
    Check(check::Args),
    /// Start a skill: a plugin from the template, its manifest and its folder
    New(new::Args),
}

pub(crate) fn run(args: Args) -> anyhow::Result<Exit> {
    match args.verb {
        Verb::List(args) => list::run(&args),
        Verb::Check(args) => check::run(&args),
        Verb::New(args) => new::run(&args),
    }
}
