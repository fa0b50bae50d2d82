//! One panel: two axes and what is drawn between them.

use std::fmt::Write;

use super::{Ink, Inks, escaped, text_px};

const PLOT_PX: f64 = 170.0;
const TITLE_PX: f64 = 22.0;
const FOOT_PX: f64 = 40.0;
const RIGHT_PX: f64 = 10.0;
const MARKER_PX: f64 = 3.4;
const DASHES: [&str; 6] = ["", "7 3", "2 2.5", "9 3 2 3", "4 2", "1 2"];

/// An axis: its label with the unit, its range, and what stands beside its ticks.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    pub(crate) label: String,
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) ticks: Vec<(f64, String)>,
}

/// What shape a point has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Marker {
    None,
    Circle,
    Square,
    Triangle,
    Diamond,
}

/// How a series looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Style {
    pub(crate) ink: Ink,
    /// Place in the list of dashes; `None` draws no line.
    pub(crate) dash: Option<usize>,
    pub(crate) marker: Marker,
}

impl Style {
    /// The series of this place: a colour, a dash and a marker of its own.
    pub(crate) fn series(place: usize) -> Self {
        let markers = [Marker::Circle, Marker::Square, Marker::Triangle, Marker::Diamond];
        Self { ink: Ink::Series(place), dash: Some(place), marker: markers[place % markers.len()] }
    }

    /// The same as points alone.
    pub(crate) const fn points(self) -> Self {
        Self { dash: None, ..self }
    }

    /// The same as a line alone.
    pub(crate) const fn line(self) -> Self {
        Self { marker: Marker::None, ..self }
    }

    fn stroke(self, inks: Inks) -> String {
        let dash = self.dash.map_or("", |dash| DASHES[dash % DASHES.len()]);
        let dash = if dash.is_empty() { String::new() } else { format!(" stroke-dasharray=\"{dash}\"") };
        format!(
            "fill=\"none\" stroke=\"{}\" stroke-width=\"1.8\" stroke-linejoin=\"round\"{dash}",
            inks.of(self.ink)
        )
    }

    fn draw_marker(self, svg: &mut String, [x, y]: [f64; 2], inks: Inks) {
        let (fill, r) = (inks.of(self.ink), MARKER_PX);
        let _ = match self.marker {
            Marker::None => Ok(()),
            Marker::Circle => write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{r}\" fill=\"{fill}\"/>"),
            Marker::Square => write!(
                svg,
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"6.4\" height=\"6.4\" fill=\"{fill}\"/>",
                x - 3.2,
                y - 3.2
            ),
            Marker::Triangle => {
                write!(svg, "<path d=\"M{x:.1} {:.1}l4.2 7.2h-8.4z\" fill=\"{fill}\"/>", y - 4.6)
            }
            Marker::Diamond => write!(
                svg,
                "<path d=\"M{x:.1} {:.1}l4.4 4.4l-4.4 4.4l-4.4 -4.4z\" fill=\"{fill}\"/>",
                y - 4.4
            ),
        };
    }

    pub(super) fn draw_key(self, svg: &mut String, [x, y]: [f64; 2], inks: Inks) {
        if self.dash.is_some() {
            let _ = write!(svg, "<path d=\"M{:.1} {y:.1}h28\" {}/>", x + 1.0, self.stroke(inks));
        }
        self.draw_marker(svg, [x + 15.0, y], inks);
    }
}

/// Something drawn in a panel. What is not finite is left out.
#[derive(Clone, Debug)]
pub(crate) enum Mark {
    /// A curve through points.
    Line { points: Vec<[f64; 2]>, style: Style },
    /// Between a low and a high curve: x, low, high.
    Band { points: Vec<[f64; 3]>, ink: Ink },
    /// Points with intervals: x, y, low, high.
    Points { points: Vec<[f64; 4]>, style: Style },
    /// A box: its two ends in x and in y.
    Bar { x: [f64; 2], y: [f64; 2], ink: Ink },
    /// A box of some strength, 0 to 1.
    Tint { x: [f64; 2], y: [f64; 2], ink: Ink, strength: f64 },
    /// A box's edges.
    Outline { x: [f64; 2], y: [f64; 2] },
    /// Words within the plot, beginning at a point.
    Words { at: [f64; 2], text: String },
}

/// A panel.
#[derive(Clone, Debug)]
pub(crate) struct Panel {
    pub(crate) title: String,
    pub(crate) x: Axis,
    pub(crate) y: Axis,
    pub(crate) marks: Vec<Mark>,
}

impl Axis {
    /// From `low` to `high` with a tick every `step`.
    pub(crate) fn over(label: &str, low: f64, high: f64, step: f64) -> Self {
        let is_whole = |factor: f64| (step * factor - (step * factor).round()).abs() < 1e-9;
        let digits = if is_whole(1.0) {
            0
        } else if is_whole(10.0) {
            1
        } else {
            2
        };
        let count = ((high - low) / step + 1e-6).floor() as usize;
        let tick = |index: usize| {
            let value = low + index as f64 * step;
            (value, format!("{value:.digits$}"))
        };
        Self { label: label.to_owned(), low, high, ticks: (0..=count).map(tick).collect() }
    }

    /// The same with ticks where they are wanted.
    pub(crate) fn with_ticks(mut self, values: &[f64]) -> Self {
        self.ticks = values.iter().map(|value| (*value, format!("{value}").replace('-', "−"))).collect();
        self
    }

    /// From 0 to at least `most`, in round steps.
    pub(crate) fn from_zero(label: &str, most: f64) -> Self {
        let most = if most.is_finite() && most > 0.0 { most } else { 1.0 };
        let steps = [0.01, 0.02, 0.05, 0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0];
        let step = steps.into_iter().find(|step| most / step <= 5.0).unwrap_or(100.0);
        Self::over(label, 0.0, (most / step).ceil() * step, step)
    }

    /// From 0 to 1.
    pub(crate) fn share(label: &str) -> Self {
        Self::over(label, 0.0, 1.0, 0.25)
    }

    /// One place for each name.
    pub(crate) fn names(label: &str, names: &[String]) -> Self {
        let ticks = names.iter().enumerate().map(|(place, name)| (place as f64, name.clone())).collect();
        Self { label: label.to_owned(), low: -0.6, high: names.len() as f64 - 0.4, ticks }
    }

    fn share_of(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }
}

impl Panel {
    /// How high it is when it is `width` wide.
    pub(super) fn height_px(&self, _width: f64) -> f64 {
        self.title_px() + PLOT_PX + FOOT_PX
    }

    fn title_px(&self) -> f64 {
        if self.title.is_empty() { 8.0 } else { TITLE_PX }
    }

    pub(super) fn draw(&self, svg: &mut String, width: f64, inks: Inks) {
        let widest = self.y.ticks.iter().map(|(_, text)| text_px(text)).fold(0.0, f64::max);
        let frame = Frame {
            left: widest + 28.0,
            top: self.title_px(),
            width: width - widest - 28.0 - RIGHT_PX,
            panel: self,
        };
        frame.draw_axes(svg, inks);
        for mark in &self.marks {
            frame.draw_mark(svg, mark, inks);
        }
    }
}

struct Frame<'a> {
    left: f64,
    top: f64,
    width: f64,
    panel: &'a Panel,
}

impl Frame<'_> {
    fn x(&self, value: f64) -> f64 {
        self.left + self.width * self.panel.x.share_of(value)
    }

    fn y(&self, value: f64) -> f64 {
        let share = self.panel.y.share_of(value);
        self.top + PLOT_PX * (1.0 - share.clamp(-0.02, 1.02))
    }

    fn draw_axes(&self, svg: &mut String, inks: Inks) {
        let Self { left, top, width, panel } = *self;
        let (right, bottom) = (left + width, top + PLOT_PX);
        let (text, axis, grid) = (inks.of(Ink::Text), inks.of(Ink::Axis), inks.of(Ink::Grid));
        if !panel.title.is_empty() {
            let _ = write!(
                svg,
                "<text x=\"{left:.1}\" y=\"13\" fill=\"{text}\" font-weight=\"600\">{}</text>",
                escaped(&panel.title)
            );
        }
        for (value, label) in &panel.y.ticks {
            let y = self.y(*value);
            let _ = write!(
                svg,
                "<path d=\"M{left:.1} {y:.1}H{right:.1}\" stroke=\"{grid}\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" fill=\"{text}\" text-anchor=\"end\">{}</text>",
                left - 5.0,
                y + 4.0,
                escaped(label)
            );
        }
        let mut free_from = f64::NEG_INFINITY;
        for (value, label) in &panel.x.ticks {
            let (x, half) = (self.x(*value), 0.5 * text_px(label));
            let _ = write!(svg, "<path d=\"M{x:.1} {bottom:.1}v4\" stroke=\"{axis}\"/>");
            if x - half < free_from {
                continue;
            }
            free_from = x + half + 6.0;
            let _ = write!(
                svg,
                "<text x=\"{x:.1}\" y=\"{:.1}\" fill=\"{text}\" text-anchor=\"middle\">{}</text>",
                bottom + 16.0,
                escaped(label)
            );
        }
        let _ = write!(
            svg,
            "<path d=\"M{left:.1} {bottom:.1}H{right:.1}\" stroke=\"{axis}\"/>\
             <text x=\"{right:.1}\" y=\"{:.1}\" fill=\"{text}\" text-anchor=\"end\">{}</text>\
             <text transform=\"translate(11 {:.1}) rotate(-90)\" fill=\"{text}\" text-anchor=\"middle\">{}</text>",
            bottom + 33.0,
            escaped(&panel.x.label),
            top + 0.5 * PLOT_PX,
            escaped(&panel.y.label)
        );
    }

    fn draw_mark(&self, svg: &mut String, mark: &Mark, inks: Inks) {
        match mark {
            Mark::Line { points, style } => self.draw_line(svg, points, *style, inks),
            Mark::Band { points, ink } => {
                let points: Vec<_> = points.iter().filter(|point| is_finite(&point[..])).collect();
                let there = points.iter().map(|[x, low, _]| (x, low));
                let back = points.iter().rev().map(|[x, _, high]| (x, high));
                let outline: Vec<String> =
                    there.chain(back).map(|(x, y)| format!("{:.1} {:.1}", self.x(*x), self.y(*y))).collect();
                if points.len() > 1 {
                    let (path, fill) = (outline.join("L"), inks.of(*ink));
                    let _ = write!(svg, "<path d=\"M{path}Z\" fill=\"{fill}\" fill-opacity=\"0.16\"/>");
                }
            }
            Mark::Points { points, style } => {
                for &[x, y, low, high] in points.iter().filter(|point| is_finite(&point[..])) {
                    let (x, ink) = (self.x(x), inks.of(style.ink));
                    let _ = write!(
                        svg,
                        "<path d=\"M{x:.1} {:.1}V{:.1}\" stroke=\"{ink}\" stroke-width=\"1.2\"/>",
                        self.y(low),
                        self.y(high)
                    );
                    style.draw_marker(svg, [x, self.y(y)], inks);
                }
            }
            Mark::Bar { x, y, ink } => {
                let (from, to) = (self.x(x[0]), self.x(x[1]));
                let (high, low) = (self.y(y[1]), self.y(y[0]));
                if is_finite(&[from, to, high, low]) && low > high {
                    let _ = write!(
                        svg,
                        "<rect x=\"{from:.1}\" y=\"{high:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{}\"/>",
                        to - from,
                        low - high,
                        inks.of(*ink)
                    );
                }
            }
            Mark::Tint { x, y, ink, strength } => {
                let (from, high) = (self.x(x[0]), self.y(y[1]));
                let _ = write!(
                    svg,
                    "<rect x=\"{from:.1}\" y=\"{high:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{}\" \
                     fill-opacity=\"{strength:.2}\"/>",
                    self.x(x[1]) - from,
                    self.y(y[0]) - high,
                    inks.of(*ink)
                );
            }
            Mark::Outline { x, y } => {
                let (from, high) = (self.x(x[0]), self.y(y[1]));
                let _ = write!(
                    svg,
                    "<rect x=\"{from:.1}\" y=\"{high:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"none\" \
                     stroke=\"{}\" stroke-width=\"1.5\"/>",
                    self.x(x[1]) - from,
                    self.y(y[0]) - high,
                    inks.of(Ink::Text)
                );
            }
            Mark::Words { at, text } => {
                let _ = write!(
                    svg,
                    "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{}\">{}</text>",
                    self.x(at[0]),
                    self.y(at[1]),
                    inks.of(Ink::Text),
                    escaped(text)
                );
            }
        }
    }

    fn draw_line(&self, svg: &mut String, points: &[[f64; 2]], style: Style, inks: Inks) {
        if style.dash.is_some() {
            let mut path = String::new();
            let mut pen = 'M';
            for point in points {
                if is_finite(point) {
                    let _ = write!(path, "{pen}{:.1} {:.1}", self.x(point[0]), self.y(point[1]));
                    pen = 'L';
                } else {
                    pen = 'M';
                }
            }
            let _ = write!(svg, "<path d=\"{path}\" {}/>", style.stroke(inks));
        }
        for point in points.iter().filter(|point| is_finite(&point[..])) {
            style.draw_marker(svg, [self.x(point[0]), self.y(point[1])], inks);
        }
    }
}

fn is_finite(values: &[f64]) -> bool {
    values.iter().all(|value| value.is_finite())
}
