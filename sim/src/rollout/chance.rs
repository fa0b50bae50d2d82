//! What differs between the rollouts of one pose: drawn per (row's seed, repeat), and switched off
//! one by one for experiments.

use std::collections::BTreeSet;

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::{
    driver::{SensorNoise, TICK_S},
    plant::Variation,
    stream::{stream, uniform},
};

/// Something that is drawn anew for each rollout.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Perturbation {
    /// Noise on what the plugin measures, its terrain patch included.
    Noise,
    /// Friction from 0.5 to 1.25.
    Friction,
    /// Base mass ± 5 kg.
    Mass,
    /// Phase at which the gait starts.
    Phase,
    /// One push of 0.5 m/s, any direction, 0.5 to 2.5 s after the start.
    Push,
    /// Targets reach the drives a tick, 20 ms, late.
    Latency,
    /// Torque of all drives ± 10 %.
    Motor,
}

impl Perturbation {
    /// All of them; the first four are the collection protocol's.
    pub const ALL: [Self; 7] =
        [Self::Noise, Self::Friction, Self::Mass, Self::Phase, Self::Push, Self::Latency, Self::Motor];
    /// How many of [`ALL`](Self::ALL) the protocol draws.
    const IN_PROTOCOL: usize = 4;

    /// The id used on the command line.
    pub const fn id(self) -> &'static str {
        match self {
            Self::Noise => "noise",
            Self::Friction => "friction",
            Self::Mass => "mass",
            Self::Phase => "phase",
            Self::Push => "push",
            Self::Latency => "latency",
            Self::Motor => "motor",
        }
    }
}

/// Which perturbations are on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Perturbations(BTreeSet<Perturbation>);

impl Perturbations {
    /// What the collection protocol draws (docs/method.md): noise, friction, mass and phase.
    pub fn protocol() -> Self {
        Self(Perturbation::ALL.into_iter().take(Perturbation::IN_PROTOCOL).collect())
    }

    /// All of them: the protocol, and pushes, latency and motor strength.
    pub fn all() -> Self {
        Self(Perturbation::ALL.into())
    }

    /// `all`, `protocol`, `none`, or ids separated by commas; `None` for anything else.
    pub fn parse(text: &str) -> Option<Self> {
        match text {
            "all" => Some(Self::all()),
            "protocol" => Some(Self::protocol()),
            "none" => Some(Self(BTreeSet::new())),
            list => list
                .split(',')
                .map(|id| Perturbation::ALL.into_iter().find(|one| one.id() == id))
                .collect::<Option<_>>()
                .map(Self),
        }
    }

    /// Whether one of them is on.
    pub fn contains(&self, perturbation: Perturbation) -> bool {
        self.0.contains(&perturbation)
    }
}

impl std::fmt::Display for Perturbations {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.0.is_empty() {
            return formatter.write_str("none");
        }
        if *self == Self::all() {
            return formatter.write_str("all");
        }
        if *self == Self::protocol() {
            return formatter.write_str("protocol");
        }
        let ids: Vec<&str> = self.0.iter().map(|one| one.id()).collect();
        formatter.write_str(&ids.join(","))
    }
}

/// A velocity that the base suddenly gains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Push {
    /// Tick at whose start it comes.
    pub tick: usize,
    /// m/s, in the world.
    pub velocity_in_world: [f32; 3],
}

/// Speed that a push adds, m/s.
const PUSH_M_PER_S: f32 = 0.5;
/// When it comes, s after the start.
const PUSH_S: [f32; 2] = [0.5, 2.5];

/// What was drawn for one rollout.
#[derive(Clone, Debug, PartialEq)]
pub struct Chance {
    /// Friction, mass and motor strength.
    pub variation: Variation,
    /// Where in its cycle a gait starts, 0 to 1; `None` leaves it to the plugin.
    pub initial_phase: Option<f32>,
    /// Noise on what the plugin measures.
    pub noise: SensorNoise,
    /// A push on the way.
    pub push: Option<Push>,
    /// Ticks by which targets reach the drives late.
    pub latency_ticks: usize,
    row_seed: u64,
    repeat: u64,
}

impl Chance {
    /// The draw of a repeat of a row; `noise` applies if noise is on. What is switched off leaves the
    /// other draws as they are.
    pub fn draw(row_seed: u64, repeat: u64, on: &Perturbations, noise: SensorNoise) -> Self {
        let mut rng = stream(row_seed, "chance", &[repeat]);
        let friction = uniform(&mut rng, 0.5, 1.25);
        let base_mass_offset_kg = uniform(&mut rng, -5.0, 5.0);
        let phase = uniform(&mut rng, 0.0, 1.0);
        let push = Push {
            tick: (f64::from(uniform(&mut rng, PUSH_S[0], PUSH_S[1])) / TICK_S) as usize,
            velocity_in_world: {
                let direction = f64::from(uniform(&mut rng, 0.0, std::f32::consts::TAU));
                let (sin, cos) = (libm::sin(direction) as f32, libm::cos(direction) as f32);
                [PUSH_M_PER_S * cos, PUSH_M_PER_S * sin, 0.0]
            },
        };
        let motor_strength = uniform(&mut rng, 0.9, 1.1);
        let mut variation = Variation::default();
        if on.contains(Perturbation::Friction) {
            variation.friction = friction;
        }
        if on.contains(Perturbation::Mass) {
            variation.base_mass_offset_kg = base_mass_offset_kg;
        }
        if on.contains(Perturbation::Motor) {
            variation.motor_strength = motor_strength;
        }
        Self {
            variation,
            initial_phase: on.contains(Perturbation::Phase).then_some(phase),
            noise: if on.contains(Perturbation::Noise) { noise } else { SensorNoise::NONE },
            push: on.contains(Perturbation::Push).then_some(push),
            latency_ticks: usize::from(on.contains(Perturbation::Latency)),
            row_seed,
            repeat,
        }
    }

    /// The stream that feeds the noise.
    pub(crate) fn noise_stream(&self) -> ChaCha8Rng {
        stream(self.row_seed, "sensor_noise", &[self.repeat])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn draw(row: u64, repeat: u64, on: &str) -> Chance {
        Chance::draw(row, repeat, &Perturbations::parse(on).unwrap(), SensorNoise::default())
    }

    #[test]
    fn rows_and_repeats_draw_differently_and_repeat_exactly() {
        assert_eq!(draw(3, 1, "all"), draw(3, 1, "all"));
        assert_ne!(draw(3, 1, "all").variation, draw(3, 2, "all").variation);
        assert_ne!(draw(3, 1, "all").variation, draw(4, 1, "all").variation);
    }

    #[test]
    fn draws_stay_inside_their_ranges() {
        for row in 0..500 {
            let chance = draw(row, 0, "all");
            assert!((0.5..=1.25).contains(&chance.variation.friction));
            assert!(chance.variation.base_mass_offset_kg.abs() <= 5.0);
            assert!((0.0..=1.0).contains(&chance.initial_phase.unwrap()));
            assert!((0.9..=1.1).contains(&chance.variation.motor_strength));
            let push = chance.push.unwrap();
            assert!((25..=125).contains(&push.tick) && push.velocity_in_world[2] == 0.0);
            let [x, y, _] = push.velocity_in_world;
            assert!((x.hypot(y) - 0.5).abs() < 1e-5);
        }
    }

    #[test]
    fn what_is_switched_off_leaves_the_rest_as_it_was() {
        let (all, one) = (draw(3, 1, "all"), draw(3, 1, "mass"));
        assert_eq!(one.variation.base_mass_offset_kg, all.variation.base_mass_offset_kg);
        assert_eq!(one.variation.friction, Variation::default().friction);
        assert_eq!((one.initial_phase, one.noise), (None, SensorNoise::NONE));
        assert_eq!((one.push, one.latency_ticks), (None, 0));
    }

    #[test]
    fn the_protocol_neither_pushes_nor_delays_and_draws_what_all_draws() {
        let (all, protocol) = (draw(3, 1, "all"), draw(3, 1, "protocol"));
        assert_eq!(protocol.variation.friction, all.variation.friction);
        assert_eq!((protocol.push, protocol.latency_ticks), (None, 0));
        assert_eq!(protocol.variation.motor_strength, 1.0);
        assert_eq!(all.latency_ticks, 1);
    }

    #[test]
    fn lists_are_read_and_written_the_same() {
        for text in ["all", "protocol", "none", "noise,mass", "friction,push"] {
            assert_eq!(Perturbations::parse(text).unwrap().to_string(), text);
        }
        assert_eq!(Perturbations::parse("mass,wind"), None);
    }
}
