//! What a course leaves behind.

use serde::{Deserialize, Serialize};
use vocaloco_core::decision::Decision;

use crate::{occlusion::Unseen, plant::BasePose, terrain::CourseKind};

/// How a course ended; the first that happens counts (docs/method.md).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The base came within 0.5 m of the target, 0.3 to 0.9 m above the far flat.
    Reached,
    /// The base touched something, or left the map.
    Crashed,
    /// Three times the course's length at 0.6 m/s had gone by, or the robot stood as under `Stopped` but
    /// because of a fault.
    Stuck,
    /// The robot stood for two seconds without a break, or at the end, and not because of a fault.
    Stopped,
}

impl Outcome {
    /// Every outcome, in the order of reports.
    pub const ALL: [Self; 4] = [Self::Reached, Self::Crashed, Self::Stuck, Self::Stopped];

    /// The id used in JSON and tables.
    pub const fn id(self) -> &'static str {
        match self {
            Self::Reached => "reached",
            Self::Crashed => "crashed",
            Self::Stuck => "stuck",
            Self::Stopped => "stopped",
        }
    }
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(self.id())
    }
}

/// The active skill changed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Switch {
    /// When, s from the first tick.
    pub t_s: f64,
    /// The skill that was active, or `stand`.
    pub from: String,
    /// The skill that is active from now on, or `stand`.
    pub to: String,
}

/// One tick, as measured before it was acted on.
#[derive(Clone, Debug)]
pub struct CourseTick {
    /// What was decided; none when one skill drives alone.
    pub decision: Option<Decision>,
    /// The base in the world.
    pub base: BasePose,
    /// By the robot's joint order, rad.
    pub joint_position_rad: Vec<f32>,
    /// By the robot's feet.
    pub foot_contact: Vec<bool>,
}

/// A driven course.
#[derive(Clone, Debug)]
pub struct CourseRun {
    /// Which course.
    pub kind: CourseKind,
    /// Height of a step, m.
    pub size_m: f32,
    /// Number of steps.
    pub steps: usize,
    /// How it ended.
    pub outcome: Outcome,
    /// From the first tick to the end, s.
    pub duration_s: f64,
    /// Along the terrain's heading, m.
    pub distance_m: f64,
    /// Positive joint work over weight and distance, standing included; none below 0.1 m.
    pub cot: Option<f64>,
    /// The same with braking counted negative.
    pub cot_signed: Option<f64>,
    /// Every change of the active skill, the first from `stand` included.
    pub switches: Vec<Switch>,
    /// Whether anything but a foot ever touched something.
    pub nonfoot_contact: bool,
    /// What the cameras did not see and the fill hid; none where the map is whole.
    pub unseen: Option<Unseen>,
    /// Every tick, when the course was recorded.
    pub ticks: Vec<CourseTick>,
}

impl CourseRun {
    /// The skills in the order in which they became active, `stand` left out and none twice in a row.
    pub fn skills(&self) -> Vec<&str> {
        let mut names: Vec<&str> =
            self.switches.iter().map(|switch| switch.to.as_str()).filter(|name| *name != "stand").collect();
        names.dedup();
        names
    }
}
