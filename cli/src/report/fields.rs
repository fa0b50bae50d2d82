//! Sample fields of a data set as SVG: a line a terrain, harder to the right, each with its label.

use std::fmt::Write;

use vocaloco_core::heightfield::{CELLS, COLUMNS, ROWS};
use vocaloco_sim::{dataset::Kind, terrain::TerrainKind};

/// One row of a data set.
#[derive(Clone, Copy)]
pub(crate) struct SampleField<'a> {
    /// As networks see it, `[row][column]`, back to front, left to right, m.
    pub(crate) field_m: &'a [f32; CELLS],
    /// Viability or cost of transport.
    pub(crate) label: f32,
    /// Size of its terrain, m.
    pub(crate) size_m: f32,
}

/// A terrain and one sample for each band of difficulty that has any.
pub(crate) type FieldRow<'a> = (TerrainKind, Vec<Option<SampleField<'a>>>);

/// Pixels for a cell of 10 cm.
const CELL_PX: usize = 5;
const GAP_PX: usize = 14;
const NAMES_PX: usize = 100;
const TEXT_PX: usize = 34;
const TITLE_PX: usize = 48;
/// Shades from low to high.
const SHADES: usize = 25;
/// Heights beyond are drawn as this high or low, m.
const RANGE_M: f32 = 1.0;
const LOW: [f32; 3] = [33.0, 68.0, 120.0];
const LEVEL: [f32; 3] = [246.0, 246.0, 242.0];
const HIGH: [f32; 3] = [176.0, 72.0, 20.0];

/// The picture; the robot looks up the page.
pub(crate) fn fields(title: &str, kind: Kind, rows: &[FieldRow<'_>]) -> String {
    let columns = rows.iter().map(|(_, samples)| samples.len()).max().unwrap_or(0);
    let (field_w, field_h) = (COLUMNS * CELL_PX, ROWS * CELL_PX);
    let width = (NAMES_PX + columns * (field_w + GAP_PX) + GAP_PX).max(420);
    let height = TITLE_PX + rows.len() * (field_h + TEXT_PX + GAP_PX);
    let title = title.replace('&', "&amp;").replace('<', "&lt;");
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"system-ui, sans-serif\" font-size=\"12\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n\
         <text x=\"{GAP_PX}\" y=\"20\" fill=\"#17191c\">{title}</text>\n\
         <text x=\"{GAP_PX}\" y=\"38\" fill=\"#5c636b\">blue 1 m below the field's centre, red 1 m above; \
         ahead is up</text>\n"
    );
    for (line, (terrain, samples)) in rows.iter().enumerate() {
        let y = TITLE_PX + line * (field_h + TEXT_PX + GAP_PX);
        let _ =
            writeln!(svg, "<text x=\"{GAP_PX}\" y=\"{}\" fill=\"#17191c\">{terrain}</text>", y + field_h / 2);
        for (column, sample) in samples.iter().enumerate() {
            let Some(sample) = sample else { continue };
            let x = NAMES_PX + column * (field_w + GAP_PX);
            let _ = writeln!(svg, "<g transform=\"translate({x} {y})\">");
            draw(&mut svg, sample.field_m);
            let (size_m, label) = (sample.size_m, sample.label);
            let _ = writeln!(
                svg,
                "<text y=\"{}\" fill=\"#17191c\">{} {label:.2}</text>\
                 <text y=\"{}\" fill=\"#5c636b\">{size_m:.2} m</text></g>",
                field_h + 14,
                short(kind),
                field_h + 28
            );
        }
    }
    svg.push_str("</svg>\n");
    svg
}

const fn short(kind: Kind) -> &'static str {
    match kind {
        Kind::Viability => "V",
        Kind::Cot => "CoT",
    }
}

/// One path for each shade that occurs.
fn draw(svg: &mut String, field_m: &[f32; CELLS]) {
    let mut paths = vec![String::new(); SHADES];
    for (cell, height_m) in field_m.iter().enumerate() {
        let share = 0.5 + 0.5 * (height_m / RANGE_M).clamp(-1.0, 1.0);
        let shade = (share * (SHADES - 1) as f32).round() as usize;
        let (row, column) = (cell / COLUMNS, cell % COLUMNS);
        let _ = write!(paths[shade], "M{column} {}h1v1h-1z", ROWS - 1 - row);
    }
    let _ = write!(svg, "<g transform=\"scale({CELL_PX})\" shape-rendering=\"crispEdges\">");
    for (shade, path) in paths.iter().enumerate().filter(|(_, path)| !path.is_empty()) {
        let [red, green, blue] = colour(shade as f32 / (SHADES - 1) as f32);
        let _ = write!(svg, "<path fill=\"#{red:02x}{green:02x}{blue:02x}\" d=\"{path}\"/>");
    }
    svg.push_str("</g>\n");
}

/// From low over level to high.
fn colour(share: f32) -> [u8; 3] {
    let (from, to, way) =
        if share < 0.5 { (LOW, LEVEL, 2.0 * share) } else { (LEVEL, HIGH, 2.0 * share - 1.0) };
    std::array::from_fn(|part| (from[part] + way * (to[part] - from[part])).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_is_drawn_ahead_up_and_left_on_the_left() {
        let mut field_m = [0.0; CELLS];
        // The front's leftmost cell.
        field_m[(ROWS - 1) * COLUMNS] = 0.9;
        let sample = SampleField { field_m: &field_m, label: 0.25, size_m: 0.125 };
        let svg = fields("a < b", Kind::Viability, &[(TerrainKind::Gap, vec![None, Some(sample)])]);
        assert_eq!(svg.matches("h1v1h-1z").count(), CELLS);
        assert!(svg.contains("d=\"M0 0h1v1h-1z\"/>"), "the one high cell stands alone at the top left");
        assert!(svg.contains("a &lt; b") && svg.contains("V 0.25") && svg.contains("0.12 m"), "{svg}");
    }

    #[test]
    fn low_is_blue_level_is_white_and_high_is_red() {
        let [low, level, high] = [0.0, 0.5, 1.0].map(colour);
        assert!(low[2] > low[0] && high[0] > high[2] && level.iter().all(|part| *part > 240));
    }
}
