//! `train-policy`: hands over to `vocaloco-train`, as [`super::train`] does.

use std::ffi::OsString;

use super::{Shared, train};
use crate::exit::Exit;

/// Train a skill's policy in the simulator: imitation and PPO, or CMA-ES.
#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub(crate) struct Args {
    #[command(flatten)]
    _shared: Shared,
    /// Passed on to `vocaloco-train train-policy`; `--help` lists them
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    _passed_on: Vec<OsString>,
}

pub(crate) fn run(_args: Args) -> anyhow::Result<Exit> {
    train::hand_over("train-policy", "train-policy")
}
