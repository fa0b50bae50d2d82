//! `manifests/deployments/<name>.toml`: which skills may run on which robot.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::deadlines::{Deadlines, RawDeadlines};
use super::reader::Source;
use super::{Finding, is_snake_case};
use crate::lock::PublicKey;
use crate::runtime::Switching;

/// A checked deployment.
#[derive(Clone, Debug, PartialEq)]
pub struct Deployment {
    /// The file it was read from.
    pub file: PathBuf,
    /// Stem of that file.
    pub name: String,
    /// Name of the robot.
    pub robot: String,
    /// Skills by name; of equal cost the earlier one wins.
    pub skills: Vec<String>,
    /// Rate of decisions and of `act`, Hz.
    pub rate_hz: f64,
    /// Ticks that must agree before the robot switches.
    pub switch_window: usize,
    /// Ticks that must agree before it stops for want of a viable skill.
    pub stop_window: usize,
    /// Ticks that one skill must win before a stop is left.
    pub resume_window: usize,
    /// When terrain counts as unknown.
    pub heightfield: HeightfieldLimits,
    /// When finite measurements are not driven on.
    pub measurement: MeasurementLimits,
    /// How long calls may take in real time.
    pub deadlines: Deadlines,
    /// How targets go over from one skill to the next.
    pub switching: Switching,
    /// Thresholds of viability in place of the skills' own.
    pub viability_thresholds: BTreeMap<String, f32>,
    /// Thresholds of viability for a skill while it drives, where they are not those to begin.
    pub hold_thresholds: BTreeMap<String, f32>,
    /// Keys of which one must have signed the lock; none demand no signature.
    pub trusted_keys: Vec<PublicKey>,
}

/// When terrain counts as unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeightfieldLimits {
    /// Oldest terrain that is still looked at, s.
    pub max_age_s: f64,
    /// Longest time for which heights may stay the same, bit for bit, while a skill drives, s; none is not looked at.
    pub frozen_s: Option<f64>,
}

impl HeightfieldLimits {
    /// Those of a deployment that says nothing.
    pub const DEFAULT: Self = Self { max_age_s: 0.2, frozen_s: None };
}

/// When finite measurements are not driven on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasurementLimits {
    /// Largest angle between the base's z axis and the vertical at which skills may drive, rad.
    pub max_tilt_rad: f64,
    /// Longest time for which joints and base may stay the same, bit for bit, while a skill drives, s; none is not
    /// looked at.
    pub frozen_s: Option<f64>,
}

impl MeasurementLimits {
    /// Those of a deployment that says nothing.
    pub const DEFAULT: Self = Self { max_tilt_rad: 1.2, frozen_s: None };
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    #[serde(rename = "schema")]
    _schema: u32,
    robot: String,
    skills: Vec<String>,
    #[serde(default = "fifty")]
    rate_hz: f64,
    #[serde(default = "ten")]
    switch_window: usize,
    stop_window: Option<usize>,
    #[serde(default = "twenty_five")]
    resume_window: usize,
    #[serde(default)]
    heightfield: RawHeightfield,
    #[serde(default)]
    measurement: RawMeasurement,
    #[serde(default)]
    deadlines: RawDeadlines,
    #[serde(default)]
    switching: RawSwitching,
    #[serde(default)]
    viability_thresholds: BTreeMap<String, f64>,
    #[serde(default)]
    hold_thresholds: BTreeMap<String, f64>,
    #[serde(default)]
    trusted_keys: Vec<String>,
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct RawSwitching {
    ramp_s: f64,
    mixing: bool,
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct RawHeightfield {
    max_age_s: Option<f64>,
    frozen_s: Option<f64>,
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct RawMeasurement {
    max_tilt_rad: Option<f64>,
    frozen_s: Option<f64>,
}

/// Most skills of a deployment.
const MAX_SKILLS: usize = 256;

fn fifty() -> f64 {
    50.0
}
fn ten() -> usize {
    10
}
fn twenty_five() -> usize {
    25
}

impl Deployment {
    /// Reads and checks one deployment; whether its skills are sound is the registry's business.
    ///
    /// # Errors
    /// The first thing that is not as the schema wants it.
    pub fn read(path: &Path) -> Result<Self, Finding> {
        Self::check(path, &Source::read(path)?)
    }

    /// Checks the text of the manifest `path`, which is only named in findings.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn parse(path: &Path, text: String) -> Result<Self, Finding> {
        Self::check(path, &Source::new(path, text))
    }

    fn check(path: &Path, source: &Source<'_>) -> Result<Self, Finding> {
        let raw: Raw = source.parse()?;
        if !is_snake_case(&raw.robot) {
            let found = format!("{:?}", raw.robot);
            return Err(source.finding("robot", found, "a robot's name in snake_case"));
        }
        if raw.skills.is_empty() {
            return Err(source.finding("skills", "none", "at least one skill"));
        }
        if raw.skills.len() > MAX_SKILLS {
            let wanted = format!("at most {MAX_SKILLS} skills");
            return Err(source.finding("skills", format!("{} skills", raw.skills.len()), &wanted));
        }
        for (index, skill) in raw.skills.iter().enumerate() {
            if !is_snake_case(skill) || raw.skills[..index].contains(skill) {
                let field = format!("skills[{index}]");
                let wanted = "each skill once, by its name in snake_case";
                return Err(source.finding(&field, format!("{skill:?}"), wanted));
            }
        }
        let trusted_keys = raw.trusted_keys.iter().enumerate().map(|(index, text)| {
            let wanted = "the 64 hex digits of a public key (`vocaloco skills key`)";
            let refuse = |why| source.finding(&format!("trusted_keys[{index}]"), why, wanted);
            text.parse::<PublicKey>().map_err(refuse)
        });
        let trusted_keys = trusted_keys.collect::<Result<Vec<_>, _>>()?;
        let thresholds = |table: &str, raw_table: &BTreeMap<String, f64>| {
            let one = |(skill, threshold): (&String, &f64)| {
                let field = format!("{table}.{skill}");
                if !raw.skills.contains(skill) {
                    return Err(source.finding(&field, format!("{skill:?}"), "a skill of this deployment"));
                }
                Ok((skill.clone(), source.inside(&field, *threshold, 0.0..=1.0)? as f32))
            };
            raw_table.iter().map(one).collect::<Result<BTreeMap<_, _>, _>>()
        };
        let viability_thresholds = thresholds("viability_thresholds", &raw.viability_thresholds)?;
        let hold_thresholds = thresholds("hold_thresholds", &raw.hold_thresholds)?;
        let window = |field: &str, ticks: usize| {
            if (1..=1000).contains(&ticks) {
                Ok(ticks)
            } else {
                Err(source.finding(field, ticks, "1 to 1000 ticks"))
            }
        };
        let frozen_s = |field: &str, limit_s: Option<f64>| {
            limit_s.map(|limit_s| source.inside(field, limit_s, 0.001..=60.0)).transpose()
        };
        let rate_hz = source.inside("rate_hz", raw.rate_hz, 1.0..=1000.0)?;
        Ok(Self {
            file: path.to_owned(),
            name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            rate_hz,
            deadlines: Deadlines::checked(
                source,
                &raw.deadlines,
                rate_hz,
                raw.skills.len(),
                raw.switching.mixing,
            )?,
            switch_window: window("switch_window", raw.switch_window)?,
            stop_window: window("stop_window", raw.stop_window.unwrap_or(raw.switch_window))?,
            resume_window: window("resume_window", raw.resume_window)?,
            heightfield: HeightfieldLimits {
                max_age_s: source.inside(
                    "heightfield.max_age_s",
                    raw.heightfield.max_age_s.unwrap_or(HeightfieldLimits::DEFAULT.max_age_s),
                    0.001..=60.0,
                )?,
                frozen_s: frozen_s("heightfield.frozen_s", raw.heightfield.frozen_s)?,
            },
            measurement: MeasurementLimits {
                max_tilt_rad: source.inside(
                    "measurement.max_tilt_rad",
                    raw.measurement.max_tilt_rad.unwrap_or(MeasurementLimits::DEFAULT.max_tilt_rad),
                    0.1..=std::f64::consts::PI,
                )?,
                frozen_s: frozen_s("measurement.frozen_s", raw.measurement.frozen_s)?,
            },
            switching: Switching {
                ramp_s: source.inside("switching.ramp_s", raw.switching.ramp_s, 0.0..=1.0)?,
                mixing: raw.switching.mixing,
            },
            viability_thresholds,
            hold_thresholds,
            trusted_keys,
            robot: raw.robot,
            skills: raw.skills,
        })
    }
}
