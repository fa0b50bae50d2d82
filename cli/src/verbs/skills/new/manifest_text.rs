//! The manifest of a policy as a person would write it: what has its default is left out.

use serde::Serialize;
use vocaloco_plugin_api::CommandKind;
use vocaloco_plugin_api::contract::{Contract, Factor};
use vocaloco_plugin_api::observation::{HeightOrder, HeightPatch, HistoryLayout, ObservationTerm};

/// The text of a manifest; `command` is the line of `[command]` that says how fast or how far.
pub(super) fn manifest(
    name: &str,
    summary: &str,
    kind: CommandKind,
    command: &str,
    contract: &Contract,
) -> String {
    format!(
        "schema = 1\nname = {}\nsummary = {}\nplugin = \"onnx\"\n\n[models]\npolicy = \"policy.onnx\"\n\
         # Written by `vocaloco train`.\nviability = \"viability.onnx\"\ncot = \"cot.onnx\"\n\n[selection]\n\
         # `vocaloco train --write-threshold 0.05` computes one from the data.\nviability_threshold = 0.95\n\
         # Another viable skill takes over where it is cheaper by this share.\ncost_margin = 0.1\n\n\
         [command]\nkind = \"{}\"\n{command}\n\n{}",
        inline(name),
        inline(summary),
        kind.name(),
        section(contract)
    )
}

/// `[contract]` and its tables.
fn section(contract: &Contract) -> String {
    let Contract { rate_hz, initial_phase, history_layout, joints, observation, action, gains } = contract;
    let mut lines =
        vec!["# What the policy sees and does, in training as here.".to_owned(), "[contract]".to_owned()];
    if *rate_hz != 50.0 {
        lines.push(format!("rate_hz = {}", inline(rate_hz)));
    }
    if *initial_phase != 0.0 {
        lines.push(format!("initial_phase = {}", inline(initial_phase)));
    }
    if *history_layout != HistoryLayout::default() {
        lines.push(format!("history_layout = {}", inline(history_layout)));
    }
    let legs = joints.chunks(3).map(|leg| leg.iter().map(inline).collect::<Vec<_>>().join(", "));
    lines.push(format!("joints = {}", list(legs)));
    lines.push(format!("observation = {}", list(observation.iter().map(term))));
    lines.push("\n[contract.action]".to_owned());
    lines.push(format!("kind = {}", inline(action.kind)));
    lines.push(format!("scale = {}", inline(&action.scale)));
    if action.clip != 100.0 {
        lines.push(format!("clip = {}", inline(action.clip)));
    }
    lines.push("\n[contract.action.default_position_rad]".to_owned());
    // In the policy's order; what is no joint of it is refused later, not here.
    let positions = &action.default_position_rad;
    let strangers = positions.keys().filter(|name| !joints.contains(name));
    let named = joints.iter().chain(strangers).filter_map(|joint| Some((joint, positions.get(joint)?)));
    lines.extend(named.map(|(joint, position_rad)| format!("{} = {}", key(joint), inline(position_rad))));
    lines.push("\n[contract.gains]".to_owned());
    lines.push(format!("stiffness_nm_per_rad = {}", inline(&gains.stiffness_nm_per_rad)));
    lines.push(format!("damping_nms_per_rad = {}", inline(&gains.damping_nms_per_rad)));
    lines.join("\n") + "\n"
}

fn term(term: &ObservationTerm) -> String {
    let mut parts = vec![format!("term = \"{}\"", term.term.name())];
    if term.scale != Factor::default() {
        parts.push(format!("scale = {}", inline(&term.scale)));
    }
    parts.extend(term.clip.map(|clip| format!("clip = {}", inline(clip))));
    if term.history != 1 {
        parts.push(format!("history = {}", term.history));
    }
    parts.extend(term.period_s.map(|period_s| format!("period_s = {}", inline(period_s))));
    parts.extend(term.patch.as_ref().map(|points| format!("patch = {}", patch(points))));
    format!("{{ {} }}", parts.join(", "))
}

fn patch(patch: &HeightPatch) -> String {
    let HeightPatch { back_m, front_m, half_width_m, resolution_m, offset_m, order } = patch;
    let order =
        if *order == HeightOrder::default() { String::new() } else { format!(", order = {}", inline(order)) };
    format!(
        "{{ back_m = {back_m:?}, front_m = {front_m:?}, half_width_m = {half_width_m:?}, \
         resolution_m = {resolution_m:?}, offset_m = {offset_m:?}{order} }}"
    )
}

fn list(rows: impl Iterator<Item = String>) -> String {
    rows.fold("[\n".to_owned(), |text, row| text + "    " + &row + ",\n") + "]"
}

/// A name as a key: bare where TOML lets it be.
fn key(name: &str) -> String {
    let is_bare = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if is_bare { name.to_owned() } else { inline(name) }
}

/// A value as TOML has it on one line.
fn inline(value: impl Serialize) -> String {
    toml::Value::try_from(value).map(|value| value.to_string()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;
    use vocaloco_core::manifest::SkillManifest;

    fn shipped(name: &str) -> SkillManifest {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../manifests/skills/{name}.toml"));
        SkillManifest::read(&file).expect("a shipped manifest")
    }

    fn back(contract: &Contract) -> Contract {
        let text = manifest(
            "stroll",
            "A \"stroll\"",
            CommandKind::Velocity,
            "forward_m_per_s = [0.0, 0.7]",
            contract,
        );
        let read = SkillManifest::parse(Path::new("stroll.toml"), text.clone());
        let read = read.unwrap_or_else(|finding| panic!("{finding}\n{text}"));
        assert_eq!((read.name.as_str(), read.summary.as_str()), ("stroll", "A \"stroll\""));
        read.contract.expect("a contract")
    }

    #[test]
    fn a_contract_that_is_written_reads_back_the_same() {
        for name in ["walk_network", "end_to_end"] {
            let contract = shipped(name).contract.expect("a contract");
            assert_eq!(back(&contract), contract, "{name}");
        }
    }

    #[test]
    fn what_has_no_default_value_reads_back_too() {
        let mut contract = shipped("walk_network").contract.expect("a contract");
        let each =
            contract.joints.iter().enumerate().map(|(index, name)| (name.clone(), 0.25 + index as f64));
        contract.action.scale = vocaloco_plugin_api::contract::PerJoint::Each(each.collect());
        (contract.rate_hz, contract.initial_phase, contract.action.clip) = (50.5, 0.25, 1e-7);
        contract.history_layout = HistoryLayout::TimeMajor;
        for term in &mut contract.observation {
            (term.clip, term.history) = (Some(3.0), 2);
            if let Some(patch) = &mut term.patch {
                patch.order = HeightOrder::ColumnsFromRight;
            }
        }
        assert_eq!(back(&contract), contract);
    }
}
