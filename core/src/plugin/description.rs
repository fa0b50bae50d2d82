//! Whether what a plugin says of itself makes sense: the host sizes buffers by it and an optimiser
//! searches by it.

use std::path::Path;

use vocaloco_plugin_api::{Description, Needs, Parameter, Range, Scale, TerrainPatch};

use crate::manifest::{Finding, is_snake_case};

pub(super) fn check(file: &Path, description: &Description) -> Result<(), Finding> {
    let finding = |field: &str, found: String, wanted: &str| Err(Finding::new(file, field, found, wanted));
    if !is_snake_case(&description.name) {
        return finding("name", format!("{:?}", description.name.as_str()), "a name in snake_case");
    }
    if !(1.0..=1000.0).contains(&description.rate_hz) {
        return finding("rate_hz", description.rate_hz.to_string(), "1 to 1000 Hz");
    }
    if !sound(description.forward_m_per_s) {
        let found = format!("{:?}", description.forward_m_per_s);
        return finding("forward_m_per_s", found, "finite numbers, the smaller first");
    }
    for (index, joint) in description.joints.iter().enumerate() {
        if description.joints[..index].contains(joint) {
            return finding("joints", format!("{joint} twice"), "every joint once");
        }
    }
    check_needs(file, &description.needs)?;
    for (index, parameter) in description.parameters.iter().enumerate() {
        let field = format!("parameters.{}", parameter.name);
        if description.parameters[..index].iter().any(|earlier| earlier.name == parameter.name) {
            return finding(&field, "it twice".into(), "every parameter once");
        }
        if !parameter_is_sound(parameter) {
            let wanted = "a name, a default inside min to max, min above 0 on a log scale";
            return finding(&field, format!("{parameter:?}"), wanted);
        }
    }
    Ok(())
}

/// What an instance needs may differ from what the plugin declares, and sizes buffers too.
pub(super) fn check_needs(file: &Path, needs: &Needs) -> Result<(), Finding> {
    if let Some(patch) = needs.terrain.as_ref().into_option()
        && !patch_is_sound(patch)
    {
        let wanted = "0 to 3 m each way with points every 1 to 20 cm";
        return Err(Finding::new(file, "needs.terrain", format!("{patch:?}"), wanted));
    }
    Ok(())
}

// Phrased as "is inside" throughout, so that NaN is refused too.
fn sound(range: Range) -> bool {
    range.min.is_finite() && range.max.is_finite() && range.min <= range.max
}

fn patch_is_sound(patch: &TerrainPatch) -> bool {
    let lengths = [patch.back_m, patch.front_m, patch.half_width_m];
    lengths.iter().all(|length| (0.0..=3.0).contains(length)) && (0.01..=0.2).contains(&patch.resolution_m)
}

fn parameter_is_sound(parameter: &Parameter) -> bool {
    let Range { min, max } = parameter.range;
    !parameter.name.is_empty()
        && sound(parameter.range)
        && (min..=max).contains(&parameter.default)
        && (parameter.scale == Scale::Linear || min > 0.0)
}

#[cfg(test)]
mod tests {
    use abi_stable::std_types::{RSome, RVec};
    use vocaloco_plugin_api::CommandKind;

    use super::*;

    fn description() -> Description {
        Description {
            name: "trot".into(),
            version: "0.1.0".into(),
            summary: "Trots".into(),
            joints: RVec::from(vec!["LF_HAA".into(), "RH_KFE".into()]),
            rate_hz: 50.0,
            command: CommandKind::Velocity,
            forward_m_per_s: Range { min: -0.2, max: 0.7 },
            needs: Needs {
                policy: false,
                terrain: RSome(TerrainPatch {
                    back_m: 0.7,
                    front_m: 1.3,
                    half_width_m: 0.4,
                    resolution_m: 0.05,
                }),
                foot_contacts: true,
                joint_torques: false,
            },
            parameters: RVec::from(vec![Parameter {
                name: "period_s".into(),
                unit: "s".into(),
                default: 0.5,
                range: Range { min: 0.3, max: 0.8 },
                scale: Scale::Log,
            }]),
        }
    }

    fn refused_field(spoil: impl FnOnce(&mut Description)) -> String {
        let mut description = description();
        spoil(&mut description);
        check(Path::new("libtrot.so"), &description).expect_err("refused").field
    }

    #[test]
    fn a_sound_description_passes() {
        check(Path::new("libtrot.so"), &description()).expect("sound");
    }

    #[test]
    fn nan_and_nonsense_are_refused_by_field() {
        assert_eq!(refused_field(|it| it.rate_hz = f64::NAN), "rate_hz");
        assert_eq!(refused_field(|it| it.name = "../trot".into()), "name");
        assert_eq!(refused_field(|it| it.forward_m_per_s.max = f64::NAN), "forward_m_per_s");
        assert_eq!(refused_field(|it| it.joints[1] = "LF_HAA".into()), "joints");
        assert_eq!(refused_field(|it| it.parameters[0].default = 0.9), "parameters.period_s");
        assert_eq!(refused_field(|it| it.parameters[0].range.min = 0.0), "parameters.period_s");
        let endless = |it: &mut Description| {
            if let RSome(patch) = &mut it.needs.terrain {
                patch.resolution_m = 0.0;
            }
        };
        assert_eq!(refused_field(endless), "needs.terrain");
    }
}
