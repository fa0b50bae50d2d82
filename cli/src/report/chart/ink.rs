//! Colours by role: on a page they are the page's own, light or dark; in a file they are those of paper.

/// What a colour stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ink {
    /// A skill or a series, by its place.
    Series(usize),
    /// Outcomes.
    Reached,
    Crashed,
    Stuck,
    Stopped,
    /// Words, axes, and the lines behind.
    Text,
    Axis,
    Grid,
}

/// Where colours come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Inks {
    /// Variables of the page that the figure stands on.
    Page,
    /// Fixed colours on white.
    Print,
}

/// Okabe and Ito's colours, those too pale for white darkened; in the page's order.
const SERIES: [&str; 6] = ["#0072b2", "#d55e00", "#009e73", "#a07800", "#56b4e9", "#cc79a7"];

impl Inks {
    /// The colour as SVG takes it.
    pub(crate) fn of(self, ink: Ink) -> String {
        let (name, fixed) = match ink {
            Ink::Series(place) => {
                let place = place % SERIES.len();
                return match self {
                    Self::Page => format!("var(--skill-{place})"),
                    Self::Print => SERIES[place].to_owned(),
                };
            }
            Ink::Reached => ("reached", "#2b7bba"),
            Ink::Crashed => ("crashed", "#c8501e"),
            Ink::Stuck => ("stuck", "#e8b23a"),
            Ink::Stopped => ("stopped", "#b9bec4"),
            Ink::Text => ("faint", "#4a4f57"),
            Ink::Axis => ("line", "#8a9098"),
            Ink::Grid => ("grid", "#e3e6e9"),
        };
        match self {
            Self::Page => format!("var(--{name})"),
            Self::Print => fixed.to_owned(),
        }
    }

    /// A file needs a ground of its own.
    pub(super) fn background(self, width: f64, height: f64) -> String {
        match self {
            Self::Page => String::new(),
            Self::Print => format!("<rect width=\"{width:.0}\" height=\"{height:.0}\" fill=\"#ffffff\"/>\n"),
        }
    }
}
