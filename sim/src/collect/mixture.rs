//! Which terrain a row gets.

use std::{collections::BTreeMap, fmt, str::FromStr};

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::{stream::uniform, terrain::TerrainKind};

/// Weights of the terrains; sizes are drawn evenly over [`TerrainKind::range_m`].
///
/// The default gives flat and uneven ground, stairs up and stairs down about a third each
/// (docs/method.md), and a tenth to walls and gaps. Sizes reach far beyond what any skill can do, so that
/// well over 20 % of rows are beyond each skill's limit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mixture(BTreeMap<TerrainKind, f32>);

impl Default for Mixture {
    fn default() -> Self {
        Self(BTreeMap::from([
            (TerrainKind::Flat, 0.08),
            (TerrainKind::Rough, 0.08),
            (TerrainKind::Slope, 0.07),
            (TerrainKind::Discrete, 0.07),
            (TerrainKind::StairsUp, 0.3),
            (TerrainKind::StairsDown, 0.3),
            (TerrainKind::Wall, 0.05),
            (TerrainKind::Gap, 0.05),
        ]))
    }
}

impl Mixture {
    /// One terrain only.
    pub fn only(kind: TerrainKind) -> Self {
        Self(BTreeMap::from([(kind, 1.0)]))
    }

    /// Draws a kind and a size.
    pub fn draw(&self, rng: &mut ChaCha8Rng) -> (TerrainKind, f32) {
        let total: f32 = self.0.values().sum();
        let mut left = uniform(rng, 0.0, total);
        let difficulty = uniform(rng, 0.0, 1.0);
        let mut drawn = TerrainKind::Flat;
        for (kind, weight) in &self.0 {
            drawn = *kind;
            left -= weight;
            if left < 0.0 {
                break;
            }
        }
        (drawn, drawn.size_m(difficulty))
    }
}

/// As [`Mixture::from_str`] reads it.
impl fmt::Display for Mixture {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts: Vec<String> =
            self.0.iter().map(|(kind, weight)| format!("{}={weight}", kind.id())).collect();
        formatter.write_str(&parts.join(","))
    }
}

/// Terrains and their weights, such as `flat=0.1,stairs_up=0.45`; every weight is over 0 and no
/// terrain stands twice.
impl FromStr for Mixture {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut weights = BTreeMap::new();
        for part in text.split(',') {
            let (id, weight) =
                part.split_once('=').ok_or_else(|| format!("found {part:?}, wanted TERRAIN=WEIGHT"))?;
            let ids = TerrainKind::ALL.map(TerrainKind::id).join(" ");
            let kind =
                TerrainKind::from_id(id).ok_or_else(|| format!("found {id:?}, wanted one of {ids}"))?;
            let weight = weight
                .parse()
                .ok()
                .filter(|weight: &f32| weight.is_finite() && *weight > 0.0)
                .ok_or_else(|| format!("{id}: found {weight:?}, wanted a weight over 0"))?;
            if weights.insert(kind, weight).is_some() {
                return Err(format!("found {id} twice, wanted one weight for it"));
            }
        }
        Ok(Self(weights))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::stream;

    fn drawn(rows: u64) -> Vec<(TerrainKind, f32)> {
        (0..rows).map(|row| Mixture::default().draw(&mut stream(3, "terrain", &[row]))).collect()
    }

    #[test]
    fn terrains_come_in_the_stated_shares() {
        let rows = drawn(20_000);
        for (kind, wanted) in Mixture::default().0 {
            let share = rows.iter().filter(|(drawn, _)| *drawn == kind).count() as f32 / 20_000.0;
            assert!((share - wanted).abs() < 0.012, "{kind}: {share}, {wanted} wanted");
        }
    }

    #[test]
    fn a_fifth_of_the_rows_is_beyond_what_a_stairs_skill_can_do() {
        // The published limits of structured and learned skills: 0.275 m up and down.
        let beyond = |kind: TerrainKind, limit_m: f32| {
            move |(drawn, size_m): &&(TerrainKind, f32)| *drawn == kind && *size_m > limit_m
        };
        let rows = drawn(20_000);
        let count = |kind, limit_m| rows.iter().filter(beyond(kind, limit_m)).count();
        let share = (count(TerrainKind::StairsUp, 0.275)
            + count(TerrainKind::StairsDown, 0.275)
            + count(TerrainKind::Wall, 0.35)
            + count(TerrainKind::Gap, 0.4)) as f32
            / 20_000.0;
        assert!(share > 0.2, "{share}");
    }

    #[test]
    fn sizes_cover_the_whole_range() {
        let sizes: Vec<f32> = drawn(5_000)
            .into_iter()
            .filter(|(kind, _)| *kind == TerrainKind::StairsUp)
            .map(|(_, size_m)| size_m)
            .collect();
        let least = sizes.iter().fold(f32::MAX, |a, b| a.min(*b));
        let greatest = sizes.iter().fold(0.0_f32, |a, b| a.max(*b));
        assert!((0.02..0.03).contains(&least) && (0.44..=0.45).contains(&greatest), "{least} {greatest}");
    }

    #[test]
    fn a_mixture_comes_back_as_it_was_written() {
        let mixture: Mixture = "stairs_up=3,flat=1".parse().unwrap();
        assert_eq!(mixture.to_string(), "flat=1,stairs_up=3");
        let of_flat =
            (0..1000).filter(|row| mixture.draw(&mut stream(3, "terrain", &[*row])).0 == TerrainKind::Flat);
        let share = of_flat.count() as f32 / 1000.0;
        assert!((share - 0.25).abs() < 0.06, "{share}");
        let default = Mixture::default();
        assert_eq!(default.to_string().parse(), Ok(default));
    }

    #[test]
    fn what_is_no_mixture_is_refused_with_what_is_wanted() {
        for (text, wanted) in [
            ("", "TERRAIN=WEIGHT"),
            ("flat", "TERRAIN=WEIGHT"),
            ("lava=1", "stairs_up"),
            ("flat=0", "over 0"),
            ("flat=NaN", "over 0"),
            ("flat=1,flat=2", "twice"),
        ] {
            let error = text.parse::<Mixture>().unwrap_err();
            assert!(error.contains(wanted), "{text}: {error}");
        }
    }
}
