//! The record of one tick: what was seen, what each skill was worth, what was chosen and why.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::decision_log::SetupSkill;
use crate::heightfield::Field;
use crate::selector::{Choice, Prediction, Reason};
use crate::switch::{Active, SwitchFilter};

/// Name of the core's stand in records.
pub const STAND: &str = "stand";
/// Name of the selector's stop in records.
pub const STOP: &str = "stop";

/// One skill in one tick.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SkillVerdict {
    /// Its name.
    pub name: String,
    /// Predicted viability; none where the prediction failed or was not made.
    pub viability: Option<f32>,
    /// Predicted cost of transport; none likewise.
    pub cot: Option<f32>,
    /// How unlike the terrain that its predictors know this one is, up to 1 known; none where they do
    /// not say what they know.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strangeness: Option<f32>,
    /// Whether it may be chosen.
    pub viable: bool,
    /// Why, or why not.
    pub reason: Reason,
}

impl SkillVerdict {
    /// The prediction as the selector saw it.
    pub fn prediction(&self) -> Prediction {
        let [viability, cot] = [self.viability, self.cot].map(|value| value.unwrap_or(f32::NAN));
        Prediction { viability, cot, strangeness: self.strangeness }
    }
}

/// What overruled the window this tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Forced {
    /// The command asks for no motion.
    ZeroCommand,
    /// The terrain is unknown, too old, or too little of it is known.
    Terrain,
    /// The measurement cannot be used.
    Observation,
    /// The base is tilted further than skills may drive at.
    Fallen,
    /// The active skill was taken out of service.
    Fault,
    /// A call for the active skill took longer than its budget: the stand drives for this tick.
    Overrun,
    /// The active skill is on its way to its target: stops and switches wait.
    Committed,
}

impl Forced {
    /// Whether it is a stop, which waits for no window.
    pub const fn is_stop(self) -> bool {
        matches!(self, Self::Terrain | Self::Observation | Self::Fallen | Self::Fault)
    }
}

/// Wall-clock time spent, µs; only measured where a clock is given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Timings {
    /// All predictions.
    pub predict_us: f64,
    /// The active plugin, its reset included, or the stand.
    pub act_us: f64,
    /// The whole tick.
    pub total_us: f64,
}

/// The record of a tick.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Decision {
    /// Time of the observation, s.
    pub t_s: f64,
    /// Ticks since the start of the loop, from 0.
    pub tick: u64,
    /// Commanded velocity: forward m/s, left m/s, yaw rate rad/s.
    pub command: [f32; 3],
    /// FNV-1a of the prepared field's bytes, hex; empty when there is none.
    pub heightfield_hash: String,
    /// The field as the predictors saw it, row-major, m; none when the terrain was not usable.
    #[serde(serialize_with = "write_field", deserialize_with = "read_field")]
    pub field: Option<Field>,
    /// Every skill, in the deployment's order.
    pub skills: Vec<SkillVerdict>,
    /// The selector's choice: a skill, or `stop`.
    pub choice: String,
    /// Who drives the joints: a skill, or `stand`.
    pub active: String,
    /// Whether it stands because of a stop that no skill has ended yet.
    pub stopped: bool,
    /// What overruled the window, if anything.
    pub forced: Option<Forced>,
    /// Whether the active skill was bound to its target, so that stops and switches waited, whatever overruled
    /// it besides.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub committed: bool,
    /// The choice in words.
    pub reason: String,
    /// What happened besides: faults, skills taken out of service.
    pub events: Vec<String>,
    /// Time spent, where it is measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timings: Option<Timings>,
    /// The skills from this tick on, where they have just changed; `skills` is theirs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roster: Option<Vec<RosterSkill>>,
}

/// A skill of a deployment whose skills have just changed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RosterSkill {
    /// Whether it takes part from now on; otherwise it goes on as it was.
    pub is_new: bool,
    /// What the selector knows of it.
    #[serde(flatten)]
    pub setup: SetupSkill,
}

impl Decision {
    /// Number of viable skills.
    pub fn viable_skills(&self) -> usize {
        self.skills.iter().filter(|skill| skill.viable).count()
    }

    /// Whether another viable skill costs less.
    fn is_undercut(&self, chosen: &SkillVerdict) -> bool {
        self.skills.iter().any(|other| other.viable && other.cot < chosen.cot)
    }

    /// The choice in words, into `reason`.
    pub(crate) fn explain(&mut self, choice: Choice, active: Active, filter: &SwitchFilter) {
        use std::fmt::Write;
        let viable = self.viable_skills();
        let mut words = std::mem::take(&mut self.reason);
        words.clear();
        if let Some(forced) = self.forced {
            words.push_str(match forced {
                Forced::ZeroCommand => "zero command: it stands",
                Forced::Terrain => "terrain unusable: stop",
                Forced::Observation => "measurement unusable: stop",
                Forced::Fallen => "base tilted too far: stop",
                Forced::Fault => "active skill out of service: stop",
                Forced::Overrun => "active skill over its budget: it stands for this tick",
                Forced::Committed => "active skill is committed: it goes on to its target",
            });
            self.reason = words;
            return;
        }
        // Writing to a `String` does not fail.
        let _ = match choice {
            Choice::Stop => write!(words, "no skill is viable"),
            Choice::Skill(_) if viable == 1 => write!(words, "the only viable skill"),
            Choice::Skill(chosen) if self.skills.get(chosen).is_some_and(|one| self.is_undercut(one)) => {
                write!(words, "won before; none of {viable} viable skills is cheaper by its margin")
            }
            Choice::Skill(_) => write!(words, "lowest cost of transport of {viable} viable skills"),
        };
        let waits = match (choice, active) {
            (Choice::Stop, Active::Stand) => false,
            (Choice::Stop, Active::Skill(_)) => true,
            (Choice::Skill(chosen), active) => active != Active::Skill(chosen),
        };
        let (run, wanted) = filter.agreement();
        let steady = filter.steady().filter(|(skill, _)| run < wanted && active == Active::Skill(*skill));
        if let Some((_, ticks)) = steady {
            let takes_over =
                if waits { format_args!("{} takes over, ", self.active) } else { format_args!("") };
            let _ =
                write!(words, "; {takes_over}viable for {ticks} ticks in a row while the winners alternated");
        } else if waits {
            let _ = write!(words, "; {} of {wanted} ticks in a row, {} goes on", run, self.active);
        }
        self.reason = words;
    }
}

/// FNV-1a over the field's bytes, as 16 hex digits.
pub(crate) fn hash_into(field: &Field, text: &mut String) {
    use std::fmt::Write;
    let hash = field
        .as_slice()
        .iter()
        .flat_map(|cell| cell.to_bits().to_le_bytes())
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
    text.clear();
    let _ = write!(text, "{hash:016x}");
}

#[allow(clippy::ref_option, reason = "serde calls it with a reference to the field")]
fn write_field<S: Serializer>(field: &Option<Field>, serializer: S) -> Result<S::Ok, S::Error> {
    field.as_ref().map(|field| field.as_slice().as_slice()).serialize(serializer)
}

fn read_field<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Field>, D::Error> {
    let cells: Option<Vec<f32>> = Option::deserialize(deserializer)?;
    cells
        .map(|cells| {
            Field::from_slice(&cells)
                .ok_or_else(|| serde::de::Error::custom("field: 341 finite heights wanted"))
        })
        .transpose()
}
