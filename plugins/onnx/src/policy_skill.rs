//! A policy network as a skill.

use vocaloco_plugin_api::abi::abi_stable::std_types::{RNone, RVec};
use vocaloco_plugin_api::action::ActionMap;
use vocaloco_plugin_api::contract::Contract;
use vocaloco_plugin_api::observation::Observer;
use vocaloco_plugin_api::{
    Command, CommandKind, Description, ErrorCode, Host, JointTarget, Needs, Parameter, Policy, Range,
    RobotDescription, RobotState, Scale, Skill, SkillError,
};

const RATE_HZ: f64 = 50.0;

/// One instance: its contract on the robot, its handle to the network, and what it remembers.
pub struct PolicySkill {
    observer: Observer,
    actions: ActionMap,
    policy: Policy,
    command: CommandKind,
    observation: Vec<f32>,
    action: Vec<f32>,
    last_action: Vec<f32>,
}

impl Skill for PolicySkill {
    fn describe() -> Description {
        Description {
            name: "onnx".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            summary: "Runs a policy network by its manifest's contract".into(),
            joints: RVec::new(),
            rate_hz: RATE_HZ,
            command: CommandKind::Velocity,
            // What a policy follows, and how fast, is its contract's and its manifest's to say.
            forward_m_per_s: Range { min: -5.0, max: 5.0 },
            needs: Needs { policy: true, terrain: RNone, foot_contacts: false, joint_torques: false },
            parameters: RVec::from(vec![Parameter {
                name: "initial_phase".into(),
                unit: "1".into(),
                default: 0.0,
                range: Range { min: 0.0, max: 1.0 },
                scale: Scale::Linear,
            }]),
        }
    }

    fn create(parameters: &str, robot: &RobotDescription, host: Host) -> Result<Self, SkillError> {
        let refuse = |message: String| SkillError::new(ErrorCode::Parameters, message);
        let contract: Contract =
            toml::from_str(parameters).map_err(|error| refuse(format!("contract: {}", error.message())))?;
        if (contract.rate_hz - RATE_HZ).abs() > 1e-9 {
            return Err(refuse(format!("rate_hz: found {}, wanted {RATE_HZ}", contract.rate_hz)));
        }
        let observer = Observer::new(&contract, robot)?;
        let actions = ActionMap::new(&contract, robot)?;
        let policy =
            host.into_policy().ok_or_else(|| refuse("policy: found nothing, wanted a network".to_owned()))?;
        for (field, found, wanted, side) in [
            ("observation", observer.len(), policy.input_len(), "input"),
            ("joints", actions.len(), policy.output_len(), "output"),
        ] {
            if found != wanted {
                let message = format!("{field}: found {found} values, wanted {wanted}, the policy's {side}");
                return Err(refuse(message));
            }
        }
        Ok(Self {
            command: contract.command()?,
            observation: vec![0.0; observer.len()],
            action: vec![0.0; actions.len()],
            last_action: vec![0.0; actions.len()],
            observer,
            actions,
            policy,
        })
    }

    fn needs(&self) -> Needs {
        self.observer.needs()
    }

    fn reset(&mut self, _state: &RobotState<'_>) -> Result<(), SkillError> {
        self.observer.reset();
        self.last_action.fill(0.0);
        Ok(())
    }

    fn act(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), SkillError> {
        let input = |message: String| SkillError::new(ErrorCode::Input, message);
        let asked = match self.command {
            CommandKind::Velocity => command.velocity.as_slice(),
            CommandKind::PositionTarget => command.target.as_slice(),
        };
        if command.kind != self.command || !asked.iter().all(|value| value.is_finite()) {
            let (found, wanted) = (command.kind.name(), self.command.name());
            return Err(input(format!("command: found {found} {asked:?}, wanted a finite {wanted}")));
        }
        if joints.len() != self.actions.len() {
            let (found, wanted) = (joints.len(), self.actions.len());
            return Err(input(format!("joint targets: found {found}, wanted {wanted}")));
        }
        self.observer.write(state, command, &self.last_action, &mut self.observation)?;
        if let Some(index) = self.observation.iter().position(|value| !value.is_finite()) {
            return Err(input(format!("observation[{index}]: found NaN, wanted a number")));
        }
        self.policy.run(&self.observation, &mut self.action)?;
        self.actions.clip(&mut self.action);
        self.actions.targets(&self.action, joints);
        self.last_action.copy_from_slice(&self.action);
        Ok(())
    }
}
