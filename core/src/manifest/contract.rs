//! `[contract]`: what a policy was trained with, by name, so that a mismatch is refused at load.

use std::collections::BTreeMap;

use serde::Deserialize;
use vocaloco_plugin_api::RobotDescription;

use super::Finding;
use super::reader::Source;

/// What a policy was trained with. Every part may be left out by a structured controller.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contract {
    /// Joints, in the policy's own order.
    pub joints: Vec<String>,
    /// What it observes, in order.
    pub observation: Vec<ObservationTerm>,
    /// What its output means.
    pub action: Option<Action>,
    /// Gains that its joint targets are followed with.
    pub gains: Option<Gains>,
}

/// One term of an observation.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObservationTerm {
    /// Its name.
    pub term: String,
    /// Factor on the physical value.
    #[serde(default = "one")]
    pub scale: f64,
}

fn one() -> f64 {
    1.0
}

/// What a policy's output means: `target = default + scale · output`, rad.
#[derive(Clone, Debug, PartialEq)]
pub struct Action {
    /// Radians per unit of output.
    pub scale: f64,
    /// Default position by joint, rad.
    pub default_position_rad: BTreeMap<String, f64>,
}

/// Gains of every joint's PD law.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gains {
    /// Stiffness, N·m/rad.
    pub stiffness_nm_per_rad: f64,
    /// Damping, N·m·s/rad.
    pub damping_nms_per_rad: f64,
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct RawContract {
    joints: Vec<String>,
    observation: Vec<ObservationTerm>,
    action: Option<RawAction>,
    gains: Option<Gains>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum ActionKind {
    JointPosition,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawAction {
    #[serde(rename = "kind")]
    _kind: ActionKind,
    scale: f64,
    #[serde(default)]
    default_position_rad: BTreeMap<String, f64>,
}

impl RawContract {
    pub(super) fn check(self, source: &Source<'_>) -> Result<Contract, Finding> {
        for (index, joint) in self.joints.iter().enumerate() {
            if self.joints[..index].contains(joint) {
                let field = format!("contract.joints[{index}]");
                return Err(source.finding(&field, format!("{joint:?} again"), "every joint once"));
            }
        }
        for (index, term) in self.observation.iter().enumerate() {
            source.inside(&format!("contract.observation[{index}].scale"), term.scale, -1e3..=1e3)?;
        }
        if let Some(action) = &self.action {
            source.inside("contract.action.scale", action.scale, -10.0..=10.0)?;
            for (joint, position_rad) in &action.default_position_rad {
                let field = format!("contract.action.default_position_rad.{joint}");
                source.inside(&field, *position_rad, -10.0..=10.0)?;
            }
        }
        if let Some(gains) = &self.gains {
            source.inside("contract.gains.stiffness_nm_per_rad", gains.stiffness_nm_per_rad, 0.0..=1e4)?;
            source.inside("contract.gains.damping_nms_per_rad", gains.damping_nms_per_rad, 0.0..=1e3)?;
        }
        Ok(Contract {
            joints: self.joints,
            observation: self.observation,
            action: self.action.map(|action| Action {
                scale: action.scale,
                default_position_rad: action.default_position_rad,
            }),
            gains: self.gains,
        })
    }
}

impl Contract {
    /// Every place where this contract names a joint that `robot` lacks, or leaves one out.
    pub fn misfits(&self, file: &std::path::Path, robot: &RobotDescription) -> Vec<Finding> {
        let names: Vec<&str> = robot.joints.iter().map(|joint| joint.name.as_str()).collect();
        let wanted = format!("joints of {}: {}", robot.name, names.join(", "));
        let mut findings = Vec::new();
        for (index, joint) in self.joints.iter().enumerate() {
            if !names.contains(&joint.as_str()) {
                let field = format!("contract.joints[{index}]");
                findings.push(Finding::new(file, field, format!("{joint:?}"), &wanted));
            }
        }
        if !self.joints.is_empty() && self.joints.len() != names.len() {
            let found = format!("{} joints", self.joints.len());
            let wanted = format!("{}, as {} has", names.len(), robot.name);
            findings.push(Finding::new(file, "contract.joints", found, wanted));
        }
        for joint in self.action.iter().flat_map(|action| action.default_position_rad.keys()) {
            if !names.contains(&joint.as_str()) {
                let field = format!("contract.action.default_position_rad.{joint}");
                findings.push(Finding::new(file, field, format!("{joint:?}"), &wanted));
            }
        }
        findings
    }
}
