//! `skills list`: a table of the manifests, sound or not.

use serde::Serialize;
use vocaloco_core::installation::Installation;
use vocaloco_core::manifest::SkillManifest;

use crate::exit::Exit;
use crate::output;
use crate::verbs::Shared;

#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    shared: Shared,
}

#[derive(Serialize)]
struct Report {
    command: &'static str,
    seed: u64,
    version: &'static str,
    skills: Vec<Row>,
}

/// A skill whose manifest cannot be read has an `error` and nothing else.
#[derive(Serialize)]
struct Row {
    name: String,
    #[serde(flatten)]
    manifest: Option<Manifest>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

#[derive(Serialize)]
struct Manifest {
    plugin: String,
    viability_threshold: f64,
    forward_m_per_s: [f64; 2],
    /// Which of the models that the manifest names are there.
    models: Models,
    summary: String,
}

#[derive(Serialize)]
struct Models {
    #[serde(skip_serializing_if = "Option::is_none")]
    policy: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    parameters: Option<bool>,
    viability: bool,
    cot: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    let installation = Installation::find()?;
    let skills = installation.skill_names()?.iter().map(|name| row(&installation, name)).collect();
    let report =
        Report { command: "skills list", seed: args.shared.seed, version: env!("CARGO_PKG_VERSION"), skills };
    if args.shared.json {
        output::json(&report)?;
    } else {
        output::line(&table(&report.skills))?;
    }
    Ok(Exit::Fine)
}

fn row(installation: &Installation, name: &str) -> Row {
    let folder = installation.skill_folder(name);
    match SkillManifest::read(&installation.skill_file(name)) {
        Err(finding) => Row {
            name: name.to_owned(),
            manifest: None,
            error: Some(finding.relative_to(&installation.root).to_string()),
        },
        Ok(manifest) => {
            let there = |path: &std::path::PathBuf| folder.join(path).is_file();
            // The shortest decimals that give the same f32: 0.925, not 0.925000011920929.
            let threshold = manifest.selection.viability_threshold;
            Row {
                name: name.to_owned(),
                manifest: Some(Manifest {
                    plugin: manifest.plugin,
                    viability_threshold: threshold.to_string().parse().unwrap_or(f64::from(threshold)),
                    forward_m_per_s: manifest.command.forward_m_per_s,
                    models: Models {
                        policy: manifest.models.policy.as_ref().map(there),
                        parameters: manifest.models.parameters.as_ref().map(there),
                        viability: there(&manifest.models.viability),
                        cot: there(&manifest.models.cot),
                    },
                    summary: manifest.summary,
                }),
                error: None,
            }
        }
    }
}

fn table(skills: &[Row]) -> String {
    let heading = ["skill", "plugin", "threshold", "m/s", "models", "summary"].map(String::from);
    let mut rows = vec![heading];
    for skill in skills {
        rows.push(match &skill.manifest {
            None => {
                let error = skill.error.clone().unwrap_or_default();
                [skill.name.clone(), "?".into(), "?".into(), "?".into(), "?".into(), error]
            }
            Some(manifest) => [
                skill.name.clone(),
                manifest.plugin.clone(),
                manifest.viability_threshold.to_string(),
                format!("{} to {}", manifest.forward_m_per_s[0], manifest.forward_m_per_s[1]),
                models(&manifest.models),
                manifest.summary.clone(),
            ],
        });
    }
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: [usize; 6] = std::array::from_fn(width);
    let line = |row: &[String; 6]| {
        let cells: Vec<String> =
            row.iter().zip(widths).map(|(cell, width)| format!("{cell:width$}")).collect();
        cells.join("  ").trim_end().to_owned()
    };
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}

fn models(models: &Models) -> String {
    let named = [
        ("policy", models.policy),
        ("parameters", models.parameters),
        ("viability", Some(models.viability)),
        ("cot", Some(models.cot)),
    ];
    let missing: Vec<&str> =
        named.iter().filter(|(_, there)| *there == Some(false)).map(|(name, _)| *name).collect();
    if missing.is_empty() { "all there".to_owned() } else { format!("no {}", missing.join(", ")) }
}
