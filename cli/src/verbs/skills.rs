//! `skills`: what is installed, whether it is sound, the start of a new one, and skills as files.

mod check;
mod install;
mod key;
mod list;
mod new;
mod pack;

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
    New(new::Args),
    /// Pack a skill into one file, signed or not
    Pack(pack::Args),
    /// Install a packed skill, whole or not at all
    Install(install::InstallArgs),
    /// Remove a skill that a bundle has brought
    Remove(install::RemoveArgs),
    /// Make a key pair for signing bundles and locks
    Key(key::Args),
}

pub(crate) fn run(args: Args) -> anyhow::Result<Exit> {
    match args.verb {
        Verb::List(args) => list::run(&args),
        Verb::Check(args) => check::run(&args),
        Verb::New(args) => new::run(&args),
        Verb::Pack(args) => pack::run(&args),
        Verb::Install(args) => install::install(&args),
        Verb::Remove(args) => install::remove(&args),
        Verb::Key(args) => key::run(&args),
    }
}
