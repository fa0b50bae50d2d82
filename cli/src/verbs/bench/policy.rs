//! `bench policy`: hands over to `vocaloco-train bench-policy`, as `train` does.

use std::ffi::OsString;

use crate::{
    exit::Exit,
    verbs::{Shared, train},
};

/// Policy steps a second in training: physics alone, the environment, the whole loop of PPO.
#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub(crate) struct Args {
    #[command(flatten)]
    _shared: Shared,
    /// Passed on to `vocaloco-train bench-policy`; `--help` lists them
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    _passed_on: Vec<OsString>,
}

pub(crate) fn run() -> anyhow::Result<Exit> {
    train::hand_over("policy", "bench-policy")
}
