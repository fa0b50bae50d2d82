//! The numbers behind the figures: each table as JSON and as CSV.

use std::path::Path;

use anyhow::Context;
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::super::store::as_written;
use super::claims::{Claim, Evidence};

/// Writes every table into `folder`.
pub(super) fn write(folder: &Path, evidence: &Evidence<'_>, claims: &[Claim]) -> anyhow::Result<()> {
    let findings = evidence.findings;
    table(folder, "claims", claims)?;
    table(folder, "success", &findings.success)?;
    table(folder, "mixed", &findings.mixed)?;
    table(folder, "camera", &findings.sights)?;
    table(folder, "obstacles", &findings.obstacles)?;
    table(folder, "window", &with("window_ticks", &findings.windows)?)?;
    table(folder, "horizon", &with("horizon_m", &findings.horizons)?)?;
    table(folder, "threshold", &with("threshold", &findings.thresholds)?)?;
    table(folder, "threshold_curve", &evidence.threshold_curve())?;
    let cells: Vec<Value> = findings
        .cells
        .iter()
        .map(|cell| {
            let viable = cell.viable();
            let mean = |spread: Option<vocaloco_sim::collected::Spread>| spread.map(|spread| spread.mean);
            let std = |spread: Option<vocaloco_sim::collected::Spread>| spread.map(|spread| spread.std);
            json!({
                "skill": cell.skill,
                "terrain": cell.terrain,
                "size_m": cell.size_m,
                "n": cell.n(),
                "viable": viable.mean,
                "viable_low": viable.low,
                "viable_high": viable.high,
                "viable_predicted": mean(cell.predicted_viable()),
                "viable_predicted_std": std(cell.predicted_viable()),
                "cot": mean(cell.cost()),
                "cot_std": std(cell.cost()),
                "cot_predicted": mean(cell.predicted_cost()),
                "cot_predicted_std": std(cell.predicted_cost()),
                "cot_n": cell.cot.len(),
            })
        })
        .collect();
    table(folder, "cells", &cells)
}

/// Rows with the value that was varied in front.
fn with<T: Serialize>(
    name: &str,
    rows: &[(T, vocaloco_sim::course::SuccessRow)],
) -> anyhow::Result<Vec<Value>> {
    let row = |(value, row): &(T, vocaloco_sim::course::SuccessRow)| {
        let mut fields = as_written(row)?;
        fields[name] = as_written(value)?;
        Ok(fields)
    };
    rows.iter().map(row).collect()
}

fn table(folder: &Path, name: &str, rows: &[impl Serialize]) -> anyhow::Result<()> {
    let rows = rows.iter().map(as_written).collect::<Result<Vec<_>, _>>()?;
    let json = serde_json::to_string_pretty(&rows)? + "\n";
    for (extension, text) in [("json", json), ("csv", csv(&rows))] {
        let path = folder.join(format!("{name}.{extension}"));
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// RFC 4180, a column a field; nested values are left to the JSON.
fn csv(rows: &[Value]) -> String {
    let objects: Vec<&Map<String, Value>> = rows.iter().filter_map(Value::as_object).collect();
    let mut columns: Vec<&String> = Vec::new();
    for object in &objects {
        for (name, value) in *object {
            if !value.is_object() && !value.is_array() && !columns.contains(&name) {
                columns.push(name);
            }
        }
    }
    let line = |cells: Vec<String>| cells.join(",") + "\r\n";
    let mut text = line(columns.iter().map(|name| (*name).clone()).collect());
    for object in objects {
        text += &line(columns.iter().map(|name| cell(object.get(*name))).collect());
    }
    text
}

fn cell(value: Option<&Value>) -> String {
    match value {
        Some(Value::String(text)) if text.contains([',', '"', '\n', '\r']) => {
            format!("\"{}\"", text.replace('"', "\"\""))
        }
        Some(Value::String(text)) => text.clone(),
        None | Some(Value::Null | Value::Object(_) | Value::Array(_)) => String::new(),
        Some(value) => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_quotes_what_it_must_and_leaves_out_what_has_no_cell() {
        let rows = [
            json!({ "a": "up, \"then\" down", "b": 0.5, "c": null, "deep": { "x": 1 } }),
            json!({ "a": "plain", "b": 2 }),
        ];
        assert_eq!(csv(&rows), "a,b,c\r\n\"up, \"\"then\"\" down\",0.5,\r\nplain,2,\r\n");
    }
}
