//! How many policy steps a second environments make, and where the time goes.

use std::{sync::Arc, time::Instant};

use rayon::prelude::*;
use serde::Serialize;
use vocaloco_plugin_api::JointTarget;

use super::{Environment, TrainingGround};
use crate::driver::DECIMATION;

/// Steps that an environment makes in a row, as a learner has it.
const STEPS_IN_A_ROW: usize = 24;

/// Who drives while time is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Actor {
    /// Actions of zero: the contract's default position.
    Zero,
    /// The experts of the configuration.
    Expert,
}

/// Policy steps per second on the present pool's threads.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Speed {
    /// Threads used.
    pub threads: usize,
    /// Of environments, all of a step included.
    pub steps_per_s: f64,
    /// Of the same plants under the same last targets, physics alone.
    pub physics_steps_per_s: f64,
    /// Time of a step beyond physics, µs on one thread.
    pub overhead_us: f64,
}

/// Steps `count` environments for `rounds` of 24 steps, then their plants alone for as many.
pub fn measure(ground: &Arc<TrainingGround>, count: u32, rounds: usize, actor: Actor) -> Speed {
    let mut environments: Vec<Environment> =
        (0..count).into_par_iter().map(|index| Environment::new(ground, index)).collect();
    let steps = (environments.len() * rounds * STEPS_IN_A_ROW) as f64;
    let seconds_of = |work: &mut dyn FnMut()| {
        #[expect(clippy::disallowed_methods, reason = "this function measures time")]
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64()
    };
    let whole_s = seconds_of(&mut || {
        for _ in 0..rounds {
            environments.par_iter_mut().for_each(|environment| run(environment, actor));
        }
    });
    let physics_s = seconds_of(&mut || {
        for _ in 0..rounds {
            environments.par_iter_mut().for_each(|environment| {
                let targets: Vec<JointTarget> = environment.targets.clone();
                for _ in 0..STEPS_IN_A_ROW * DECIMATION {
                    environment.plant.step(&targets);
                }
            });
        }
    });
    let threads = rayon::current_num_threads();
    Speed {
        threads,
        steps_per_s: steps / whole_s,
        physics_steps_per_s: steps / physics_s,
        overhead_us: 1e6 * (whole_s - physics_s) * threads as f64 / steps,
    }
}

fn run(environment: &mut Environment, actor: Actor) {
    let mut action = vec![0.0; environment.action_len()];
    for _ in 0..STEPS_IN_A_ROW {
        if actor == Actor::Expert && !environment.expert_action(&mut action) {
            action.fill(0.0);
        }
        if environment.step(&action).end.is_some() {
            environment.begin_episode();
        }
    }
}
