//! A skill's CARD.md: where each model came from and what it scores, one section a model, so that
//! writing one leaves the others as they are.

use std::fmt::Write;
use std::path::Path;

use anyhow::Context;

use crate::files::write_whole;

/// Writes the section `## heading` into `folder/CARD.md`, as [`with_section`] does.
///
/// # Errors
/// The file cannot be read or written.
pub fn write_section(folder: &Path, title: &str, heading: &str, body: &str) -> anyhow::Result<()> {
    let file = folder.join("CARD.md");
    let old = match std::fs::read_to_string(&file) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
        text => text.with_context(|| file.display().to_string())?,
    };
    write_whole(&file, with_section(&old, title, heading, body).as_bytes())
}

/// Replaces the section `## heading` of a card, or appends it; the rest stays as it is.
///
/// An empty card starts with the title `# title`. A section ends at the next `## `.
pub fn with_section(card: &str, title: &str, heading: &str, body: &str) -> String {
    let mut sections: Vec<(String, String)> = Vec::new();
    let mut head = String::new();
    for line in card.lines() {
        if let Some(heading) = line.strip_prefix("## ") {
            sections.push((heading.to_owned(), String::new()));
        } else {
            let target = sections.last_mut().map_or(&mut head, |(_, body)| body);
            target.push_str(line);
            target.push('\n');
        }
    }
    if head.trim().is_empty() {
        head = format!("# {title}\n");
    }
    match sections.iter_mut().find(|(name, _)| name == heading) {
        Some((_, old)) => body.clone_into(old),
        None => sections.push((heading.to_owned(), body.to_owned())),
    }
    let mut card = format!("{}\n", head.trim_end());
    for (heading, body) in sections {
        let _ = write!(card, "\n## {heading}\n\n{}\n", body.trim());
    }
    card
}

/// A two-column Markdown table without a head.
pub fn facts(rows: &[(&str, String)]) -> String {
    let mut table = String::from("| | |\n|---|---|\n");
    for (name, value) in rows {
        let _ = writeln!(table, "| {name} | {value} |");
    }
    table
}

/// Counts of labels in eleven classes of viability: none, up to each tenth below 1, and all.
pub fn viability_histogram(labels: impl Iterator<Item = f32>) -> String {
    let names =
        ["0", "≤ 0.1", "≤ 0.2", "≤ 0.3", "≤ 0.4", "≤ 0.5", "≤ 0.6", "≤ 0.7", "≤ 0.8", "≤ 0.9", "< 1", "1"];
    let mut counts = [0_usize; 12];
    for label in labels {
        // Labels are shares such as 3/10, which f32 holds a hair off.
        let class = if label <= 1e-4 {
            0
        } else if label >= 1.0 - 1e-4 {
            11
        } else {
            ((label - 1e-4) * 10.0) as usize + 1
        };
        counts[class] += 1;
    }
    row_table("viability", &names, &counts)
}

/// Counts of labels in ten equal classes from the lowest to the highest.
pub fn cost_histogram(labels: &[f32]) -> String {
    let low = labels.iter().copied().fold(f32::INFINITY, f32::min);
    let high = labels.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let width = ((high - low) / 10.0).max(f32::EPSILON);
    let mut counts = [0_usize; 10];
    for label in labels {
        counts[(((label - low) / width) as usize).min(9)] += 1;
    }
    let names: Vec<String> = (1..=10).map(|k| format!("≤ {:.2}", low + width * k as f32)).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    row_table("cost of transport", &names, &counts)
}

fn row_table(name: &str, names: &[&str], counts: &[usize]) -> String {
    let counts: Vec<String> = counts.iter().map(ToString::to_string).collect();
    format!(
        "| {name} | {} |\n|---|{}\n| rows | {} |\n",
        names.join(" | "),
        "---|".repeat(names.len()),
        counts.join(" | ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_section_is_replaced_and_the_others_stay() {
        let first = with_section("", "walk", "viability.onnx", "seed 1");
        let second = with_section(&first, "walk", "cot.onnx", "seed 2");
        assert_eq!(second, "# walk\n\n## viability.onnx\n\nseed 1\n\n## cot.onnx\n\nseed 2\n");
        let third = with_section(&second, "walk", "viability.onnx", "seed 3");
        assert_eq!(third, "# walk\n\n## viability.onnx\n\nseed 3\n\n## cot.onnx\n\nseed 2\n");
    }

    #[test]
    fn what_a_person_wrote_above_the_sections_stays() {
        let card = "# walk\n\nFor flat ground.\n\n## gait.toml\n\nby hand\n";
        let card = with_section(card, "walk", "cot.onnx", "fitted");
        assert_eq!(card, "# walk\n\nFor flat ground.\n\n## gait.toml\n\nby hand\n\n## cot.onnx\n\nfitted\n");
    }

    #[test]
    fn tenths_fall_into_their_own_class() {
        let table = viability_histogram([0.0, 0.1, 0.2, 0.3, 0.7, 0.9, 0.95, 1.0].into_iter());
        assert!(table.ends_with("| rows | 1 | 1 | 1 | 1 | 0 | 0 | 0 | 1 | 0 | 1 | 1 | 1 |\n"), "{table}");
    }
}
