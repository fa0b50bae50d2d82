//! One skill, looked at whole: its manifest, parameters, plugin, policy and predictors, and how they fit
//! each other and the robot. Nothing ends the look early that another finding could be beside.

use std::path::Path;

use vocaloco_plugin_api::contract::Contract;
use vocaloco_plugin_api::{CommandKind, Description, RobotDescription};

use super::{LoadedSkill, ModelPolicy, named};
use crate::installation::Installation;
use crate::lock::Intake;
use crate::manifest::{Finding, Isolation, MAX_BYTES, SkillManifest};
use crate::plugin::{PluginError, PluginLibrary};
use crate::policy::{MAX_POLICY_BYTES, PolicyNetwork};
use crate::predictor::{MAX_MODEL_BYTES, ModelError, Predictor, Quantity};

/// Parameter files are tens of lines; a network's weights do not belong there.
const MAX_PARAMETER_BYTES: u64 = 1 << 20;

/// The skill, or everything that is wrong with it: the findings are never empty.
pub(super) fn examine(
    installation: &Installation,
    name: &str,
    robot: &RobotDescription,
    policy: ModelPolicy,
    intake: &Intake<'_>,
) -> Result<LoadedSkill, Vec<Finding>> {
    let file = installation.skill_file(name);
    let manifest = named(&file, name, "skill")
        .and_then(|()| intake.text(&file, MAX_BYTES, &file, "file"))
        .and_then(|text| SkillManifest::parse(&file, text))
        .map_err(|finding| vec![finding])?;
    let folder = installation.skill_folder(name);
    let misfits_on_robot = manifest.contract.iter().flat_map(|contract| contract.misfits(robot));
    let mut findings: Vec<Finding> = misfits_on_robot
        .map(|misfit| Finding::new(&file, format!("contract.{}", misfit.field), misfit.found, misfit.wanted))
        .collect();
    let parameters = match (&manifest.models.parameters, &manifest.contract) {
        (Some(path), _) => intake.text(&folder.join(path), MAX_PARAMETER_BYTES, &file, "models.parameters"),
        (None, Some(contract)) if manifest.models.policy.is_some() => toml::to_string(contract)
            .map_err(|error| Finding::new(&file, "contract", error, "a contract that can be written out")),
        (None, _) => Ok(String::new()),
    };
    let network = manifest.models.policy.as_ref().map(|path| {
        let path = folder.join(path);
        let bytes = intake.bytes(&path, MAX_POLICY_BYTES, &path, "file")?;
        PolicyNetwork::from_bytes(&bytes, &path).map_err(|ModelError(finding)| finding)
    });
    let network = network.transpose();
    let open = match manifest.isolation {
        Isolation::None => PluginLibrary::open_if,
        Isolation::Process => PluginLibrary::open_isolated,
    };
    let admit = |library: &Path, bytes: &[u8]| intake.plugin(name, library, bytes);
    let library =
        open(&installation.plugin_path_of(name), &manifest.plugin, &admit).map_err(|error| match error {
            // No file of that name; one that cannot be read names itself.
            PluginError::NotFound(missing) if missing.field == "plugin" => {
                let found = format!("{:?}, no {}", manifest.plugin, missing.file.display());
                Finding::new(&file, "plugin", found, missing.wanted)
            }
            error => error.into_finding(),
        });
    if let Ok(library) = &library {
        findings.extend(misfits(&manifest, library.description()));
        findings.extend(policy_misfits(&manifest, library.description()));
    }
    if let (Ok(Some(network)), Some(contract)) = (&network, &manifest.contract) {
        findings.extend(network.misfits(&file, contract, robot));
    }
    // An instance of a policy whose contract does not fit would only say so again, less well.
    let is_tried = findings.is_empty() || manifest.contract.is_none();
    let mut needs = None;
    if let (Ok(library), Ok(text), Ok(network), true) = (&library, &parameters, &network, is_tried) {
        match library.create_with(text, robot, network.as_ref()) {
            Ok(instance) => needs = Some(*instance.needs()),
            Err(error) => findings.push(at_its_text(&manifest, &folder, error.into_finding())),
        }
    }
    let predictor = |field: &str, path: &Path, quantity: Quantity| {
        let path = folder.join(path);
        match (path.is_file(), policy) {
            (true, _) => intake.bytes(&path, MAX_MODEL_BYTES, &path, "file").and_then(|bytes| {
                let predictor = Predictor::from_bytes(&bytes, &path, quantity);
                predictor.map(Some).map_err(|ModelError(finding)| finding)
            }),
            (false, ModelPolicy::Optional) => Ok(None),
            (false, ModelPolicy::Required) => {
                let inside = path.strip_prefix(&installation.root).unwrap_or(&path);
                let found = format!("{}, no such file", inside.display());
                Err(Finding::new(&file, field, found, "a trained predictor (`vocaloco train`)"))
            }
        }
    };
    let viability = predictor("models.viability", &manifest.models.viability, Quantity::Viability);
    let cot = predictor("models.cot", &manifest.models.cot, Quantity::Cot);
    match (parameters, library, network, needs, viability, cot) {
        (Ok(parameters), Ok(library), Ok(policy), Some(needs), Ok(viability), Ok(cot))
            if findings.is_empty() =>
        {
            Ok(LoadedSkill {
                manifest,
                hold_threshold: None,
                library,
                parameters,
                needs,
                policy,
                viability,
                cot,
            })
        }
        (parameters, library, network, _, viability, cot) => {
            findings.extend(library.err());
            findings.extend(parameters.err());
            findings.extend(network.err());
            findings.extend(viability.err());
            findings.extend(cot.err());
            Err(findings)
        }
    }
}

/// A plugin's complaint about its text, with the file that the text is from.
fn at_its_text(manifest: &SkillManifest, folder: &Path, finding: Finding) -> Finding {
    if finding.field != "parameters" {
        return finding;
    }
    match &manifest.models.parameters {
        Some(path) => Finding { file: folder.join(path), ..finding },
        None if manifest.contract.is_some() => {
            Finding { file: manifest.file.clone(), field: "contract".to_owned(), ..finding }
        }
        None => finding,
    }
}

/// Where a manifest's policy network, contract and parameters are not what the plugin takes.
fn policy_misfits(manifest: &SkillManifest, plugin: &Description) -> Vec<Finding> {
    let finding =
        |field: &str, found: String, wanted: String| vec![Finding::new(&manifest.file, field, found, wanted)];
    let name = &plugin.name;
    let nothing = || "nothing".to_owned();
    match (&manifest.models.policy, &manifest.contract, &manifest.models.parameters) {
        (Some(path), _, _) if !plugin.needs.policy => {
            let wanted = format!("nothing: plugin {name} runs no policy network");
            finding("models.policy", path.display().to_string(), wanted)
        }
        (None, _, _) if plugin.needs.policy => {
            finding("models.policy", nothing(), format!("the network that plugin {name} runs"))
        }
        (Some(_), None, None) => {
            finding("contract", nothing(), "what the policy was trained with, by name".to_owned())
        }
        (Some(_), Some(_), Some(path)) => {
            let wanted = "nothing beside a contract: the plugin is created from one text".to_owned();
            finding("models.parameters", path.display().to_string(), wanted)
        }
        (_, Some(contract), _) if (contract.rate_hz - plugin.rate_hz).abs() > 1e-9 => {
            let wanted = format!("{}, the rate of plugin {name}", plugin.rate_hz);
            finding("contract.rate_hz", contract.rate_hz.to_string(), wanted)
        }
        _ => Vec::new(),
    }
}

/// Where a manifest asks more of a plugin than it declares.
fn misfits(manifest: &SkillManifest, plugin: &Description) -> Vec<Finding> {
    let mut findings = Vec::new();
    let command = &manifest.command;
    // A policy follows what it was trained to follow, whatever runs it.
    let (taken, whose) = match manifest.contract.as_ref().map(Contract::command) {
        Some(Ok(kind)) => (kind, "its contract".to_owned()),
        _ => (plugin.command, format!("plugin {}", plugin.name)),
    };
    if command.kind != taken {
        let wanted = format!("{}, the command of {whose}", taken.name());
        findings.push(Finding::new(&manifest.file, "command.kind", command.kind.name(), wanted));
    } else if command.kind == CommandKind::Velocity {
        let [least, greatest] = command.forward_m_per_s;
        let range = plugin.forward_m_per_s;
        // Phrased as "is inside", so NaN is refused too.
        if !(range.min <= least && greatest <= range.max) {
            let found = format!("[{least}, {greatest}]");
            let wanted =
                format!("inside [{}, {}], the range of plugin {}", range.min, range.max, plugin.name);
            findings.push(Finding::new(&manifest.file, "command.forward_m_per_s", found, wanted));
        }
    }
    findings
}
