//! What a bridge sends.

use serde_json::{Value, json};

/// A sound line of the shipped robot at a tick, standing on flat ground.
pub fn standing_line(tick: u32) -> Value {
    let t_s = f64::from(tick) / 50.0;
    let joints: Vec<String> = ["LF", "RF", "LH", "RH"]
        .iter()
        .flat_map(|leg| ["HAA", "HFE", "KFE"].map(|joint| format!("{leg}_{joint}")))
        .collect();
    let stand = |name: &str| match (name.ends_with("HFE"), name.ends_with("KFE"), name.as_bytes()[1] == b'F')
    {
        (true, _, true) => 0.4,
        (true, _, false) => -0.4,
        (_, true, true) => -0.8,
        (_, true, false) => 0.8,
        _ => 0.0,
    };
    let by_joint = |value: &dyn Fn(&str) -> f64| {
        Value::Object(joints.iter().map(|name| (name.clone(), json!(value(name)))).collect())
    };
    let row = vec![json!(-0.53); 29];
    json!({
        "t_s": t_s,
        "joint_position_rad": by_joint(&stand),
        "joint_velocity_rad_per_s": by_joint(&|_| 0.0),
        "joint_torque_nm": by_joint(&|_| 0.0),
        "foot_contact": {"LF_FOOT": true, "RF_FOOT": true, "LH_FOOT": true, "RH_FOOT": true},
        "base_linear_velocity_m_per_s": [0, 0, 0],
        "base_angular_velocity_rad_per_s": [0, 0, 0],
        "projected_gravity": [0, 0, -1],
        "elevation": {"t_s": t_s, "resolution_m": 0.05, "back_m": 1.2, "front_m": 2.2, "half_width_m": 0.7,
                      "height_m": vec![row; 69]},
        "command": {"velocity": [0.6, 0.0, 0.0]},
    })
}
