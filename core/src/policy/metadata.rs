//! What exporters write beside a policy network, held against the manifest's contract.
//!
//! Isaac Lab and mjlab write lists separated by commas, in the policy's order; a number is often
//! rounded to three decimals. This project's trainer writes its whole contract as JSON besides.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;
use vocaloco_plugin_api::contract::{Contract, PerJoint};
use vocaloco_plugin_api::observation::Term;

/// A value of the metadata that the contract contradicts.
pub(super) struct Contradiction {
    pub(super) key: &'static str,
    pub(super) field: String,
    pub(super) found: String,
    pub(super) wanted: String,
}

/// Half a unit of the third decimal, and what f32 leaves of it.
const ROUNDING: f64 = 5.1e-4;

/// Every key whose value differs from the contract's, with the first difference of each.
pub(super) fn contradictions(metadata: &BTreeMap<String, String>, contract: &Contract) -> Vec<Contradiction> {
    let joints = &contract.joints;
    let default = PerJoint::Each(contract.action.default_position_rad.clone());
    let numbers = [
        ("default_joint_pos", "action.default_position_rad", &default),
        ("action_scale", "action.scale", &contract.action.scale),
        ("joint_stiffness", "gains.stiffness_nm_per_rad", &contract.gains.stiffness_nm_per_rad),
        ("joint_damping", "gains.damping_nms_per_rad", &contract.gains.damping_nms_per_rad),
    ];
    let listed = |key: &'static str| metadata.get(key).map(|text| list(text));
    let names = listed("joint_names").and_then(|names| {
        let wanted = names.join(", ");
        (names != joints.iter().map(String::as_str).collect::<Vec<_>>()).then(|| Contradiction {
            key: "joint_names",
            field: "joints".into(),
            found: joints.join(", "),
            wanted,
        })
    });
    let numbers = numbers.into_iter().filter_map(|(key, field, values)| {
        let values = values.in_order(field, joints).ok()?;
        number(key, field, &listed(key)?, &values, joints)
    });
    let terms = listed("observation_names").and_then(|names| terms(&names, contract));
    let whole = metadata.get("contract").and_then(|text| whole(text, contract));
    names.into_iter().chain(numbers).chain(terms).chain(whole).collect()
}

/// The items of a list as exporters write it.
pub(super) fn list(text: &str) -> Vec<&str> {
    let text = text.trim().trim_start_matches('[').trim_end_matches(']');
    text.split(',').map(|item| item.trim().trim_matches(['"', '\''])).collect()
}

/// The first joint whose number is another one; a single number stands for all.
fn number(
    key: &'static str,
    field: &str,
    listed: &[&str],
    values: &[f64],
    joints: &[String],
) -> Option<Contradiction> {
    let differs =
        |field: String, found: String, wanted: String| Some(Contradiction { key, field, found, wanted });
    if listed.len() != 1 && listed.len() != values.len() {
        let (found, wanted) = (format!("{} values", values.len()), listed.len().to_string());
        return differs(field.to_owned(), found, wanted);
    }
    for (index, (value, joint)) in values.iter().zip(joints).enumerate() {
        let text = listed[index % listed.len()];
        let same = text.parse::<f64>().is_ok_and(|listed| (listed - value).abs() <= ROUNDING);
        if !same {
            return differs(format!("{field}.{joint}"), value.to_string(), text.to_owned());
        }
    }
    None
}

/// The first term that the metadata names otherwise; names that are not known say nothing.
fn terms(names: &[&str], contract: &Contract) -> Option<Contradiction> {
    let own: Vec<&str> = contract.observation.iter().map(|term| term.term.name()).collect();
    let key = "observation_names";
    if names.len() != own.len() {
        let (found, wanted) = (own.join(", "), names.join(", "));
        return Some(Contradiction { key, field: "observation".into(), found, wanted });
    }
    let index = (0..names.len())
        .find(|&index| known(names[index]).is_some_and(|known| known != contract.observation[index].term))?;
    let field = format!("observation[{index}].term");
    Some(Contradiction { key, field, found: own[index].into(), wanted: names[index].into() })
}

/// The first part of a contract in JSON that says nothing of joints and is another one here.
fn whole(text: &str, contract: &Contract) -> Option<Contradiction> {
    let own = serde_json::to_value(contract).ok()?;
    let theirs: Value = serde_json::from_str(text).unwrap_or_default();
    let (field, found, wanted) = ["rate_hz", "history_layout", "observation"]
        .iter()
        .find_map(|field| difference(field, &own[field], &theirs[field]))?;
    Some(Contradiction { key: "contract", field, found, wanted })
}

/// The first place where two values differ, and both. Decimals may have been read a hair apart.
fn difference(at: &str, own: &Value, theirs: &Value) -> Option<(String, String, String)> {
    match (own, theirs) {
        (Value::Number(own), Value::Number(theirs)) => {
            let same = own
                .as_f64()
                .zip(theirs.as_f64())
                .is_some_and(|(own, theirs)| (own - theirs).abs() <= 1e-9 * own.abs().max(1.0));
            (!same).then(|| (at.to_owned(), own.to_string(), theirs.to_string()))
        }
        (Value::Array(own), Value::Array(theirs)) if own.len() == theirs.len() => {
            let mut pairs = own.iter().zip(theirs).enumerate();
            pairs.find_map(|(index, (own, theirs))| difference(&format!("{at}[{index}]"), own, theirs))
        }
        (Value::Object(own), Value::Object(theirs)) => {
            let keys: BTreeSet<&String> = own.keys().chain(theirs.keys()).collect();
            let value = |of: &serde_json::Map<String, Value>, key| of.get(key).cloned().unwrap_or_default();
            keys.into_iter()
                .find_map(|key| difference(&format!("{at}.{key}"), &value(own, key), &value(theirs, key)))
        }
        (own, theirs) if own == theirs => None,
        (own, theirs) => Some((at.to_owned(), own.to_string(), theirs.to_string())),
    }
}

/// The term that an exporter calls `name`.
pub(super) fn known(name: &str) -> Option<Term> {
    Some(match name {
        "base_lin_vel" | "base_linear_velocity" => Term::BaseLinearVelocity,
        "base_ang_vel" | "base_angular_velocity" => Term::BaseAngularVelocity,
        "projected_gravity" => Term::ProjectedGravity,
        "command" | "velocity_command" | "velocity_commands" | "generated_commands" => Term::VelocityCommand,
        "position_target" => Term::PositionTarget,
        "joint_pos" | "joint_pos_rel" | "joint_position" => Term::JointPosition,
        "joint_vel" | "joint_vel_rel" | "joint_velocity" => Term::JointVelocity,
        "joint_effort" | "joint_torque" => Term::JointTorque,
        "actions" | "last_action" => Term::LastAction,
        "foot_contact" => Term::FootContact,
        "gait_phase" => Term::GaitPhase,
        "height_scan" | "height_scanner" | "heights" => Term::Heights,
        _ => return None,
    })
}
