//! The space that the optimiser sees: each tunable parameter mapped to 0…1, linear or logarithmic.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use anyhow::ensure;
use vocaloco_plugin_api::{Parameter, Scale};

/// The parameters that are searched, and those that are held.
pub(super) struct Space {
    searched: Vec<Parameter>,
    held: Vec<(String, f64)>,
    start: Vec<f64>,
}

impl Space {
    /// Splits a plugin's parameters by what the configuration fixes and where it starts.
    ///
    /// # Errors
    /// A name that the plugin does not have, or a start outside its range.
    pub(super) fn new(
        parameters: &[Parameter],
        fixed: &[String],
        start: &BTreeMap<String, f64>,
    ) -> anyhow::Result<Self> {
        for name in fixed.iter().chain(start.keys()) {
            ensure!(
                parameters.iter().any(|parameter| parameter.name.as_str() == name),
                "{name}: the plugin has no such parameter; it has {}",
                parameters.iter().map(|parameter| parameter.name.as_str()).collect::<Vec<_>>().join(", ")
            );
        }
        let mut space = Self { searched: Vec::new(), held: Vec::new(), start: Vec::new() };
        for parameter in parameters {
            let name = parameter.name.as_str();
            let value = start.get(name).copied().unwrap_or(parameter.default);
            let (min, max) = (parameter.range.min, parameter.range.max);
            ensure!((min..=max).contains(&value), "{name}: found {value}, wanted {min} to {max}");
            if fixed.iter().any(|fixed| fixed == name) {
                space.held.push((name.to_owned(), value));
            } else {
                space.start.push(to_unit(parameter, value));
                space.searched.push(parameter.clone());
            }
        }
        Ok(space)
    }

    /// Where the search starts, in units.
    pub(super) fn start(&self) -> Vec<f64> {
        self.start.clone()
    }

    /// Parameter text for a point; a coordinate outside 0…1 is taken at its nearest bound.
    pub(super) fn text(&self, point: &[f64]) -> String {
        let mut text = String::new();
        let searched =
            self.searched.iter().zip(point).map(|(parameter, unit)| {
                (parameter.name.as_str(), from_unit(parameter, unit.clamp(0.0, 1.0)))
            });
        let held = self.held.iter().map(|(name, value)| (name.as_str(), *value));
        for (name, value) in searched.chain(held) {
            // Five digits are below what any of these numbers is good for, and keep the file readable.
            let _ = writeln!(text, "{name} = {:?}", round(value));
        }
        text
    }

    /// How far outside the bounds a point lies, squared.
    pub(super) fn excess(point: &[f64]) -> f64 {
        point.iter().map(|unit| unit - unit.clamp(0.0, 1.0)).map(|outside| outside * outside).sum()
    }
}

fn to_unit(parameter: &Parameter, value: f64) -> f64 {
    let (min, max) = (parameter.range.min, parameter.range.max);
    match parameter.scale {
        Scale::Linear => (value - min) / (max - min),
        Scale::Log => (value / min).ln() / (max / min).ln(),
    }
}

fn from_unit(parameter: &Parameter, unit: f64) -> f64 {
    let (min, max) = (parameter.range.min, parameter.range.max);
    let value = match parameter.scale {
        Scale::Linear => min + unit * (max - min),
        Scale::Log => min * (unit * (max / min).ln()).exp(),
    };
    value.clamp(min, max)
}

/// Five significant digits.
fn round(value: f64) -> f64 {
    format!("{value:.4e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_plugin_api::Range;

    fn parameters() -> Vec<Parameter> {
        let parameter = |name: &str, min, max, default, scale| Parameter {
            name: name.into(),
            unit: "1".into(),
            default,
            range: Range { min, max },
            scale,
        };
        vec![
            parameter("period_s", 0.4, 0.8, 0.5, Scale::Linear),
            parameter("gain", 1.0, 100.0, 10.0, Scale::Log),
            parameter("held", 0.0, 1.0, 0.25, Scale::Linear),
        ]
    }

    #[test]
    fn a_point_becomes_values_inside_their_ranges() {
        let space = Space::new(&parameters(), &["held".into()], &BTreeMap::new()).unwrap();
        assert_eq!(space.start().len(), 2);
        assert!((space.start()[1] - 0.5).abs() < 1e-12, "10 is half-way from 1 to 100 on a log scale");
        assert_eq!(space.text(&[0.0, 2.0]), "period_s = 0.4\ngain = 100.0\nheld = 0.25\n");
        assert!((Space::excess(&[0.5, 2.0]) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn an_unknown_name_is_refused() {
        let error = Space::new(&parameters(), &["perriod_s".into()], &BTreeMap::new()).err().unwrap();
        assert!(error.to_string().contains("perriod_s") && error.to_string().contains("period_s"));
    }
}
