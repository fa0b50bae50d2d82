//! The TOML file beside the MJCF: what MJCF cannot say.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::{Drive, ReadFile, RobotError};

/// How the robot stands. The stand position of each joint is in the robot's description.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StandParameters {
    /// Stiffness of every joint, N·m/rad.
    pub stiffness_nm_per_rad: f32,
    /// Damping of every joint, N·m·s/rad.
    pub damping_nms_per_rad: f32,
    /// A foot in the air is lowered at no more than this, m/s.
    pub lowering_speed_m_per_s: f32,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    schema: u32,
    base: String,
    base_shapes: Vec<String>,
    feet: Vec<String>,
    drive: RawDrive,
    stand: RawStand,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawDrive {
    effort_nm: f32,
    saturation_nm: f32,
    velocity_limit_rad_per_s: f32,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawStand {
    stiffness_nm_per_rad: f32,
    damping_nms_per_rad: f32,
    lowering_speed_m_per_s: f32,
    position_rad: BTreeMap<String, f64>,
}

/// The checked file.
pub(super) struct File {
    pub(super) path: PathBuf,
    pub(super) sha256: String,
    pub(super) base: String,
    pub(super) base_shapes: Vec<String>,
    pub(super) feet: Vec<String>,
    pub(super) drive: Drive,
    pub(super) stand: StandParameters,
    pub(super) stand_position_rad: BTreeMap<String, f64>,
}

/// Most feet, and most shapes of the base.
const MAX_NAMES: usize = 100;

/// The bytes of a file as text, and their SHA-256 in lowercase hex.
pub(super) fn read_text(path: &Path, read: ReadFile<'_>) -> Result<(String, String), RobotError> {
    let bytes = read(path)?;
    let sha256 = Sha256::digest(&bytes).iter().fold(String::new(), |text, byte| format!("{text}{byte:02x}"));
    let text = String::from_utf8(bytes).map_err(|error| RobotError::malformed(path, &error))?;
    Ok((text, sha256))
}

impl File {
    pub(super) fn read(path: &Path, read: ReadFile<'_>) -> Result<Self, RobotError> {
        let (text, sha256) = read_text(path, read)?;
        let raw: Raw = toml::from_str(&text).map_err(|error| RobotError::malformed(path, &error))?;
        if raw.schema != 1 {
            return Err(RobotError::field(path, "schema", raw.schema.to_string(), "1"));
        }
        for (field, value) in [
            ("drive.effort_nm", raw.drive.effort_nm),
            ("drive.saturation_nm", raw.drive.saturation_nm),
            ("drive.velocity_limit_rad_per_s", raw.drive.velocity_limit_rad_per_s),
            ("stand.stiffness_nm_per_rad", raw.stand.stiffness_nm_per_rad),
            ("stand.damping_nms_per_rad", raw.stand.damping_nms_per_rad),
            ("stand.lowering_speed_m_per_s", raw.stand.lowering_speed_m_per_s),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(RobotError::field(path, field, value.to_string(), "a positive number"));
            }
        }
        for (field, names) in [("feet", &raw.feet), ("base_shapes", &raw.base_shapes)] {
            if names.len() > MAX_NAMES {
                let found = format!("{} names", names.len());
                return Err(RobotError::field(path, field, found, format!("at most {MAX_NAMES}")));
            }
            let twice = names.iter().enumerate().find(|(index, name)| names[..*index].contains(name));
            if let Some((_, name)) = twice {
                return Err(RobotError::field(path, field, format!("{name:?} twice"), "each once"));
            }
        }
        Ok(Self {
            path: path.to_owned(),
            sha256,
            base: raw.base,
            base_shapes: raw.base_shapes,
            feet: raw.feet,
            drive: Drive {
                effort_nm: raw.drive.effort_nm,
                saturation_nm: raw.drive.saturation_nm,
                velocity_limit_rad_per_s: raw.drive.velocity_limit_rad_per_s,
            },
            stand: StandParameters {
                stiffness_nm_per_rad: raw.stand.stiffness_nm_per_rad,
                damping_nms_per_rad: raw.stand.damping_nms_per_rad,
                lowering_speed_m_per_s: raw.stand.lowering_speed_m_per_s,
            },
            stand_position_rad: raw.stand.position_rad,
        })
    }
}
