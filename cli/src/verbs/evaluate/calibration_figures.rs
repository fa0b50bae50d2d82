//! Calibration as pictures: collected against predicted by size, and the reliability diagram.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use vocaloco_sim::calibration::{COT_VIABILITY, Row, Summary};
use vocaloco_sim::dataset::Kind;
use vocaloco_sim::terrain::TerrainKind;

/// A skill's colour, in the order of the skills: told apart by those who see no red and green, too.
const COLOURS: [&str; 6] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#7a5c00"];
const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 320.0;
const LEFT: f64 = 54.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 74.0;

/// Writes a picture a terrain and kind, and the reliability diagram, into `folder`.
///
/// # Errors
/// A file cannot be written.
pub(super) fn write(folder: &Path, rows: &[Row], summaries: &[Summary]) -> anyhow::Result<Vec<PathBuf>> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let mut terrains: Vec<TerrainKind> = rows.iter().map(|row| row.terrain).collect();
    terrains.sort_unstable();
    terrains.dedup();
    let mut pictures = vec![("reliability.svg".to_owned(), reliability(summaries))];
    for terrain in terrains {
        for kind in [Kind::Viability, Kind::Cot] {
            pictures.push((format!("{}_{terrain}.svg", kind.id()), by_size(rows, kind, terrain)));
        }
    }
    let write = |(name, picture): (String, String)| {
        let file = folder.join(name);
        std::fs::write(&file, picture).with_context(|| file.display().to_string())?;
        Ok(file)
    };
    pictures.into_iter().map(write).collect()
}

/// Collected with its spread as a line with bars, predicted with its spread as a dashed line in a band.
///
/// The spread of a viability collected rollout by rollout is that of single outcomes, 0 and 1, and says
/// nothing beside the mean: it is left out. Cost is shown where the skill is 90 % viable.
fn by_size(rows: &[Row], kind: Kind, terrain: TerrainKind) -> String {
    let is_viable = |row: &Row| {
        rows.iter().any(|other| {
            other.kind == Kind::Viability
                && (other.terrain, &other.skill, other.size_m) == (terrain, &row.skill, row.size_m)
                && other.collected_mean.is_some_and(|mean| mean >= COT_VIABILITY)
        })
    };
    let shown: Vec<&Row> = rows
        .iter()
        .filter(|row| row.kind == kind && row.terrain == terrain)
        .filter(|row| kind == Kind::Viability || is_viable(row))
        .collect();
    let skills = skills(rows.iter().map(|row| row.skill.as_str()));
    let largest = rows.iter().filter(|row| row.terrain == terrain).map(|row| row.size_m).fold(0.0, f32::max);
    let top = |row: &&Row| {
        let end = |mean: Option<f64>, spread: Option<f64>| mean.unwrap_or(0.0) + spread.unwrap_or(0.0);
        end(row.collected_mean, row.collected_std).max(end(row.predicted_mean, row.predicted_std))
    };
    let (title, ceiling) = match kind {
        Kind::Viability => ("Viability", 1.0),
        Kind::Cot => {
            let highest = shown.iter().map(top).fold(0.1, f64::max);
            ("Cost of transport", (highest * 5.0).ceil() / 5.0)
        }
    };
    let axes = Axes { x_max: nice(f64::from(largest)), y_max: ceiling };
    let mut svg = axes.frame(&format!("{title} on {}", terrain.id().replace('_', " ")), "size (m)");
    for (at, skill) in skills.iter().enumerate() {
        let colour = COLOURS[at % COLOURS.len()];
        let mut own: Vec<&&Row> = shown.iter().filter(|row| row.skill == *skill).collect();
        own.sort_by(|a, b| a.size_m.total_cmp(&b.size_m));
        let predicted = points(&own, |row| Some((row.predicted_mean?, row.predicted_std?)));
        let collected = points(&own, |row| Some((row.collected_mean?, row.collected_std?)));
        axes.band(&mut svg, &predicted, colour);
        axes.line(&mut svg, &predicted, colour, true);
        axes.line(&mut svg, &collected, colour, false);
        for [x, mean, spread] in collected {
            let half = if kind == Kind::Cot { spread } else { 0.0 };
            axes.mark(&mut svg, [x, mean], half, colour);
        }
        legend(&mut svg, at, skill, colour);
    }
    svg.push_str(&note(
        "line and marks: collected; dashed, in a band of ± one standard deviation: predicted",
    ));
    svg.push_str("</svg>\n");
    svg
}

fn reliability(summaries: &[Summary]) -> String {
    let axes = Axes { x_max: 1.0, y_max: 1.0 };
    let mut svg = axes.frame("Reliability of predicted viability", "predicted");
    axes.line(&mut svg, &[[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]], "#999999", true);
    let of_viability: Vec<&Summary> = summaries.iter().filter(|one| one.kind == Kind::Viability).collect();
    for (at, one) in of_viability.into_iter().enumerate() {
        let colour = COLOURS[at % COLOURS.len()];
        let bins: Vec<[f64; 3]> = one
            .reliability
            .iter()
            .map(|bin| {
                // Standard error of the share collected in a bin.
                let error = (bin.collected * (1.0 - bin.collected) / bin.n as f64).sqrt();
                [bin.predicted, bin.collected, error]
            })
            .collect();
        axes.line(&mut svg, &bins, colour, false);
        for [x, y, error] in bins {
            axes.mark(&mut svg, [x, y], error, colour);
        }
        legend(&mut svg, at, &one.skill, colour);
    }
    svg.push_str(&note(
        "share that reached the horizon, by bins of the predicted; bars: ± one standard error",
    ));
    svg.push_str("</svg>\n");
    svg
}

fn skills<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut skills = Vec::new();
    for name in names {
        if !skills.contains(&name) {
            skills.push(name);
        }
    }
    skills
}

/// Size, mean and spread of every row that has them.
fn points(rows: &[&&Row], part: impl Fn(&Row) -> Option<(f64, f64)>) -> Vec<[f64; 3]> {
    let point = |row: &&&Row| part(row).map(|(mean, spread)| [f64::from(row.size_m), mean, spread]);
    rows.iter().filter_map(point).collect()
}

/// The next twentieth up, at least one.
fn nice(value: f64) -> f64 {
    ((value - 1e-6) * 20.0).ceil().max(1.0) / 20.0
}

/// Both axes begin at 0.
struct Axes {
    x_max: f64,
    y_max: f64,
}

impl Axes {
    fn x(&self, value: f64) -> f64 {
        LEFT + (WIDTH - LEFT - RIGHT) * value / self.x_max
    }

    fn y(&self, value: f64) -> f64 {
        HEIGHT - BOTTOM - (HEIGHT - BOTTOM - TOP) * value.clamp(0.0, self.y_max) / self.y_max
    }

    fn frame(&self, title: &str, x_title: &str) -> String {
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" \
             height=\"{HEIGHT}\" font-family=\"system-ui, sans-serif\" font-size=\"12\" role=\"img\" \
             aria-label=\"{title}\">\n<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n\
             <text x=\"{LEFT}\" y=\"20\" font-size=\"14\" font-weight=\"600\">{title}</text>\n"
        );
        for tick in 0..=5 {
            let share = f64::from(tick) / 5.0;
            let [x, y] = [self.x(self.x_max * share), self.y(self.y_max * share)];
            let _ = write!(
                svg,
                "<line x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"#dddddd\"/>\n\
                 <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#555555\">{:.2}</text>\n\
                 <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#555555\">{:.2}</text>\n",
                WIDTH - RIGHT,
                LEFT - 6.0,
                y + 4.0,
                self.y_max * share,
                HEIGHT - BOTTOM + 16.0,
                self.x_max * share
            );
        }
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#555555\">{x_title}</text>",
            WIDTH - RIGHT,
            HEIGHT - BOTTOM + 32.0
        );
        svg
    }

    fn line(&self, svg: &mut String, points: &[[f64; 3]], colour: &str, dashed: bool) {
        let dashes = if dashed { " stroke-dasharray=\"5 4\"" } else { "" };
        let path = self.path(points.iter().map(|[x, y, _]| [*x, *y]));
        let _ = writeln!(
            svg,
            "<polyline points=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.8\"{dashes}/>"
        );
    }

    fn band(&self, svg: &mut String, points: &[[f64; 3]], colour: &str) {
        let upper = points.iter().map(|[x, y, spread]| [*x, y + spread]);
        let lower = points.iter().rev().map(|[x, y, spread]| [*x, y - spread]);
        let path = self.path(upper.chain(lower));
        let _ = writeln!(svg, "<polygon points=\"{path}\" fill=\"{colour}\" fill-opacity=\"0.13\"/>");
    }

    fn mark(&self, svg: &mut String, [x, y]: [f64; 2], half: f64, colour: &str) {
        let [px, high, low] = [self.x(x), self.y(y + half), self.y(y - half)];
        let _ = writeln!(
            svg,
            "<line x1=\"{px:.1}\" x2=\"{px:.1}\" y1=\"{high:.1}\" y2=\"{low:.1}\" stroke=\"{colour}\"/>\
             <circle cx=\"{px:.1}\" cy=\"{:.1}\" r=\"3\" fill=\"{colour}\"/>",
            self.y(y)
        );
    }

    fn path(&self, points: impl Iterator<Item = [f64; 2]>) -> String {
        points.map(|[x, y]| format!("{:.1},{:.1}", self.x(x), self.y(y))).collect::<Vec<_>>().join(" ")
    }
}

fn legend(svg: &mut String, at: usize, skill: &str, colour: &str) {
    let x = LEFT + 130.0 * at as f64;
    let y = HEIGHT - 26.0;
    let _ = writeln!(
        svg,
        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{colour}\"/>\
         <text x=\"{:.1}\" y=\"{:.1}\">{skill}</text>",
        x + 8.0,
        y + 4.0
    );
}

fn note(text: &str) -> String {
    format!("<text x=\"{LEFT}\" y=\"{:.1}\" font-size=\"11\" fill=\"#555555\">{text}</text>\n", HEIGHT - 6.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_sim::scores::Bin;

    fn row(kind: Kind, size_m: f32, collected: f64) -> Row {
        Row {
            skill: "walk".into(),
            kind,
            terrain: TerrainKind::StairsUp,
            size_m,
            n: 9,
            collected_mean: Some(collected),
            collected_std: Some(0.1),
            predicted_mean: Some(collected - 0.05),
            predicted_std: Some(0.02),
        }
    }

    #[test]
    fn cost_is_shown_only_where_the_skill_is_viable() {
        let rows = [
            row(Kind::Viability, 0.1, 0.98),
            row(Kind::Viability, 0.3, 0.5),
            row(Kind::Cot, 0.1, 0.4),
            row(Kind::Cot, 0.3, 0.9),
        ];
        let marks = |kind| by_size(&rows, kind, TerrainKind::StairsUp).matches("r=\"3\"").count();
        assert_eq!((marks(Kind::Viability), marks(Kind::Cot)), (2, 1));
    }

    #[test]
    fn more_is_higher_and_a_larger_size_further_right() {
        let axes = Axes { x_max: 0.4, y_max: 1.0 };
        assert!(axes.y(0.9) < axes.y(0.1) && axes.x(0.3) > axes.x(0.1));
        assert!((axes.y(7.0) - TOP).abs() < 1e-9, "what is beyond the axis stays inside the picture");
    }

    #[test]
    fn every_picture_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let summary = Summary {
            skill: "walk".into(),
            kind: Kind::Viability,
            n: 9,
            brier: None,
            ece: None,
            auc: None,
            mae: None,
            r2: None,
            reliability: vec![Bin { n: 9, predicted: 0.9, collected: 0.8 }],
        };
        let files = write(folder.path(), &[row(Kind::Viability, 0.1, 0.98)], &[summary]).unwrap();
        let names: Vec<_> = files.iter().map(|file| file.file_name().unwrap().to_str().unwrap()).collect();
        assert_eq!(names, ["reliability.svg", "viability_stairs_up.svg", "cot_stairs_up.svg"]);
        let picture = std::fs::read_to_string(&files[0]).unwrap();
        assert!(picture.starts_with("<svg") && picture.ends_with("</svg>\n") && picture.contains("walk"));
    }
}
