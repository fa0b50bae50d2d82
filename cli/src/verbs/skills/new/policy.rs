//! A skill from an exported policy network: no code, no compiler.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use serde::Serialize;
use toml::Table;
use vocaloco_core::installation::Installation;
use vocaloco_core::manifest::{Finding, read_bounded};
use vocaloco_core::policy::{NoContract, PolicyNetwork, Proposal, propose};
use vocaloco_core::predictor::ModelError;
use vocaloco_core::registry::{ModelPolicy, check_skill};
use vocaloco_core::robot::RobotModel;
use vocaloco_core::staging::{Stage, taken};
use vocaloco_plugin_api::CommandKind;
use vocaloco_plugin_api::contract::Contract;
use vocaloco_plugin_api::observation::Observer;

use super::manifest_text::manifest;
use super::{Args, Report};
use crate::exit::Exit;
use crate::output;

/// Hand-written contracts are tens of lines.
const MAX_CONTRACT_BYTES: u64 = 1 << 20;

/// What is known of the network that became a skill.
#[derive(Serialize)]
pub(super) struct Facts {
    policy_sha256: String,
    /// Values that it observes, and actions that it gives.
    inputs: usize,
    outputs: usize,
    /// What each field of the contract is from.
    contract_from: BTreeMap<String, String>,
}

impl Facts {
    /// For people: the network, then the fields of each origin.
    pub(super) fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!("{} values in, {} actions out", self.inputs, self.outputs)];
        lines.extend(self.by_origin());
        lines
    }

    fn by_origin(&self) -> Vec<String> {
        let mut fields: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for (field, origin) in &self.contract_from {
            fields.entry(origin).or_default().push(field);
        }
        fields.into_iter().map(|(origin, fields)| format!("{}: {origin}", fields.join(", "))).collect()
    }
}

/// Why nothing was made.
#[derive(Default, Serialize)]
struct Refused {
    inputs: Option<usize>,
    outputs: Option<usize>,
    /// Fields of the contract that nobody says.
    missing: Vec<&'static str>,
    findings: Vec<String>,
    /// How it could be written, for people.
    #[serde(skip)]
    example: Option<String>,
}

pub(super) fn make(args: &Args, installation: &Installation, file: &Path) -> anyhow::Result<Exit> {
    let name = args.name.as_str();
    let taken = taken(installation, name);
    ensure!(
        taken.is_none(),
        "NAME: found {name:?}, taken by {}, wanted a name that is not taken",
        taken.unwrap_or_default().display()
    );
    let [least, greatest] = args.forward_m_per_s[..] else {
        anyhow::bail!("--forward-m-per-s: found {:?}, wanted LEAST,GREATEST", args.forward_m_per_s)
    };
    let robot = RobotModel::load(&installation.robots_folder(), &args.robot)?;
    let added = args.contract.as_deref().map(added).transpose()?.unwrap_or_default();
    match try_to(args, installation, file, &robot, &added, [least, greatest])? {
        Ok(facts) => {
            let written = ["manifests/skills/NAME.toml", "skills/NAME/policy.onnx", "skills/NAME/CARD.md"];
            let next = [
                "vocaloco look --skill NAME --terrain flat --page out/look.html",
                "vocaloco evaluate viability --skill NAME --terrain flat",
                "vocaloco collect --skill NAME --kind viability --samples 20000 --repeats 1 --plant fast",
                "vocaloco collect --skill NAME --kind cot --samples 8000 --plant fast",
                "vocaloco train --skill NAME",
                "vocaloco skills check NAME",
            ];
            let named = |lines: &[&str]| lines.iter().map(|line| line.replace("NAME", name)).collect();
            args.report(named(&written), named(&next), Some(facts))
        }
        Err(refused) => refused.report(args),
    }
}

/// The `[contract]` of a file.
fn added(file: &Path) -> anyhow::Result<Table> {
    let text = read_bounded(file, MAX_CONTRACT_BYTES, file, "file").context("--contract")?;
    let mut table: Table =
        toml::from_str(&text).with_context(|| format!("--contract: {} is no TOML", file.display()))?;
    match table.remove("contract") {
        Some(toml::Value::Table(contract)) => Ok(contract),
        _ => anyhow::bail!("--contract: {}: found no [contract], wanted one", file.display()),
    }
}

/// The skill, in place; or why not, with nothing written.
fn try_to(
    args: &Args,
    installation: &Installation,
    file: &Path,
    robot: &RobotModel,
    added: &Table,
    forward_m_per_s: [f64; 2],
) -> anyhow::Result<Result<Facts, Refused>> {
    let read = PolicyNetwork::read(file).and_then(|bytes| {
        let network = PolicyNetwork::from_bytes(&bytes, file)?;
        Ok((bytes, network))
    });
    let (bytes, network) = match read {
        Ok(read) => read,
        Err(ModelError(finding)) => {
            return Ok(Err(Refused { findings: vec![finding.to_string()], ..Refused::default() }));
        }
    };
    let refused = Refused {
        inputs: Some(network.input_len()),
        outputs: Some(network.output_len()),
        ..Refused::default()
    };
    let Proposal { contract, origins } = match propose(network.metadata(), added) {
        Ok(proposal) => proposal,
        Err(error) => {
            let findings = vec![format!("{}: {error}", file.display())];
            let missing = if let NoContract::Missing { missing, .. } = error { missing } else { Vec::new() };
            return Ok(Err(Refused { missing, findings, example: example(robot), ..refused }));
        }
    };
    let facts = Facts {
        policy_sha256: network.sha256().to_owned(),
        inputs: network.input_len(),
        outputs: network.output_len(),
        contract_from: origins.into_iter().map(|(field, origin)| (field, origin.to_string())).collect(),
    };
    // What observes both is refused with the rest.
    let kind = contract.command().unwrap_or(CommandKind::Velocity);
    let command = match kind {
        CommandKind::Velocity => format!("forward_m_per_s = {forward_m_per_s:?}"),
        CommandKind::PositionTarget => format!("target_distance_m = {:?}", args.target_distance_m),
    };
    let text = manifest(&args.name, &args.summary, kind, &command, &contract);
    let stage = Stage::new(&installation.root, installation.plugin_path.clone())?;
    stage.file(&format!("manifests/skills/{}.toml", args.name), text.as_bytes())?;
    stage.file(&format!("skills/{}/policy.onnx", args.name), &bytes)?;
    stage.file(&format!("skills/{}/CARD.md", args.name), card(&args.name, file, &facts).as_bytes())?;
    // A sound one is driven for a moment besides.
    let findings = check_skill(stage.installation(), &args.name, &robot.description, ModelPolicy::Optional);
    if !findings.is_empty() {
        let findings = findings.into_iter().map(|finding| at_home(args, file, finding).to_string());
        return Ok(Err(Refused { findings: findings.collect(), ..refused }));
    }
    stage.publish(installation, &args.name)?;
    Ok(Ok(facts))
}

/// The finding at the file that a person can change: the staged manifest is gone.
fn at_home(args: &Args, policy: &Path, finding: Finding) -> Finding {
    let file = match (finding.field.split('.').next(), &args.contract) {
        (Some("contract"), Some(contract)) => contract.clone(),
        (Some("command"), _) => PathBuf::from("--forward-m-per-s, --target-distance-m"),
        _ => policy.to_owned(),
    };
    Finding { file, line: None, ..finding }
}

/// The card's first section; `train` adds its own.
fn card(name: &str, file: &Path, facts: &Facts) -> String {
    let Facts { policy_sha256, inputs, outputs, .. } = facts;
    let file = file.file_name().unwrap_or_default().display();
    format!(
        "# {name}\n\n## policy.onnx\n\n| | |\n|---|---|\n| file | sha256 `{policy_sha256}` |\n| from | `{file}`, by \
         `vocaloco skills new` |\n| network | {inputs} values in, {outputs} actions out |\n| contract | {} |\n",
        facts.by_origin().join("<br>")
    )
}

/// A contract as documented, with the number of values of each term on this robot where it fits it.
fn example(robot: &RobotModel) -> Option<String> {
    let page = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/policies.md"));
    let block = page.split("```toml\n").nth(1)?.split("```").next()?;
    let text = &block[block.find("[contract]")?..];
    let table: Table = text.parse().ok()?;
    let contract: Contract = table.get("contract")?.clone().try_into().ok()?;
    let sum = Observer::new(&contract, &robot.description).ok().map(|observer| {
        let terms: Vec<_> =
            observer.layout().map(|(term, length)| format!("{} {length}", term.name())).collect();
        format!(
            "# {} values in ({}), {} actions out\n",
            observer.len(),
            terms.join(" + "),
            contract.joints.len()
        )
    });
    Some(format!("{}{text}", sum.unwrap_or_default()))
}

impl Refused {
    fn report(&self, args: &Args) -> anyhow::Result<Exit> {
        if args.shared.json {
            let report = Report {
                command: "skills new",
                seed: args.shared.seed,
                version: env!("CARGO_PKG_VERSION"),
                name: &args.name,
                written: Vec::new(),
                next: Vec::new(),
                policy: None,
            };
            let mut report = serde_json::to_value(report)?;
            if let (Some(fields), serde_json::Value::Object(more)) =
                (report.as_object_mut(), serde_json::to_value(self)?)
            {
                fields.extend(more);
            }
            output::json(&report)?;
        }
        for finding in &self.findings {
            eprintln!("not made: {finding}");
        }
        if let (Some(inputs), Some(outputs)) = (self.inputs, self.outputs) {
            eprintln!("the network takes {inputs} values and gives {outputs} actions; nothing was written");
        }
        if let (Some(example), false) = (&self.example, args.shared.json) {
            eprintln!(
                "write what is missing into a file and give it with --contract; a whole one (docs/policies.md):\n\n\
                 {example}"
            );
        }
        Ok(Exit::Finding)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_example_is_a_contract_of_the_shipped_robot_and_says_its_sums() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        let robot = RobotModel::load(&folder, "anymal_d").expect("the shipped robot");
        let example = example(&robot).expect("an example");
        assert!(example.starts_with("# 235 values in (base_linear_velocity 3 + "), "{example}");
        assert!(example.contains("heights 187), 12 actions out\n[contract]\n"), "{example}");
        assert!(!example.contains("```"), "{example}");
    }
}
