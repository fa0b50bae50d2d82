//! What host and child say to each other before the first call, in protobuf: exact for every number.

use std::ffi::OsString;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};

use abi_stable::std_types::{RNone, ROption, RSome};
use vocaloco_plugin_api as api;

/// What the child is to load and make.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Start {
    /// The library's file.
    #[prost(bytes = "vec", tag = "1")]
    pub(super) library: Vec<u8>,
    /// SHA-256 of the bytes that the host has seen there.
    #[prost(bytes = "vec", tag = "2")]
    pub(super) sha256: Vec<u8>,
    /// An instance; none when the library is only to describe itself.
    #[prost(message, optional, tag = "3")]
    pub(super) create: Option<Create>,
    /// Instead of a library: a skill that is only to be loaded, whole.
    #[prost(message, optional, tag = "4")]
    pub(super) trial: Option<Trial>,
}

/// A skill, where it lies.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Trial {
    #[prost(bytes = "vec", tag = "1")]
    pub(super) root: Vec<u8>,
    #[prost(bytes = "vec", repeated, tag = "2")]
    pub(super) plugin_path: Vec<Vec<u8>>,
    #[prost(string, tag = "3")]
    pub(super) skill: String,
    /// The deployment's name and the text of its lock, as the host has admitted it: only what that has is taken.
    #[prost(message, optional, tag = "4")]
    pub(super) lock: Option<Locked>,
    #[prost(message, required, tag = "5")]
    pub(super) robot: Robot,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Locked {
    #[prost(string, tag = "1")]
    pub(super) deployment: String,
    #[prost(string, tag = "2")]
    pub(super) text: String,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Create {
    #[prost(string, tag = "1")]
    pub(super) parameters: String,
    #[prost(message, required, tag = "2")]
    pub(super) robot: Robot,
    #[prost(message, optional, tag = "3")]
    pub(super) policy: Option<Policy>,
}

/// A policy network's file, and the SHA-256 of what the host has read there, hex.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Policy {
    #[prost(bytes = "vec", tag = "1")]
    pub(super) file: Vec<u8>,
    #[prost(string, tag = "2")]
    pub(super) sha256: String,
}

/// What came of it.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Started {
    #[prost(message, optional, tag = "1")]
    pub(super) refused: Option<Refused>,
    #[prost(message, optional, tag = "2")]
    pub(super) description: Option<Description>,
    /// Of the instance, where one was made.
    #[prost(message, optional, tag = "3")]
    pub(super) needs: Option<Needs>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Refused {
    /// Which of the kinds of `PluginError`, in their order.
    #[prost(uint32, tag = "1")]
    pub(super) kind: u32,
    #[prost(string, tag = "2")]
    pub(super) field: String,
    #[prost(string, tag = "3")]
    pub(super) found: String,
    #[prost(string, tag = "4")]
    pub(super) wanted: String,
    /// The file at fault: the library, or the policy network that goes with it.
    #[prost(bytes = "vec", tag = "5")]
    pub(super) file: Vec<u8>,
}

/// A path as the system has it, which need not be text.
pub(super) fn bytes_of(path: &Path) -> Vec<u8> {
    path.as_os_str().as_bytes().to_vec()
}

/// What [`bytes_of`] was made of.
pub(super) fn path_of(bytes: Vec<u8>) -> PathBuf {
    OsString::from_vec(bytes).into()
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Needs {
    #[prost(bool, tag = "1")]
    policy: bool,
    /// Behind, ahead, half-width, resolution, m; empty when no terrain is needed.
    #[prost(double, repeated, tag = "2")]
    terrain: Vec<f64>,
    #[prost(bool, tag = "3")]
    foot_contacts: bool,
    #[prost(bool, tag = "4")]
    joint_torques: bool,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Parameter {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(string, tag = "2")]
    unit: String,
    /// Default, least, greatest.
    #[prost(double, repeated, tag = "3")]
    values: Vec<f64>,
    #[prost(bool, tag = "4")]
    is_log: bool,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Description {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(string, tag = "2")]
    version: String,
    #[prost(string, tag = "3")]
    summary: String,
    #[prost(string, repeated, tag = "4")]
    joints: Vec<String>,
    #[prost(double, tag = "5")]
    rate_hz: f64,
    #[prost(bool, tag = "6")]
    is_position_target: bool,
    /// Least and greatest, m/s.
    #[prost(double, repeated, tag = "7")]
    forward_m_per_s: Vec<f64>,
    #[prost(message, required, tag = "8")]
    needs: Needs,
    #[prost(message, repeated, tag = "9")]
    parameters: Vec<Parameter>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Joint {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(int32, tag = "2")]
    parent: i32,
    /// Origin (3), axis (3), lower, upper, effort, velocity limit, stand, mass, centre of mass (3).
    #[prost(double, repeated, tag = "3")]
    values: Vec<f64>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Foot {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(uint32, tag = "2")]
    joint: u32,
    /// Centre (3), radius.
    #[prost(double, repeated, tag = "3")]
    values: Vec<f64>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Robot {
    #[prost(string, tag = "1")]
    name: String,
    /// Mass, mass of the base, height in the stand.
    #[prost(double, repeated, tag = "2")]
    values: Vec<f64>,
    #[prost(message, repeated, tag = "3")]
    joints: Vec<Joint>,
    #[prost(message, repeated, tag = "4")]
    feet: Vec<Foot>,
}

impl Needs {
    pub(super) fn of(needs: &api::Needs) -> Self {
        let patch = |patch: &api::TerrainPatch| {
            vec![patch.back_m, patch.front_m, patch.half_width_m, patch.resolution_m]
        };
        Self {
            policy: needs.policy,
            terrain: needs.terrain.as_ref().map_or_else(Vec::new, patch),
            foot_contacts: needs.foot_contacts,
            joint_torques: needs.joint_torques,
        }
    }

    /// None when the numbers are not as many as they must be.
    pub(super) fn into_api(self) -> Option<api::Needs> {
        let terrain: ROption<api::TerrainPatch> = match self.terrain.as_slice() {
            [] => RNone,
            &[back_m, front_m, half_width_m, resolution_m] => {
                RSome(api::TerrainPatch { back_m, front_m, half_width_m, resolution_m })
            }
            _ => return None,
        };
        Some(api::Needs {
            policy: self.policy,
            terrain,
            foot_contacts: self.foot_contacts,
            joint_torques: self.joint_torques,
        })
    }
}

impl Description {
    pub(super) fn of(it: &api::Description) -> Self {
        let parameter = |it: &api::Parameter| Parameter {
            name: it.name.to_string(),
            unit: it.unit.to_string(),
            values: vec![it.default, it.range.min, it.range.max],
            is_log: it.scale == api::Scale::Log,
        };
        Self {
            name: it.name.to_string(),
            version: it.version.to_string(),
            summary: it.summary.to_string(),
            joints: it.joints.iter().map(ToString::to_string).collect(),
            rate_hz: it.rate_hz,
            is_position_target: it.command == api::CommandKind::PositionTarget,
            forward_m_per_s: vec![it.forward_m_per_s.min, it.forward_m_per_s.max],
            needs: Needs::of(&it.needs),
            parameters: it.parameters.iter().map(parameter).collect(),
        }
    }

    pub(super) fn into_api(self) -> Option<api::Description> {
        let parameter = |it: Parameter| match it.values.as_slice() {
            &[default, min, max] => Some(api::Parameter {
                name: it.name.into(),
                unit: it.unit.into(),
                default,
                range: api::Range { min, max },
                scale: if it.is_log { api::Scale::Log } else { api::Scale::Linear },
            }),
            _ => None,
        };
        let &[min, max] = self.forward_m_per_s.as_slice() else { return None };
        Some(api::Description {
            name: self.name.into(),
            version: self.version.into(),
            summary: self.summary.into(),
            joints: self.joints.into_iter().map(Into::into).collect(),
            rate_hz: self.rate_hz,
            command: if self.is_position_target {
                api::CommandKind::PositionTarget
            } else {
                api::CommandKind::Velocity
            },
            forward_m_per_s: api::Range { min, max },
            needs: self.needs.into_api()?,
            parameters: self.parameters.into_iter().map(parameter).collect::<Option<Vec<_>>>()?.into(),
        })
    }
}

impl Robot {
    pub(super) fn of(it: &api::RobotDescription) -> Self {
        let joint = |it: &api::JointDescription| {
            let range = [it.lower_rad, it.upper_rad, it.effort_nm, it.velocity_limit_rad_per_s];
            let mut values = [it.origin_in_parent_m, it.axis].concat();
            values.extend(range);
            values.extend([it.stand_rad, it.mass_kg]);
            values.extend(it.com_in_link_m);
            Joint { name: it.name.to_string(), parent: it.parent, values }
        };
        let foot = |it: &api::FootDescription| Foot {
            name: it.name.to_string(),
            joint: it.joint,
            values: it.centre_in_link_m.into_iter().chain([it.radius_m]).collect(),
        };
        Self {
            name: it.name.to_string(),
            values: vec![it.mass_kg, it.base_mass_kg, it.stand_height_m],
            joints: it.joints.iter().map(joint).collect(),
            feet: it.feet.iter().map(foot).collect(),
        }
    }

    pub(super) fn into_api(self) -> Option<api::RobotDescription> {
        let joint = |it: Joint| {
            let &[ox, oy, oz, ax, ay, az, lower, upper, effort, limit, stand, mass, cx, cy, cz] =
                it.values.as_slice()
            else {
                return None;
            };
            Some(api::JointDescription {
                name: it.name.into(),
                parent: it.parent,
                origin_in_parent_m: [ox, oy, oz],
                axis: [ax, ay, az],
                lower_rad: lower,
                upper_rad: upper,
                effort_nm: effort,
                velocity_limit_rad_per_s: limit,
                stand_rad: stand,
                mass_kg: mass,
                com_in_link_m: [cx, cy, cz],
            })
        };
        let foot = |it: Foot| {
            let &[x, y, z, radius_m] = it.values.as_slice() else { return None };
            Some(api::FootDescription {
                name: it.name.into(),
                joint: it.joint,
                centre_in_link_m: [x, y, z],
                radius_m,
            })
        };
        let &[mass_kg, base_mass_kg, stand_height_m] = self.values.as_slice() else { return None };
        Some(api::RobotDescription {
            name: self.name.into(),
            mass_kg,
            base_mass_kg,
            stand_height_m,
            joints: self.joints.into_iter().map(joint).collect::<Option<Vec<_>>>()?.into(),
            feet: self.feet.into_iter().map(foot).collect::<Option<Vec<_>>>()?.into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use prost::Message as _;

    use super::*;

    #[test]
    fn a_robot_arrives_as_it_was_sent_bit_for_bit() {
        let robot = crate::runtime::fixture::robot();
        let bytes = Robot::of(&robot.description).encode_to_vec();
        let read = Robot::decode(bytes.as_slice()).unwrap().into_api();
        assert_eq!(read.as_ref(), Some(&robot.description));
    }

    #[test]
    fn a_description_arrives_as_it_was_sent_and_one_with_numbers_missing_does_not() {
        let parameter = api::Parameter {
            name: "period_s".into(),
            unit: "s".into(),
            default: 0.1 + 0.2,
            range: api::Range { min: 0.3, max: 0.8 },
            scale: api::Scale::Log,
        };
        let patch = api::TerrainPatch { back_m: 0.7, front_m: 1.3, half_width_m: 0.4, resolution_m: 0.05 };
        let description = api::Description {
            name: "trot".into(),
            version: "0.1.0".into(),
            summary: "Trots".into(),
            joints: vec!["LF_HAA".into(), "RH_KFE".into()].into(),
            rate_hz: 50.0,
            command: api::CommandKind::PositionTarget,
            forward_m_per_s: api::Range { min: -0.2, max: 0.7 },
            needs: api::Needs {
                policy: true,
                terrain: RSome(patch),
                foot_contacts: false,
                joint_torques: true,
            },
            parameters: vec![parameter].into(),
        };
        let sent = Description::of(&description);
        let mut read = Description::decode(sent.encode_to_vec().as_slice()).unwrap();
        assert_eq!(read.clone().into_api(), Some(description));
        read.needs.terrain.pop();
        assert_eq!(read.into_api(), None);
    }
}
