//! `evaluate novelty`: hands over to `vocaloco-train novelty`, as `train` does: the check is fitted anew.

use std::ffi::OsString;

use crate::exit::Exit;
use crate::verbs::{Shared, train};

#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub(crate) struct Args {
    #[command(flatten)]
    _shared: Shared,
    /// Passed on to `vocaloco-train novelty`; `--help` lists them
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    _passed_on: Vec<OsString>,
}

pub(crate) fn run() -> anyhow::Result<Exit> {
    train::hand_over("novelty", "novelty")
}
