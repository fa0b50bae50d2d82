//! The oracle: the selector fed with what was collected instead of what is predicted, by skill, terrain
//! under the field and size (docs/method.md). It shows what choosing costs apart from predicting.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use vocaloco_core::{
    heightfield::Field,
    runtime::{CallFault, Predict},
    selector::Prediction,
};

use crate::terrain::TerrainKind;

/// What lies under the predictors' field at present: a pilot says it, the oracle looks it up.
#[derive(Debug, Default)]
pub struct Ground(AtomicU8);

impl Ground {
    /// Says it.
    pub fn set(&self, terrain: TerrainKind) {
        self.0.store(terrain as u8, Ordering::Relaxed);
    }

    fn index(&self) -> usize {
        usize::from(self.0.load(Ordering::Relaxed))
    }
}

/// What a skill was worth on one terrain of one size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Worth {
    /// Share of rollouts that reached the horizon.
    pub viability: f64,
    /// Their mean cost of transport; none when none did.
    pub cot: Option<f64>,
}

/// Stands in for the two networks of one skill.
#[derive(Clone, Debug)]
pub struct Oracle {
    ground: Arc<Ground>,
    /// By terrain, in the order of [`TerrainKind::ALL`].
    predictions: [Prediction; TerrainKind::ALL.len()],
}

/// In place of a cost of transport that nothing was collected of; the skill is not viable there.
const NEVER_REACHED: f32 = 1e3;

impl Oracle {
    /// An oracle of the terrains given; on every other the skill is taken for not viable.
    pub fn new(ground: Arc<Ground>, worth: &[(TerrainKind, Worth)]) -> Self {
        let mut predictions = [Prediction::of(0.0, NEVER_REACHED); TerrainKind::ALL.len()];
        for (terrain, worth) in worth {
            let cot = worth.cot.map_or(NEVER_REACHED, |cot| cot as f32);
            predictions[*terrain as usize] = Prediction::of(worth.viability as f32, cot);
        }
        Self { ground, predictions }
    }
}

impl Predict for Oracle {
    fn predict(&mut self, _: &Field) -> (Prediction, Option<CallFault>) {
        (self.predictions[self.ground.index()], None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_core::heightfield::CELLS;

    #[test]
    fn the_oracle_says_what_was_collected_on_the_ground_under_the_field() {
        let ground = Arc::new(Ground::default());
        let up = Worth { viability: 0.75, cot: Some(0.5) };
        let down = Worth { viability: 0.0, cot: None };
        let mut oracle =
            Oracle::new(Arc::clone(&ground), &[(TerrainKind::StairsUp, up), (TerrainKind::StairsDown, down)]);
        let field = Field::from_slice(&[0.0; CELLS]).unwrap();
        let mut on = |terrain| {
            ground.set(terrain);
            oracle.predict(&field).0
        };
        assert_eq!(on(TerrainKind::StairsUp), Prediction::of(0.75, 0.5));
        assert!(on(TerrainKind::StairsDown).is_usable(), "no cost is still a usable number");
        assert_eq!(on(TerrainKind::Gap).viability, 0.0, "nothing was collected there");
    }
}
