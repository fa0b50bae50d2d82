//! The plugin `template_skill`: holds the robot's stand. Replace what `act` does; the contract test beside it
//! says what the host relies on.

use serde::Deserialize;
use vocaloco_plugin_api::abi::abi_stable::std_types::{RNone, RVec};
use vocaloco_plugin_api::{
    Command, CommandKind, Description, ErrorCode, Host, JointTarget, Needs, Parameter, Range, RobotDescription,
    RobotState, Scale, Skill, SkillError,
};

const STIFFNESS: Range = Range { min: 10.0, max: 200.0 };
const DAMPING: Range = Range { min: 0.5, max: 10.0 };

/// What a parameter file may hold.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Parameters {
    stiffness_nm_per_rad: f64,
    damping_nms_per_rad: f64,
}

impl Default for Parameters {
    fn default() -> Self {
        Self { stiffness_nm_per_rad: 80.0, damping_nms_per_rad: 2.0 }
    }
}

/// The controller of one robot.
#[derive(Clone, Debug)]
pub struct TemplateSkill {
    parameters: Parameters,
    stand_rad: Vec<f32>,
}

impl Skill for TemplateSkill {
    fn describe() -> Description {
        let default = Parameters::default();
        let parameter = |name: &str, unit: &str, default, range| Parameter {
            name: name.into(),
            unit: unit.into(),
            default,
            range,
            scale: Scale::Log,
        };
        Description {
            name: "template_skill".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            summary: "Holds the stand".into(),
            // Empty: it takes whatever joints the robot has.
            joints: RVec::new(),
            rate_hz: 50.0,
            command: CommandKind::Velocity,
            forward_m_per_s: Range { min: 0.0, max: 0.7 },
            // Terrain heights, foot contacts and torques are given to those who ask.
            needs: Needs { policy: false, terrain: RNone, foot_contacts: false, joint_torques: false },
            // What an optimiser may search.
            parameters: RVec::from(vec![
                parameter("stiffness_nm_per_rad", "N·m/rad", default.stiffness_nm_per_rad, STIFFNESS),
                parameter("damping_nms_per_rad", "N·m·s/rad", default.damping_nms_per_rad, DAMPING),
            ]),
        }
    }

    fn create(parameters: &str, robot: &RobotDescription, _host: Host) -> Result<Self, SkillError> {
        let refuse = |message: String| SkillError::new(ErrorCode::Parameters, message);
        let parameters: Parameters =
            toml::from_str(parameters).map_err(|error| refuse(error.message().to_owned()))?;
        let fields = [
            ("stiffness_nm_per_rad", parameters.stiffness_nm_per_rad, STIFFNESS),
            ("damping_nms_per_rad", parameters.damping_nms_per_rad, DAMPING),
        ];
        for (field, found, Range { min, max }) in fields {
            // Phrased as "is inside", so NaN is refused too.
            if !(min..=max).contains(&found) {
                return Err(refuse(format!("{field}: found {found}, wanted {min} to {max}")));
            }
        }
        Ok(Self { parameters, stand_rad: robot.joints.iter().map(|joint| joint.stand_rad as f32).collect() })
    }

    fn reset(&mut self, _state: &RobotState<'_>) -> Result<(), SkillError> {
        // Forget everything that `act` remembers: the host calls this when the skill becomes active.
        Ok(())
    }

    fn act(
        &mut self,
        _state: &RobotState<'_>,
        _command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), SkillError> {
        // No allocation, no randomness, no clock: the same inputs since `reset` give the same bytes.
        for (joint, position_rad) in joints.iter_mut().zip(&self.stand_rad) {
            *joint = JointTarget {
                position_rad: *position_rad,
                stiffness_nm_per_rad: self.parameters.stiffness_nm_per_rad as f32,
                damping_nms_per_rad: self.parameters.damping_nms_per_rad as f32,
                feed_forward_nm: 0.0,
            };
        }
        Ok(())
    }
}

vocaloco_plugin_api::export_skill!(TemplateSkill);
