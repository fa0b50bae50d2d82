//! Calibration as Markdown: a table a terrain and kind, a column pair a skill, and the scores.

use std::collections::BTreeSet;
use std::fmt::Write;

use vocaloco_sim::calibration::{Row, Summary};
use vocaloco_sim::dataset::Kind;
use vocaloco_sim::terrain::TerrainKind;

/// A whole page for the docs.
pub(super) fn page(rows: &[Row], summaries: &[Summary], command: &str, conditions: &str) -> String {
    format!(
        "# Predicted against collected\n\nWritten by:\n\n```sh\n{command} --markdown docs/calibration.md\n```\n\n\
         {conditions} Each cell is the mean ± one standard deviation over rollouts; a viability collected \
         rollout by rollout is 0 or 1, so its mean alone is shown. Cost of transport is that of the rollouts \
         which reached the horizon.\n\n{}",
        tables(rows, summaries)
    )
}

/// The tables alone.
pub(super) fn tables(rows: &[Row], summaries: &[Summary]) -> String {
    let mut text = String::new();
    for kind in [Kind::Viability, Kind::Cot] {
        for terrain in in_order(rows.iter().map(|row| row.terrain)) {
            let rows: Vec<&Row> =
                rows.iter().filter(|row| row.kind == kind && row.terrain == terrain).collect();
            let _ = write!(text, "## {} on {terrain}\n\n{}\n", name(kind), table(kind, terrain, &rows));
        }
    }
    let _ = write!(text, "## Scores over all sizes\n\n{}", scores(summaries));
    text
}

fn name(kind: Kind) -> &'static str {
    match kind {
        Kind::Viability => "Viability",
        Kind::Cot => "Cost of transport",
    }
}

fn table(kind: Kind, terrain: TerrainKind, rows: &[&Row]) -> String {
    let skills = in_order(rows.iter().map(|row| row.skill.as_str()));
    let mut text = format!("| {} (m) |", size_name(terrain));
    for skill in &skills {
        let _ = write!(text, " {skill} collected | {skill} predicted |");
        if kind == Kind::Cot {
            text.push_str(" n |");
        }
    }
    let columns = skills.len() * if kind == Kind::Cot { 3 } else { 2 };
    let _ = writeln!(text, "\n|---|{}", "---|".repeat(columns));
    // Sizes are not negative, so their bits sort as they do.
    let sizes: BTreeSet<u32> = rows.iter().map(|row| row.size_m.to_bits()).collect();
    for bits in sizes {
        let _ = write!(text, "| {:.3} |", f32::from_bits(bits));
        for skill in &skills {
            let row = rows.iter().find(|row| row.skill == *skill && row.size_m.to_bits() == bits);
            let cell = |mean: Option<f64>, deviation: Option<f64>| match (mean, deviation) {
                (Some(mean), Some(deviation)) => format!("{mean:.3} ± {deviation:.3}"),
                (Some(mean), None) => format!("{mean:.3}"),
                _ => "–".to_owned(),
            };
            let spread = row.and_then(|row| row.collected_std.filter(|_| kind == Kind::Cot));
            let collected = cell(row.and_then(|row| row.collected_mean), spread);
            let predicted =
                cell(row.and_then(|row| row.predicted_mean), row.and_then(|row| row.predicted_std));
            let _ = write!(text, " {collected} | {predicted} |");
            if kind == Kind::Cot {
                let _ = write!(text, " {} |", row.map_or(0, |row| row.n));
            }
        }
        text.push('\n');
    }
    text
}

fn size_name(terrain: TerrainKind) -> &'static str {
    match terrain {
        TerrainKind::StairsUp | TerrainKind::StairsDown => "step height",
        _ => "size",
    }
}

fn scores(summaries: &[Summary]) -> String {
    let mut text = String::from(
        "| skill | predictor | n | Brier | ECE | AUC | MAE | R² |\n|---|---|---|---|---|---|---|---|\n",
    );
    let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.3}"));
    for one in summaries {
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} | {} |",
            one.skill,
            one.kind.id(),
            one.n,
            number(one.brier),
            number(one.ece),
            number(one.auc),
            number(one.mae),
            number(one.r2)
        );
    }
    text.push_str("\nCost of transport is scored over the sizes of which at least 90 % are viable.\n");
    text
}

/// Each item once, in the order of its first appearance.
fn in_order<T: PartialEq>(items: impl Iterator<Item = T>) -> Vec<T> {
    let mut seen = Vec::new();
    for item in items {
        if !seen.contains(&item) {
            seen.push(item);
        }
    }
    seen
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(skill: &str, kind: Kind, size_m: f32, collected: f64) -> Row {
        Row {
            skill: skill.into(),
            kind,
            terrain: TerrainKind::StairsDown,
            size_m,
            n: 7,
            collected_mean: Some(collected),
            collected_std: Some(0.25),
            predicted_mean: Some(collected - 0.1),
            predicted_std: Some(0.05),
        }
    }

    #[test]
    fn skills_stand_side_by_side_and_sizes_below_each_other() {
        let rows = [
            row("walk", Kind::Viability, 0.2, 0.5),
            row("descend", Kind::Viability, 0.2, 1.0),
            row("walk", Kind::Viability, 0.1, 0.9),
            row("walk", Kind::Cot, 0.1, 0.3),
        ];
        let text = tables(&rows, &[]);
        assert!(
            text.contains("| step height (m) | walk collected | walk predicted | descend collected |"),
            "{text}"
        );
        let low = text.find("| 0.100 | 0.900 | 0.800 ± 0.050 | – | – |").unwrap_or_else(|| panic!("{text}"));
        let high = text.find("| 0.200 | 0.500 | 0.400 ± 0.050 | 1.000 |").unwrap_or_else(|| panic!("{text}"));
        assert!(low < high);
        assert!(text.contains("| 0.100 | 0.300 ± 0.250 | 0.200 ± 0.050 | 7 |"), "{text}");
    }
}
