//! Verbs of learning: they are handed over to `vocaloco-train`, the binary beside this one, as cargo runs
//! its subcommands, so that nothing of learning is compiled into what a robot runs.

use std::ffi::OsString;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, bail};

use super::Shared;
use crate::exit::Exit;
use crate::output;

#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub(crate) struct Args {
    #[command(flatten)]
    _shared: Shared,
    /// Passed on to `vocaloco-train`; `--help` lists them
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    _passed_on: Vec<OsString>,
}

/// Runs `vocaloco-train VERB …` with the arguments that followed the word `typed` here, and ends as it
/// ended.
///
/// # Errors
/// There is no such binary beside this one, or it does not start.
pub(super) fn hand_over(typed: &str, verb: &str) -> anyhow::Result<Exit> {
    let here = std::env::current_exe().context("the folder of this program")?;
    let binary = here.with_file_name(format!("vocaloco-train{}", std::env::consts::EXE_SUFFIX));
    check_is_there(&binary)?;
    // As typed, not as parsed: what is passed on keeps its order and its own defaults.
    let arguments = std::env::args_os().skip(1).skip_while(|word| word != typed).skip(1);
    let status = Command::new(&binary)
        .arg(verb)
        .args(arguments)
        .stdout(output::handed_on()?)
        .status()
        .with_context(|| format!("{} does not start", binary.display()))?;
    Ok(match status.code() {
        Some(0) => Exit::Fine,
        Some(1) => Exit::Finding,
        _ => Exit::CouldNotRun,
    })
}

fn check_is_there(binary: &Path) -> anyhow::Result<()> {
    if !binary.is_file() {
        bail!(
            "{}: found nothing, wanted the learning binary; `cargo build --package vocaloco-train` makes it",
            binary.display()
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        _args: Args,
    }

    #[test]
    fn any_argument_is_left_to_the_learning_binary() {
        for line in [
            &["", "--skill", "walk", "--seed", "3", "--json"][..],
            &["", "--seed", "3", "--skill", "walk", "--no-mirror"],
            &["", "--help"],
            &["", "--json", "--epochs", "5"],
        ] {
            assert!(Cli::try_parse_from(line).is_ok(), "{line:?}");
        }
    }

    #[test]
    fn a_missing_learning_binary_is_named_with_the_command_that_makes_it() {
        let error = check_is_there(Path::new("/nowhere/vocaloco-train")).unwrap_err().to_string();
        assert!(error.contains("/nowhere/vocaloco-train") && error.contains("cargo build"), "{error}");
    }
}
