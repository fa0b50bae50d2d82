//! A small quadruped for unit tests, asymmetric on purpose.

use vocaloco_plugin_api::{FootDescription, JointDescription, RobotDescription};

pub(crate) fn quadruped() -> RobotDescription {
    let mut joints = Vec::new();
    let mut feet = Vec::new();
    for (name, x, y) in [("LF", 0.3, 0.1), ("RF", 0.3, -0.1), ("LH", -0.31, 0.1), ("RH", -0.31, -0.1)] {
        let (fore, side) = (f64::signum(x), f64::signum(y));
        let first = i32::try_from(joints.len()).unwrap();
        let mut joint =
            |suffix: &str, parent: i32, origin: [f64; 3], axis: [f64; 3], stand: f64, mass: f64| {
                joints.push(JointDescription {
                    name: format!("{name}_{suffix}").into(),
                    parent,
                    origin_in_parent_m: origin,
                    axis,
                    lower_rad: -2.6,
                    upper_rad: 2.6,
                    effort_nm: 80.0,
                    velocity_limit_rad_per_s: 8.5,
                    stand_rad: stand,
                    mass_kg: mass,
                    com_in_link_m: [0.01, 0.02 * side, -0.05],
                });
            };
        joint("HAA", -1, [x, y, 0.0], [1.0, 0.0, 0.0], 0.02, 2.0);
        joint("HFE", first, [0.06 * fore, 0.01 * side, 0.0], [0.0, 1.0, 0.0], 0.4 * fore, 3.0);
        joint("KFE", first + 1, [0.0, 0.18 * side, -0.285], [0.0, 1.0, 0.0], -0.8 * fore, 0.8);
        feet.push(FootDescription {
            name: format!("{name}_FOOT").into(),
            joint: u32::try_from(first + 2).unwrap(),
            centre_in_link_m: [0.1 * fore, -0.02 * side, -0.3],
            radius_m: 0.03,
        });
    }
    RobotDescription {
        name: "quadruped".into(),
        mass_kg: 50.0,
        base_mass_kg: 26.8,
        stand_height_m: 0.55,
        joints: joints.into(),
        feet: feet.into(),
    }
}
