//! What a plant can be told before it runs.

use serde::{Deserialize, Serialize};

/// Which of the two plants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlantKind {
    /// rapier3d's multibody, which every reported number uses.
    Reference,
    /// The plant's own reduced-coordinate dynamics on parry's geometry, for searching and training;
    /// docs/plant.md certifies it against the reference.
    Fast,
}

impl PlantKind {
    /// The id used on the command line and in data sets.
    pub const fn id(self) -> &'static str {
        match self {
            Self::Reference => "reference",
            Self::Fast => "fast",
        }
    }

    /// The engine's settings behind the plant; docs/plant.md holds the measurements they rest on.
    pub const fn engine(self) -> Engine {
        match self {
            Self::Reference => Engine { joints: JointKind::Multibody, iterations: 2 },
            Self::Fast => Engine { joints: JointKind::Reduced, iterations: 2 },
        }
    }
}

/// How the engine joins links.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Reduced coordinates in rapier: joints cannot stretch, and carry rotor inertia.
    Multibody,
    /// Free bodies held together by impulses: joints stretch under load, and have no rotor inertia.
    Impulse,
    /// As [`Multibody`](Self::Multibody), but by the plant's own dynamics, which keep a tree's zeros.
    Reduced,
}

/// How a step is solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Engine {
    /// How the links are joined.
    pub joints: JointKind,
    /// Solver iterations, each a substep of its own.
    pub iterations: usize,
}

/// What differs between rollouts from one pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Variation {
    /// Coulomb friction between robot and ground.
    pub friction: f32,
    /// Mass added at the base's centre of mass, its inertia growing alike, kg.
    pub base_mass_offset_kg: f32,
    /// Factor on the torque that the drives give.
    pub motor_strength: f32,
}

impl Default for Variation {
    fn default() -> Self {
        Self { friction: 0.8, base_mass_offset_kg: 0.0, motor_strength: 1.0 }
    }
}
