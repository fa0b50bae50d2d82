//! `bench train`: hands over to `vocaloco-train bench-train`, as `train` does.

use std::ffi::OsString;

use crate::{
    exit::Exit,
    verbs::{Shared, train},
};

/// Samples a second in which a predictor is fitted, beside PyTorch on the same data and start.
#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub(crate) struct Args {
    #[command(flatten)]
    _shared: Shared,
    /// Passed on to `vocaloco-train bench-train`; `--help` lists them
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    _passed_on: Vec<OsString>,
}

pub(crate) fn run() -> anyhow::Result<Exit> {
    train::hand_over("train", "bench-train")
}
