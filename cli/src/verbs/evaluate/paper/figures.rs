//! The paper's figures and the ablations', from what was measured.

mod ablating;
mod choosing;
mod danger;
mod predicting;
mod timeline;

use super::claims::Evidence;
use crate::report::Figure;

/// Every figure, in the order of the page.
pub(super) fn figures(evidence: &Evidence<'_>) -> Vec<Figure> {
    let mut figures =
        vec![predicting::difficulty(evidence), predicting::viability(evidence), predicting::cost(evidence)];
    figures.extend(choosing::success(evidence));
    figures.push(timeline::timeline(evidence));
    figures.push(choosing::energy(evidence));
    figures.extend(timeline::obstacles(evidence));
    figures.extend(danger::maps(evidence));
    figures.extend([
        ablating::window(evidence),
        ablating::horizon(evidence),
        ablating::threshold(evidence),
        ablating::fill(evidence),
    ]);
    figures
}

/// Step heights on an axis, cm.
const HEIGHT: &str = "step height (cm)";

fn cm(size_m: f32) -> f64 {
    // Heights are multiples of a millimetre; f32 is not.
    (f64::from(size_m) * 1000.0).round() / 10.0
}

/// The axis of step heights.
fn heights(sizes_m: &[f32]) -> crate::report::Axis {
    let most = sizes_m.iter().map(|size| cm(*size)).fold(5.0, f64::max);
    crate::report::Axis::over(HEIGHT, 0.0, most + 2.0, 5.0)
}
