//! `skills check`: everything that is wrong with skills and deployments, a line each.
//!
//! A skill is checked against the robots of the deployments that name it, or against every robot
//! there is when none does. A deployment is checked with all skills it names.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use vocaloco_core::installation::Installation;
use vocaloco_core::manifest::{Deployment, Finding};
use vocaloco_core::registry::{ModelPolicy, check_skill, read_deployment};
use vocaloco_core::robot::RobotModel;

use crate::exit::Exit;
use crate::output;
use crate::verbs::Shared;

#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    shared: Shared,
    /// Check these skills alone
    #[arg(value_name = "SKILL")]
    skills: Vec<String>,
}

#[derive(Serialize)]
struct Report {
    command: &'static str,
    seed: u64,
    version: &'static str,
    skills: Vec<Checked>,
    deployments: Vec<Checked>,
}

#[derive(Serialize)]
struct Checked {
    name: String,
    ok: bool,
    findings: Vec<String>,
}

impl Checked {
    fn new(name: &str, findings: Vec<String>) -> Self {
        Self { name: name.to_owned(), ok: findings.is_empty(), findings }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    let report = check(args)?;
    let all = || report.skills.iter().chain(&report.deployments);
    if args.shared.json {
        output::json(&report)?;
    } else if all().next().is_none() {
        output::line("no skills and no deployments")?;
    } else {
        for (kind, checked) in [("skill", &report.skills), ("deployment", &report.deployments)] {
            for one in checked {
                let verdict = if one.ok { "ok" } else { "not sound" };
                output::line(&format!("{kind} {}: {verdict}", one.name))?;
                for finding in &one.findings {
                    output::line(&format!("  {finding}"))?;
                }
            }
        }
    }
    Ok(if all().all(|one| one.ok) { Exit::Fine } else { Exit::Finding })
}

fn check(args: &Args) -> anyhow::Result<Report> {
    let installation = Installation::find()?;
    let mut robots = Robots { installation: &installation, loaded: BTreeMap::new() };
    let mut names: BTreeSet<String> = installation.skill_names()?.into_iter().collect();
    let (mut deployments, mut sound) = (Vec::new(), Vec::new());
    for name in installation.deployment_names()? {
        let mut findings = Vec::new();
        match read_deployment(&installation, &name) {
            Err(finding) => findings.push(finding.to_string()),
            Ok(deployment) => {
                findings.extend(robots.load(&deployment.robot).err());
                let is_missing = |skill: &&String| !installation.skill_file(skill).is_file();
                for skill in deployment.skills.iter().filter(is_missing) {
                    let wanted = "a skill with a manifest in manifests/skills";
                    let finding = Finding::new(&deployment.file, "skills", format!("{skill:?}"), wanted);
                    findings.push(finding.relative_to(&installation.root).to_string());
                }
                names.extend(deployment.skills.iter().cloned());
                sound.push(deployment);
            }
        }
        deployments.push(Checked::new(&name, findings));
    }
    if !args.skills.is_empty() {
        names = args.skills.iter().cloned().collect();
        deployments.clear();
    }
    let mut skills = Vec::new();
    for name in &names {
        skills.push(Checked::new(name, skill_findings(&installation, name, &sound, &mut robots)?));
    }
    Ok(Report {
        command: "skills check",
        seed: args.shared.seed,
        version: env!("CARGO_PKG_VERSION"),
        skills,
        deployments,
    })
}

fn skill_findings(
    installation: &Installation,
    name: &str,
    deployments: &[Deployment],
    robots: &mut Robots<'_>,
) -> anyhow::Result<Vec<String>> {
    let uses = deployments.iter().filter(|deployment| deployment.skills.iter().any(|skill| skill == name));
    let mut on: BTreeSet<String> = uses.map(|deployment| deployment.robot.clone()).collect();
    if on.is_empty() {
        on = installation.robot_names()?.into_iter().collect();
    }
    if on.is_empty() {
        return Ok(vec!["manifests/robots: robot: found none, wanted at least one to check against".into()]);
    }
    let mut findings = Vec::new();
    for robot in on {
        match robots.load(&robot) {
            Err(error) => findings.push(error),
            Ok(robot) => {
                let on_it = check_skill(installation, name, &robot.description, ModelPolicy::Required);
                findings.extend(on_it.iter().map(ToString::to_string));
            }
        }
    }
    // What has nothing to do with the robot is found on each of them.
    let mut seen = BTreeSet::new();
    findings.retain(|finding| seen.insert(finding.clone()));
    Ok(findings)
}

/// Robots by name, each read once.
struct Robots<'a> {
    installation: &'a Installation,
    loaded: BTreeMap<String, Result<RobotModel, String>>,
}

impl Robots<'_> {
    fn load(&mut self, name: &str) -> Result<&RobotModel, String> {
        let folder = self.installation.robots_folder();
        let load = || RobotModel::load(&folder, name).map_err(|error| error.to_string());
        self.loaded.entry(name.to_owned()).or_insert_with(load).as_ref().map_err(Clone::clone)
    }
}
