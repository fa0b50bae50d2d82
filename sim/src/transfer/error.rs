//! Why a comparison did not come to its end.

use thiserror::Error;

use crate::collect::CollectError;

/// What went wrong with the second simulator.
#[derive(Debug, Error)]
pub enum TransferError {
    /// The interpreter does not start.
    #[error(
        "--python: {python} does not start ({reason}), wanted a Python interpreter with the package mujoco: \
         `python3 -m venv mj && mj/bin/pip install mujoco`, then `--python mj/bin/python3`"
    )]
    NoInterpreter {
        /// The interpreter tried.
        python: String,
        /// Why it did not start.
        reason: String,
    },
    /// The interpreter lacks a package.
    #[error("--python: {python} lacks a package ({missing}): `{python} -m pip install mujoco`")]
    NoMujoco {
        /// The interpreter tried.
        python: String,
        /// What it says.
        missing: String,
    },
    /// Its model is not the robot.
    #[error("{model} in MuJoCo: found {found_kg:.3} kg, wanted {wanted_kg:.3} kg")]
    OtherRobot {
        /// The robot's file.
        model: String,
        /// Mass there, kg.
        found_kg: f64,
        /// Mass here, kg.
        wanted_kg: f64,
    },
    /// It could not do what it was asked.
    #[error("MuJoCo could not {action}: {message}")]
    Refused {
        /// What it was asked.
        action: &'static str,
        /// What it says.
        message: String,
    },
    /// It ended or answered out of turn.
    #[error("MuJoCo's process, asked to {action}: found {found}, wanted a line of JSON")]
    OutOfTurn {
        /// What it was asked.
        action: &'static str,
        /// What came instead.
        found: String,
    },
    /// No pose to start from.
    #[error(transparent)]
    Pose(#[from] CollectError),
}
