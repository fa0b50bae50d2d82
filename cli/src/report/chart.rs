//! Figures of the paper as SVG: panels with axes, drawn for a given width so that text is as large on a
//! phone as on a desk. Every series differs by colour and by dash or marker, never by colour alone.

mod ink;
mod panel;

use std::fmt::Write;

pub(crate) use ink::{Ink, Inks};
pub(crate) use panel::{Axis, Mark, Marker, Panel, Style};

/// Height of a line of text, and of a line of the legend, px.
const LINE_PX: f64 = 20.0;
/// A panel is not drawn narrower than this if it can be helped, px.
const PANEL_PX: f64 = 250.0;
const GAP_PX: f64 = 14.0;

/// What a colour and a marker stand for.
#[derive(Clone, Debug)]
pub(crate) enum Key {
    /// A line, a marker or both.
    Series(Style, String),
    /// A filled box.
    Fill(Ink, String),
}

/// A figure: panels side by side under one legend.
#[derive(Clone, Debug)]
pub(crate) struct Figure {
    /// Names its files and its place on the page.
    pub(crate) id: String,
    pub(crate) title: String,
    /// What is shown, with n, seed and command.
    pub(crate) caption: String,
    pub(crate) legend: Vec<Key>,
    pub(crate) panels: Vec<Panel>,
    /// Panels in a row at most.
    pub(crate) across: usize,
}

impl Figure {
    /// The figure without its title and caption, `width_px` wide.
    pub(crate) fn svg(&self, width_px: f64, inks: Inks) -> String {
        let mut body = String::new();
        let mut top = self.draw_legend(&mut body, width_px, inks);
        let fitting = ((width_px + GAP_PX) / (PANEL_PX + GAP_PX)).floor().max(1.0) as usize;
        let across = fitting.min(self.across).min(self.panels.len()).max(1);
        let panel_px = (width_px - GAP_PX * (across - 1) as f64) / across as f64;
        for row in self.panels.chunks(across) {
            let height = row.iter().map(|panel| panel.height_px(panel_px)).fold(0.0, f64::max);
            for (index, panel) in row.iter().enumerate() {
                let left = index as f64 * (panel_px + GAP_PX);
                let _ = write!(body, "<g transform=\"translate({left:.1} {top:.1})\">");
                panel.draw(&mut body, panel_px, inks);
                body.push_str("</g>\n");
            }
            top += height + GAP_PX;
        }
        let height = (top - GAP_PX).max(1.0);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width_px:.0} {height:.0}\" \
             width=\"{width_px:.0}\" height=\"{height:.0}\" role=\"img\" aria-label=\"{}\" \
             font-family=\"{FONT}\" font-size=\"12\">\n{}{body}</svg>\n",
            escaped(&self.title),
            inks.background(width_px, height),
        )
    }

    /// Draws the legend; what is below begins at the height returned.
    fn draw_legend(&self, svg: &mut String, width_px: f64, inks: Inks) -> f64 {
        let (mut x, mut y) = (0.0, 0.0);
        for key in &self.legend {
            let text = match key {
                Key::Series(_, text) | Key::Fill(_, text) => text,
            };
            let wide = 38.0 + text_px(text) + 16.0;
            if x > 0.0 && x + wide - 16.0 > width_px {
                (x, y) = (0.0, y + LINE_PX);
            }
            let middle = y + 0.5 * LINE_PX;
            match key {
                Key::Series(style, _) => style.draw_key(svg, [x, middle], inks),
                Key::Fill(ink, _) => {
                    let _ = write!(
                        svg,
                        "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"26\" height=\"12\" fill=\"{}\"/>",
                        x + 2.0,
                        middle - 6.0,
                        inks.of(*ink)
                    );
                }
            }
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{}\">{}</text>",
                x + 34.0,
                middle + 4.0,
                inks.of(Ink::Text),
                escaped(text)
            );
            x += wide;
        }
        if self.legend.is_empty() { 0.0 } else { y + LINE_PX + 6.0 }
    }
}

const FONT: &str = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Noto Sans', 'DejaVu Sans', sans-serif";

/// About how wide a text of 12 px is drawn, px.
pub(crate) fn text_px(text: &str) -> f64 {
    text.chars()
        .map(|letter| match letter {
            'i' | 'l' | 'j' | '.' | ',' | ':' | '\'' | '|' | ' ' | 't' | 'f' | 'I' => 4.2,
            'm' | 'w' | 'M' | 'W' | '→' | '%' => 10.4,
            letter if letter.is_uppercase() => 8.4,
            _ => 6.9,
        })
        .sum()
}

/// Text as XML takes it.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(panels: usize) -> Figure {
        let line =
            Mark::Line { points: vec![[0.0, 0.2], [1.0, f64::NAN], [2.0, 0.8]], style: Style::series(1) };
        let panel = Panel {
            title: "a < b".into(),
            x: Axis::over("step height (cm)", 0.0, 2.0, 1.0),
            y: Axis::share("share"),
            marks: vec![line],
        };
        Figure {
            id: "one".into(),
            title: "One".into(),
            caption: String::new(),
            legend: vec![Key::Series(Style::series(1), "trot".into())],
            panels: vec![panel; panels],
            across: 3,
        }
    }

    fn height(svg: &str) -> f64 {
        let from = svg.find(" height=\"").unwrap() + 9;
        svg[from..].split('"').next().unwrap().parse().unwrap()
    }

    #[test]
    fn panels_stand_side_by_side_where_there_is_room_and_below_each_other_on_a_phone() {
        let wide = figure(3).svg(1060.0, Inks::Page);
        let narrow = figure(3).svg(350.0, Inks::Page);
        assert!(height(&narrow) > 2.5 * height(&wide) - 60.0, "{} {}", height(&narrow), height(&wide));
    }

    #[test]
    fn no_text_breaks_the_markup_and_no_number_is_missing_from_it() {
        let svg = figure(1).svg(350.0, Inks::Print);
        assert!(svg.contains("a &lt; b") && !svg.contains("NaN"), "{svg}");
        assert!(!svg.contains("var("), "a file of its own knows no page's colours");
        assert!(figure(1).svg(350.0, Inks::Page).contains("var(--skill-1)"));
    }

    #[test]
    fn ticks_are_labelled_with_as_many_digits_as_they_need() {
        let labels = |axis: Axis| axis.ticks.into_iter().map(|(_, text)| text).collect::<Vec<_>>();
        assert_eq!(labels(Axis::share("")), ["0.00", "0.25", "0.50", "0.75", "1.00"]);
        assert_eq!(labels(Axis::over("", 0.0, 0.6, 0.2)), ["0.0", "0.2", "0.4", "0.6"]);
        assert_eq!(labels(Axis::over("", 0.0, 10.0, 5.0)), ["0", "5", "10"]);
    }

    #[test]
    fn a_line_breaks_where_a_value_is_missing() {
        let svg = figure(1).svg(350.0, Inks::Print);
        // Drawn last: legend, grid and axes come before it, and its markers are squares.
        let path = svg.split("<path").last().unwrap();
        assert_eq!(path.split("/>").next().unwrap().matches('M').count(), 2, "{path}");
    }

    #[test]
    fn a_legend_longer_than_the_figure_goes_on_in_the_next_line() {
        let mut figure = figure(1);
        let one = height(&figure.svg(350.0, Inks::Page));
        figure.legend = vec![Key::Fill(Ink::Reached, "a rather long description".into()); 3];
        assert!(height(&figure.svg(350.0, Inks::Page)) >= one + LINE_PX);
    }
}
