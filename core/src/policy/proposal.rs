//! A policy's contract from what its exporter wrote beside the network, completed by what a person adds.
//!
//! Nothing is guessed from the network's shape: what nobody says is named, and there is no contract.

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize;
use thiserror::Error;
use toml::{Table, Value};
use vocaloco_plugin_api::contract::Contract;
use vocaloco_plugin_api::observation::Term;

use super::metadata::{known, list};

/// Fields without which there is no contract.
const REQUIRED: [&str; 6] = [
    "joints",
    "observation",
    "action.scale",
    "action.default_position_rad",
    "gains.stiffness_nm_per_rad",
    "gains.damping_nms_per_rad",
];

/// A contract, and what says so.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposal {
    /// The contract; whether it fits a robot and the network is another question.
    pub contract: Contract,
    /// What each field is from, by its name, such as `action.scale`.
    pub origins: BTreeMap<String, Origin>,
}

/// What a field of a proposed contract is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// This key of the file's metadata.
    Key(&'static str),
    /// The key `observation_names`, which gives neither scale nor clip nor history.
    Names,
    /// What a person added.
    Added,
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Key(key) => write!(f, "metadata {key}"),
            Self::Names => {
                write!(f, "metadata observation_names; scale 1, no clip and no history are assumed")
            }
            Self::Added => write!(f, "--contract"),
        }
    }
}

/// Why there is no contract.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum NoContract {
    /// Nobody says these fields; `notes` tell what was of no use.
    #[error("contract: found nothing for {}", said(.missing, .notes))]
    Missing {
        /// The fields.
        missing: Vec<&'static str>,
        /// Metadata that could not be used, a line each.
        notes: Vec<String>,
    },
    /// What is said is no contract.
    #[error("contract: found {0}, wanted the fields that docs/policies.md describes")]
    Unreadable(String),
}

fn said(missing: &[&str], notes: &[String]) -> String {
    let notes = notes.iter().map(String::as_str);
    std::iter::once(missing.join(", ").as_str()).chain(notes).collect::<Vec<_>>().join("; ")
}

/// The contract that `metadata` of a policy's file gives, with the fields of `added` in place of its own.
///
/// | key of the metadata | field |
/// |---|---|
/// | `contract` | all of them, as this project's trainer writes it |
/// | `joint_names`, `observation_names` | `joints`; `observation`, unless a term needs more than its name |
/// | `default_joint_pos`, `action_scale` | `action.default_position_rad`, `action.scale` |
/// | `joint_stiffness`, `joint_damping` | `gains.stiffness_nm_per_rad`, `gains.damping_nms_per_rad` |
///
/// The last six are what Isaac Lab and mjlab write, lists separated by commas. Of `added`, which is laid out
/// as a manifest's `[contract]`, the tables `action` and `gains` count field by field.
///
/// # Errors
/// A field is missing, or what is there does not read as a contract.
pub fn propose(metadata: &BTreeMap<String, String>, added: &Table) -> Result<Proposal, NoContract> {
    let mut draft = Draft::default();
    if let Some(text) = metadata.get("contract") {
        let whole = serde_json::from_str(text)
            .map_err(|error| NoContract::Unreadable(format!("{error} in metadata contract")))?;
        draft.lay(whole, Origin::Key("contract"));
    } else {
        draft.read_lists(metadata, added);
    }
    draft.lay(added.clone(), Origin::Added);
    let missing: Vec<_> = REQUIRED.into_iter().filter(|field| !draft.origins.contains_key(*field)).collect();
    if !missing.is_empty() {
        return Err(NoContract::Missing { missing, notes: draft.notes });
    }
    // There is one kind, which exporters do not name.
    if let Some(Value::Table(action)) = draft.table.get_mut("action") {
        action.entry("kind").or_insert_with(|| "joint_position".into());
    }
    let contract = Contract::deserialize(Value::Table(draft.table))
        .map_err(|error| NoContract::Unreadable(error.message().to_owned()))?;
    Ok(Proposal { contract, origins: draft.origins })
}

#[derive(Default)]
struct Draft {
    table: Table,
    origins: BTreeMap<String, Origin>,
    notes: Vec<String>,
}

impl Draft {
    fn lay(&mut self, fields: Table, origin: Origin) {
        for (name, value) in fields {
            match value {
                Value::Table(inner) if name == "action" || name == "gains" => {
                    for (part, value) in inner {
                        self.set(&format!("{name}.{part}"), value, origin);
                    }
                }
                value => self.set(&name, value, origin),
            }
        }
    }

    fn set(&mut self, field: &str, value: Value, origin: Origin) {
        self.origins.insert(field.to_owned(), origin);
        let Some((name, part)) = field.split_once('.') else {
            self.table.insert(field.to_owned(), value);
            return;
        };
        let table = self.table.entry(name).or_insert_with(|| Value::Table(Table::new()));
        if let Value::Table(table) = table {
            table.insert(part.to_owned(), value);
        }
    }

    fn read_lists(&mut self, metadata: &BTreeMap<String, String>, added: &Table) {
        let listed = |key: &str| metadata.get(key).map(|text| list(text));
        let mut joints: Vec<String> = Vec::new();
        if let Some(names) = listed("joint_names") {
            joints = names.iter().map(|name| (*name).to_owned()).collect();
            let names = names.into_iter().map(Value::from).collect();
            self.set("joints", Value::Array(names), Origin::Key("joint_names"));
        }
        if let Some(Value::Array(names)) = added.get("joints") {
            joints = names.iter().filter_map(Value::as_str).map(str::to_owned).collect();
        }
        for (key, field) in [
            ("default_joint_pos", "action.default_position_rad"),
            ("action_scale", "action.scale"),
            ("joint_stiffness", "gains.stiffness_nm_per_rad"),
            ("joint_damping", "gains.damping_nms_per_rad"),
        ] {
            match listed(key).map(|items| numbers(&items, &joints, field == "action.default_position_rad")) {
                None => {}
                Some(Some(value)) => self.set(field, value, Origin::Key(key)),
                Some(None) => {
                    self.notes.push(format!("metadata {key} is not a number, or one for each joint"));
                }
            }
        }
        if let Some(names) = listed("observation_names") {
            match terms(&names) {
                Ok(terms) => self.set("observation", terms, Origin::Names),
                Err(note) => self.notes.push(format!("metadata observation_names: {note}")),
            }
        }
    }
}

/// One number for all joints, or a table of one for each.
fn numbers(items: &[&str], joints: &[String], always_each: bool) -> Option<Value> {
    let values: Option<Vec<f64>> = items.iter().map(|item| item.parse().ok()).collect();
    let values = values?;
    let first = *values.first()?;
    if !always_each && values.iter().all(|value| *value == first) {
        return Some(first.into());
    }
    if joints.is_empty() || (values.len() != joints.len() && values.len() != 1) {
        return None;
    }
    let each = joints.iter().enumerate().map(|(index, joint)| (joint.clone(), values[index % values.len()]));
    Some(Value::Table(each.map(|(joint, value)| (joint, Value::Float(value))).collect()))
}

/// Terms by the names that exporters use, or why names are not enough.
fn terms(names: &[&str]) -> Result<Value, String> {
    let term = |name: &&str| {
        let short: String = name.chars().take(40).collect();
        match known(name) {
            None => Err(format!("{short:?} is no term that docs/policies.md lists")),
            Some(Term::Heights) => Err(format!("{short:?} does not say its `patch`")),
            Some(Term::GaitPhase) => Err(format!("{short:?} does not say its `period_s`")),
            Some(term) => Ok(Value::Table(Table::from_iter([("term".to_owned(), term.name().into())]))),
        }
    };
    names.iter().map(term).collect::<Result<Vec<Value>, String>>().map(Value::Array)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metadata(entries: &[(&str, &str)]) -> BTreeMap<String, String> {
        entries.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect()
    }

    /// As Isaac Lab writes it; the two joints' numbers differ.
    fn exported() -> BTreeMap<String, String> {
        metadata(&[
            ("joint_names", "hip, knee"),
            ("default_joint_pos", "0.1, -0.2"),
            ("action_scale", "0.5"),
            ("joint_stiffness", "80.0, 60.0"),
            ("joint_damping", "2.0, 2.0"),
            ("observation_names", "base_lin_vel, velocity_commands, joint_pos, actions"),
            ("run_path", "somewhere"),
        ])
    }

    fn added(text: &str) -> Table {
        text.parse().unwrap()
    }

    fn each(contract: &Contract, joint: &str) -> f64 {
        contract.gains.stiffness_nm_per_rad.in_order("", &contract.joints).unwrap()
            [contract.joints.iter().position(|name| name == joint).unwrap()]
    }

    #[test]
    fn what_isaac_lab_writes_is_a_contract_and_what_it_leaves_out_is_said() {
        let Proposal { contract, origins } = propose(&exported(), &Table::new()).unwrap();
        assert_eq!(contract.joints, ["hip", "knee"]);
        assert_eq!(contract.action.default_position_rad["knee"], -0.2);
        assert_eq!((each(&contract, "hip"), each(&contract, "knee")), (80.0, 60.0));
        let terms: Vec<_> = contract.observation.iter().map(|term| term.term.name()).collect();
        assert_eq!(terms, ["base_linear_velocity", "velocity_command", "joint_position", "last_action"]);
        assert_eq!(origins["observation"], Origin::Names);
        assert_eq!(origins["gains.damping_nms_per_rad"], Origin::Key("joint_damping"));
    }

    #[test]
    fn what_a_person_adds_stands_in_place_of_the_files_own_field_by_field() {
        let more = added(
            "[action]\nclip = 4.0\n[gains]\nstiffness_nm_per_rad = 33.0\n[[observation]]\nterm = \"joint_velocity\"\nscale = 0.05\n",
        );
        let Proposal { contract, origins } = propose(&exported(), &more).unwrap();
        assert_eq!((contract.action.clip, each(&contract, "knee")), (4.0, 33.0));
        assert_eq!(contract.action.default_position_rad["hip"], 0.1);
        assert_eq!(contract.observation.len(), 1);
        assert_eq!(origins["observation"], Origin::Added);
        assert_eq!(origins["action.scale"], Origin::Key("action_scale"));
    }

    #[test]
    fn the_contract_of_this_projects_trainer_comes_back_whole() {
        let contract = crate::policy::tests::contract();
        let text = serde_json::to_string(&contract).unwrap();
        let entries = metadata(&[("contract", &text), ("joint_names", "other")]);
        let proposal = propose(&entries, &Table::new()).unwrap();
        assert_eq!(proposal.contract, contract);
        assert_eq!(proposal.origins["gains.stiffness_nm_per_rad"], Origin::Key("contract"));
    }

    #[test]
    fn what_nobody_says_is_named_with_what_was_of_no_use() {
        let mut entries = exported();
        entries.remove("joint_damping");
        entries.insert("joint_stiffness".into(), "80, stiff".into());
        entries.insert("observation_names".into(), "base_lin_vel, height_scan".into());
        let Err(NoContract::Missing { missing, notes }) = propose(&entries, &Table::new()) else {
            panic!("no contract")
        };
        assert_eq!(missing, ["observation", "gains.stiffness_nm_per_rad", "gains.damping_nms_per_rad"]);
        assert!(notes.iter().any(|note| note.contains("joint_stiffness")), "{notes:?}");
        assert!(notes.iter().any(|note| note.contains("height_scan") && note.contains("patch")), "{notes:?}");
        let nothing = propose(&BTreeMap::new(), &Table::new()).unwrap_err().to_string();
        assert!(REQUIRED.iter().all(|field| nothing.contains(field)), "{nothing}");
    }

    #[test]
    fn what_does_not_read_as_a_contract_is_refused() {
        for (entries, more, part) in [
            (metadata(&[("contract", "{")]), "", "metadata contract"),
            (exported(), "[[observation]]\nterm = \"feet\"\n", "feet"),
            (exported(), "action = 3", "Action"),
            (exported(), "jonts = []", "jonts"),
        ] {
            let error = propose(&entries, &added(more)).unwrap_err().to_string();
            assert!(error.contains(part) && error.contains("found"), "{part}: {error}");
        }
    }
}
