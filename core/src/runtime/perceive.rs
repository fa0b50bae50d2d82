//! The first half of a tick: terrain into the predictors' field, the field into verdicts.

use std::panic::{AssertUnwindSafe, catch_unwind};

use super::{CallFault, Runtime, Supervision};
use crate::decision;
use crate::heightfield::{Field, Heightfield, Noise};
use crate::observation::Observation;
use crate::selector::{Choice, Prediction, Reason};
use crate::switch::Active;

/// Where the ground under the base may lie, m over the base's origin: elsewhere heights are of another frame or unit.
const GROUND_M: std::ops::RangeInclusive<f32> = -5.0..=-0.02;

fn below_the_base(heightfield: &Heightfield) -> Result<(), String> {
    // A spike or two in a map are not its frame.
    let mut around = [f32::NAN; 9];
    for (three, row) in around.chunks_mut(3).zip(&heightfield.cells_m[9..=11]) {
        three.copy_from_slice(&row[4..=6]);
    }
    around.sort_unstable_by(f32::total_cmp);
    let known = around.iter().filter(|height| height.is_finite());
    match known.clone().nth(known.count() / 2) {
        Some(ground) if !GROUND_M.contains(ground) => Err(format!(
            "elevation: height_m: found ground at {ground:.2} m under the base, wanted -5 to -0.02 m: heights are over the base's origin"
        )),
        _ => Ok(()),
    }
}

impl Runtime {
    /// The predictors' field; none, with an event, when the terrain cannot be used.
    pub(super) fn field(&mut self, observation: &Observation) -> Option<Field> {
        let age_s = |t_s: f64| observation.t_s - t_s;
        let max_age_s = self.config.max_age_s + 1e-9;
        let (drives, frozen_s) = (self.is_driven_by_a_skill(), self.config.frozen.terrain_s);
        let repeated_s =
            observation.elevation.as_ref().and_then(|seen| self.frozen.terrain_s(seen, drives, frozen_s));
        let prepared = match &observation.elevation {
            None => Err("elevation: found nothing, wanted a patch of terrain".to_owned()),
            // Phrased as "is inside", so a time that is no number is refused too.
            Some(elevation) if !(-max_age_s..=max_age_s).contains(&age_s(elevation.t_s)) => Err(format!(
                "elevation: found terrain {:.3} s old, wanted at most {} s",
                age_s(elevation.t_s),
                self.config.max_age_s
            )),
            Some(_) if let Some(held_s) = repeated_s => Err(format!(
                "elevation: found the same heights for {held_s:.3} s under new times, wanted others while a skill drives"
            )),
            Some(elevation) => {
                let noise: Option<&Noise> = observation.field_noise.as_ref();
                let heightfield = match &observation.heightfield {
                    Some(heightfield) => Ok(heightfield.clone()),
                    None => elevation.heightfield().map_err(|error| error.to_string()),
                };
                heightfield
                    .and_then(|heightfield| below_the_base(&heightfield).map(|()| heightfield))
                    .and_then(|heightfield| heightfield.prepare(noise).map_err(|error| error.to_string()))
            }
        };
        match prepared {
            Ok(field) => {
                decision::hash_into(&field, &mut self.decision.heightfield_hash);
                Some(field)
            }
            Err(event) => {
                self.decision.heightfield_hash.clear();
                self.decision.events.push(event);
                None
            }
        }
    }

    /// The prediction of one skill; one that is late is none.
    fn predict(&mut self, index: usize, field: &Field) -> Prediction {
        let began = self.now();
        let predictors = &mut self.skills[index].predictors;
        let predicted = catch_unwind(AssertUnwindSafe(|| predictors.predict(field)));
        let (prediction, failed) = predicted.unwrap_or_else(|_| {
            (Prediction::NONE, Some(CallFault::Failed("the model's runtime panicked".to_owned())))
        });
        let is_late = matches!(failed, Some(CallFault::Overrun(_)));
        self.count_overrun(is_late, began, Supervision::predict);
        match failed {
            Some(CallFault::Failed(line)) => self.decision.events.push(line),
            Some(fault) => {
                self.fail(index, "predict", &fault);
                if self.filter.active() == Active::Skill(index) {
                    self.late = Some(index);
                }
            }
            None => {}
        }
        prediction
    }

    /// Predictions and verdicts of every skill, into the record.
    pub(super) fn choose(&mut self, field: Option<&Field>, observation: &Observation) -> Choice {
        let choice = if let Some(field) = field {
            for index in 0..self.skills.len() {
                self.predictions[index] = if self.selector.out_of_service(index).is_some() {
                    Prediction::NONE
                } else {
                    self.predict(index, field)
                };
            }
            self.selector.choose(
                &self.predictions,
                &observation.command,
                self.filter.active(),
                &mut self.reasons,
            )
        } else {
            self.predictions.fill(Prediction::NONE);
            self.reasons.clear();
            let reason = |skill| self.selector.out_of_service(skill).unwrap_or(Reason::NoTerrain);
            self.reasons.extend((0..self.skills.len()).map(reason));
            Choice::Stop
        };
        let seen = self.predictions.iter().zip(&self.reasons);
        for (verdict, (prediction, reason)) in self.decision.skills.iter_mut().zip(seen) {
            verdict.viability = Some(prediction.viability).filter(|value| value.is_finite());
            verdict.cot = Some(prediction.cot).filter(|value| value.is_finite());
            verdict.strangeness = prediction.strangeness.filter(|value| value.is_finite());
            verdict.viable = matches!(reason, Reason::Viable { .. });
            verdict.reason = *reason;
        }
        choice
    }
}
