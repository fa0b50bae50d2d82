//! What of a tick its networks and its check of the terrain take, each alone.

use serde::Serialize;
use vocaloco_core::heightfield::Field;
use vocaloco_core::predictor::Predictor;
use vocaloco_core::registry::LoadedSkill;

use super::tick::quantile;
use crate::verbs::run::pace::clock;

/// Half of the rounds take no longer than this, µs.
#[derive(Serialize)]
pub(super) struct Parts {
    /// All networks of all skills.
    pub(super) networks_p50_us: f64,
    /// Whether each skill's predictors know the terrain.
    pub(super) known_terrain_p50_us: f64,
}

/// Times both on one field.
///
/// # Errors
/// A network has no answer.
pub(super) fn time(skills: &mut [LoadedSkill], field: &Field, rounds: usize) -> anyhow::Result<Parts> {
    let mut predictors: Vec<&mut Predictor> =
        skills.iter_mut().flat_map(|skill| skill.viability.iter_mut().chain(&mut skill.cot)).collect();
    let mut p50_us = |job: fn(&mut Predictor, &Field) -> anyhow::Result<()>| {
        let mut times_us = Vec::with_capacity(rounds);
        // A tenth more rounds come first, untimed, as in the peer.
        for round in 0..rounds + rounds / 10 {
            let start = clock();
            for predictor in &mut predictors {
                job(predictor, field)?;
            }
            if round >= rounds / 10 {
                times_us.push(1e6 * clock().saturating_sub(start).as_secs_f64());
            }
        }
        times_us.sort_by(f64::total_cmp);
        anyhow::Ok(quantile(&times_us, 0.5))
    };
    Ok(Parts {
        networks_p50_us: p50_us(|predictor, field| {
            std::hint::black_box(predictor.predict(field)?);
            Ok(())
        })?,
        known_terrain_p50_us: p50_us(|predictor, field| {
            std::hint::black_box(predictor.strangeness(field));
            Ok(())
        })?,
    })
}
