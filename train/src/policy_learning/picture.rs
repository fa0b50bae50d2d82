//! [`Curves`] as a picture: one small panel per quantity, SVG.

use std::fmt::Write;

use super::curves::Curves;

/// Quantities shown, with their titles.
const PANELS: [(&str, &str); 8] = [
    ("reward", "mean reward of a step"),
    ("episode_steps", "episode length, steps"),
    ("terminated_share", "share of episodes that end in a fall"),
    ("level", "curriculum level"),
    ("imitation_loss", "imitation loss"),
    ("value_loss", "value loss"),
    ("divergence", "divergence of an update"),
    ("std", "standard deviation of the actions"),
];

const ACROSS: usize = 4;
const PANEL: [f64; 2] = [260.0, 180.0];
const MARGIN: f64 = 36.0;
/// Points to a line at most; more cannot be told apart.
const POINTS: usize = 400;

/// The picture.
pub fn svg(curves: &Curves, title: &str) -> String {
    let rows = PANELS.len().div_ceil(ACROSS);
    let (width, height) = (PANEL[0] * ACROSS as f64, PANEL[1] * rows as f64 + 30.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"10\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n\
         <text x=\"{MARGIN}\" y=\"18\" font-size=\"13\">{title}; across: rounds of imitation, then iterations of PPO</text>\n"
    );
    for (at, (column, title)) in PANELS.iter().enumerate() {
        let left = PANEL[0] * (at % ACROSS) as f64;
        let top = 30.0 + PANEL[1] * (at / ACROSS) as f64;
        panel(&mut svg, [left, top], title, &curves.column(column), curves.rows());
    }
    svg.push_str("</svg>\n");
    svg
}

fn panel(svg: &mut String, [left, top]: [f64; 2], title: &str, values: &[(usize, f64)], rows: usize) {
    let [width, height] = [PANEL[0] - 2.0 * MARGIN, PANEL[1] - 2.0 * MARGIN];
    let (x, y) = (left + MARGIN, top + MARGIN);
    let _ = write!(
        svg,
        "<text x=\"{x}\" y=\"{}\">{title}</text>\n\
         <rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"#bbb\"/>\n",
        y - 5.0
    );
    let finite: Vec<(usize, f64)> = values.iter().copied().filter(|(_, value)| value.is_finite()).collect();
    let Some(low) = finite.iter().map(|(_, value)| *value).reduce(f64::min) else { return };
    let high = finite.iter().map(|(_, value)| *value).fold(low, f64::max);
    let span = if high > low { high - low } else { 1.0 };
    let every = finite.len().div_ceil(POINTS);
    let points: Vec<String> = finite
        .iter()
        .step_by(every)
        .map(|(row, value)| {
            let across = x + width * (*row as f64 - 1.0) / (rows as f64 - 1.0).max(1.0);
            let up = y + height * (1.0 - (value - low) / span);
            format!("{across:.1},{up:.1}")
        })
        .collect();
    let _ = write!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"#1f5fa8\" stroke-width=\"1.2\"/>\n\
         <text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>\n\
         <text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>\n\
         <text x=\"{x}\" y=\"{}\">1</text>\n\
         <text x=\"{}\" y=\"{}\" text-anchor=\"end\">{rows}</text>\n",
        points.join(" "),
        x - 3.0,
        y + 8.0,
        short(high),
        x - 3.0,
        y + height,
        short(low),
        y + height + 11.0,
        x + width,
        y + height + 11.0,
    );
}

fn short(value: f64) -> String {
    if value != 0.0 && !(0.01..1e5).contains(&value.abs()) {
        format!("{value:.1e}")
    } else {
        format!("{value:.2}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panel_without_numbers_is_empty_and_the_others_are_drawn() {
        let curves = Curves::parse("row,reward,level\n1,0.5,\n2,0.75,\n3,0.25,\n").unwrap();
        let svg = svg(&curves, "walk");
        assert_eq!(svg.matches("<polyline").count(), 1);
        // Highest in the middle, lowest last, on the panel's edges.
        assert!(svg.contains("points=\"36.0,120.0 130.0,66.0 224.0,174.0\""), "{svg}");
    }
}
