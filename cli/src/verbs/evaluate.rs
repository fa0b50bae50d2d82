//! `evaluate`: measures skills by the protocol. One file an experiment, below.

mod agreement;
mod arena;
mod arena_args;
mod calibration;
mod calibration_figures;
mod calibration_page;
mod cells;
mod course;
mod handover;
mod paper;
mod promise;
mod store;
mod success;
mod switches;
mod transfer;
mod viability;
mod who;

pub(super) use viability::parse_terrain;

use super::learning;
use crate::exit::Exit;

#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    experiment: Experiment,
}

#[derive(clap::Subcommand)]
enum Experiment {
    /// One skill by the collection protocol, one rollout per fresh pose
    Viability(viability::Args),
    Agreement(agreement::Args),
    /// Predicted against collected viability and cost of transport, by size
    Calibration(calibration::Args),
    /// Terrain that the predictors never saw: what the check finds of it, and of known terrain
    Novelty(learning::Args),
    Success(success::Args),
    Course(course::Args),
    Promise(promise::Args),
    All(paper::Args),
    /// How hard the joints are shaken while one skill takes over from another
    Switches(switches::Args),
    /// One skill takes over from another while the hind feet are still on a staircase's last step
    Handover(handover::Args),
    /// The same skill, nothing retuned, in rapier and in MuJoCo (a Python process) from the same poses
    Transfer(transfer::Args),
}

pub(crate) fn run(args: Args) -> anyhow::Result<Exit> {
    match args.experiment {
        Experiment::Viability(args) => viability::run(&args),
        Experiment::Agreement(args) => agreement::run(&args),
        Experiment::Calibration(args) => calibration::run(&args),
        Experiment::Novelty(_) => learning::hand_over("novelty", "novelty"),
        Experiment::Success(args) => success::run(&args),
        Experiment::Course(args) => course::run(&args),
        Experiment::Promise(args) => promise::run(&args),
        Experiment::All(args) => paper::run(&args),
        Experiment::Switches(args) => switches::run(&args),
        Experiment::Handover(args) => handover::run(&args),
        Experiment::Transfer(args) => transfer::run(&args),
    }
}
