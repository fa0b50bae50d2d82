//! The tunable numbers of the gait: one table that is the default, the description for an optimiser
//! and the check of a parameter file.

use serde::Deserialize;
use vocaloco_plugin_api::{ErrorCode, Parameter, Range, Scale, SkillError};

macro_rules! parameters {
    ($($name:ident: $default:literal in $min:literal..=$max:literal, $unit:literal, $scale:ident, $about:literal;)*) => {
        /// One number of each kind; see each field for its meaning.
        #[derive(Clone, Debug, PartialEq, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub(crate) struct Parameters {
            $(#[doc = $about] pub(crate) $name: f64,)*
        }

        impl Default for Parameters {
            fn default() -> Self {
                Self { $($name: $default,)* }
            }
        }

        impl Parameters {
            /// Every number as an optimiser sees it.
            pub(crate) fn table() -> Vec<Parameter> {
                vec![$(Parameter {
                    name: stringify!($name).into(),
                    unit: $unit.into(),
                    default: $default,
                    range: Range { min: $min, max: $max },
                    scale: Scale::$scale,
                },)*]
            }

            fn check(&self) -> Result<(), SkillError> {
                // Phrased as "is inside", so NaN is refused too.
                $(if !($min..=$max).contains(&self.$name) {
                    return Err(SkillError::new(ErrorCode::Parameters, format!(
                        "{}: found {}, wanted {} to {} {}",
                        stringify!($name), self.$name, $min, $max, $unit,
                    )));
                })*
                Ok(())
            }
        }
    };
}

parameters! {
    initial_phase: 0.0 in 0.0..=1.0, "1", Linear, "Phase of the gait when the skill becomes active.";
    period_s: 0.48 in 0.36..=0.8, "s", Log, "Duration of one gait cycle.";
    rise_s: 0.2 in 0.0..=0.8, "s", Linear, "Longest time on four feet at the start, until height and pitch are right.";
    duty: 0.56 in 0.42..=0.7, "1", Linear, "Share of the cycle that a foot is planned to stand.";
    hurry: 0.0 in 0.0..=1.5, "1", Linear, "Quickening of the cycle per velocity error of 1 m/s.";
    pace: 1.0 in 0.7..=1.3, "1", Linear, "Forward velocity aimed at, per commanded velocity.";
    uphill_pace: 0.0 in -0.6..=0.3, "1", Linear, "Change of the pace per rise per metre.";
    downhill_pace: 0.0 in -0.6..=0.3, "1", Linear, "Change of the pace per fall per metre.";
    wait: 0.0 in 0.0..=1.0, "1", Linear, "How much of its velocity the body gives up while a foot is held before an edge.";
    acceleration_m_per_s2: 1.5 in 0.5..=4.0, "m/s²", Log, "How fast the aimed velocity may change.";
    base_height_m: 0.51 in 0.42..=0.62, "m", Linear, "Base origin above the line fitted to the terrain.";
    fit_half_length_m: 0.36 in 0.25..=0.6, "m", Linear, "Half the length of terrain that the line is fitted to.";
    fit_ahead_m: 0.0 in -0.15..=0.25, "m", Linear, "Centre of that length ahead of the base.";
    pitch_follow: 0.9 in 0.3..=1.2, "1", Linear, "Body pitch per slope of the fitted line.";
    belly_m: 0.24 in 0.12..=0.42, "m", Linear, "Distance that the base's origin, seen along the base, keeps above the ground under and before it.";
    belly_ahead_m: 0.15 in 0.0..=0.4, "m", Linear, "How far before the fore hips that ground reaches.";
    belly_pitch: 0.5 in 0.0..=1.5, "1", Linear, "Share of a want of that distance at one end that is made up by pitching.";
    attitude_share: 0.6 in 0.0..=1.0, "1", Linear, "Share of the attitude error put into the stance legs' targets.";
    height_share: 0.4 in 0.0..=1.0, "1", Linear, "Share of the height error put into the stance legs' targets.";
    stance_stiffness: 90.0 in 30.0..=200.0, "N·m/rad", Log, "Stiffness of a standing leg.";
    stance_damping: 3.5 in 1.0..=14.0, "N·m·s/rad", Log, "Damping of a standing leg.";
    swing_stiffness: 120.0 in 30.0..=250.0, "N·m/rad", Log, "Stiffness of a swinging leg.";
    swing_damping: 3.0 in 1.0..=14.0, "N·m·s/rad", Log, "Damping of a swinging leg.";
    weight_share: 1.0 in 0.4..=1.2, "1", Linear, "Share of the weight carried by feed-forward.";
    height_gain: 60.0 in 5.0..=250.0, "1/s²", Log, "Vertical acceleration per height error.";
    height_rate_gain: 10.0 in 1.0..=30.0, "1/s", Log, "Vertical acceleration per vertical velocity error.";
    forward_gain: 7.0 in 0.5..=15.0, "1/s", Log, "Forward acceleration per velocity error.";
    sideways_gain: 4.0 in 0.2..=15.0, "1/s", Log, "Sideways acceleration per velocity error.";
    roll_gain: 120.0 in 10.0..=500.0, "1/s²", Log, "Roll acceleration per roll error.";
    roll_rate_gain: 15.0 in 2.0..=50.0, "1/s", Log, "Roll acceleration per roll rate.";
    pitch_gain: 120.0 in 10.0..=500.0, "1/s²", Log, "Pitch acceleration per pitch error.";
    pitch_rate_gain: 15.0 in 2.0..=50.0, "1/s", Log, "Pitch acceleration per pitch rate.";
    yaw_rate_gain: 8.0 in 1.0..=30.0, "1/s", Log, "Yaw acceleration per yaw rate error.";
    step_velocity_gain_s: 0.08 in 0.0..=0.3, "s", Linear, "Foothold shift per velocity error.";
    step_ahead: 0.42 in 0.2..=0.8, "1", Linear, "Share of a stance's travel that the foot lands ahead of its hip.";
    fore_offset_m: 0.0 in -0.18..=0.2, "m", Linear, "Fore footholds ahead of their hips.";
    hind_offset_m: 0.0 in -0.15..=0.15, "m", Linear, "Hind footholds ahead of their hips.";
    width_offset_m: -0.03 in -0.12..=0.06, "m", Linear, "Footholds outward of their hips.";
    slope_shift: 0.5 in -0.5..=1.5, "1", Linear, "Footholds moved downhill, per slope and base height.";
    drop_margin_m: 0.06 in 0.0..=0.12, "m", Linear, "Distance kept from an edge that drops.";
    riser_margin_m: 0.12 in 0.0..=0.2, "m", Linear, "Distance that fore feet keep from a riser ahead.";
    hind_riser_margin_m: 0.12 in 0.0..=0.2, "m", Linear, "Distance that hind feet keep from a riser ahead.";
    heel_margin_m: 0.05 in 0.0..=0.16, "m", Linear, "Distance that fore feet keep from a riser behind.";
    hind_heel_margin_m: 0.05 in 0.0..=0.16, "m", Linear, "Distance that hind feet keep from a riser behind.";
    edge_weight: 3.0 in 0.3..=60.0, "1", Log, "How much a margin counts against leaving the nominal foothold.";
    search_m: 0.16 in 0.04..=0.28, "m", Linear, "How far the foothold may move from the nominal one.";
    reach_weight: 0.0 in 0.0..=60.0, "1", Linear, "How much a foothold counts that the leg will not reach.";
    keep_weight: 0.3 in 0.02..=3.0, "1", Log, "How much the foothold sticks to the one chosen before.";
    clearance_m: 0.07 in 0.03..=0.16, "m", Linear, "Height of the swing above the highest ground it crosses.";
    lift_share: 0.25 in 0.1..=0.45, "1", Linear, "Share of the swing in which the foot rises.";
    lower_share: 0.3 in 0.1..=0.5, "1", Linear, "Share of the swing in which the foot descends.";
    travel_start: 0.1 in 0.0..=0.4, "1", Linear, "Share of the swing after which the foot travels.";
    travel_end: 0.85 in 0.6..=1.0, "1", Linear, "Share of the swing at which the foot is above its foothold.";
    gate_m: 0.02 in -0.03..=0.08, "m", Linear, "How far a swinging foot must be above ground ahead of it to travel on.";
    line_trust: 1.0 in 0.1..=1.0, "1", Log, "Share of each fitted line of the terrain that enters the estimate.";
    press_m: 0.02 in 0.0..=0.06, "m", Linear, "Depth below the ground that a landing foot aims at.";
    search_speed_m_per_s: 0.5 in 0.1..=1.2, "m/s", Log, "Speed at which a foot that missed the ground goes on down.";
    attitude_trust: 0.3 in 0.05..=1.0, "1", Log, "Share of each measured attitude that corrects the integrated one.";
    velocity_trust: 0.5 in 0.1..=1.0, "1", Log, "Share of each measured velocity that enters the estimate.";
    velocity_follow: 0.7 in 0.0..=1.0, "1", Linear, "Share of the measured velocity, against the aimed one, in planning footholds.";
}

impl Parameters {
    /// Reads a parameter file; what it leaves out has its default.
    pub(crate) fn parse(text: &str) -> Result<Self, SkillError> {
        let parameters: Self = toml::from_str(text)
            .map_err(|error| SkillError::new(ErrorCode::Parameters, error.to_string().replace('\n', " ")))?;
        parameters.check()?;
        Ok(parameters)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_inside_their_ranges() {
        Parameters::default().check().unwrap();
    }

    #[test]
    fn an_unknown_parameter_is_refused_by_name() {
        let error = Parameters::parse("perriod_s = 0.5").unwrap_err();
        assert!(error.message.contains("perriod_s"), "{error}");
    }

    #[test]
    fn a_value_outside_its_range_or_nan_is_refused() {
        for text in ["duty = 0.2", "duty = nan"] {
            let error = Parameters::parse(text).unwrap_err();
            assert!(error.message.contains("duty") && error.message.contains("0.42 to 0.7"), "{error}");
        }
    }
}
