//! A robot, stand-in skills and a loop for tests.

use std::path::Path;
use std::sync::{Arc, Condvar, Mutex};

use abi_stable::std_types::ROption;
use vocaloco_plugin_api::{Command, CommandKind, ErrorCode, Needs, RobotState, SkillError, TerrainPatch};

use super::*;
use crate::elevation::Elevation;
use crate::heightfield::Field;
use crate::manifest::CommandRange;
use crate::selector::Rule;

pub(crate) const FORWARD: Command = Command::velocity(0.6, 0.0, 0.0);

pub(crate) fn robot() -> Arc<RobotModel> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
    Arc::new(RobotModel::load(&folder, "anymal_d").unwrap())
}

/// What the stand-in plugin does next, and what it was called with; shared with the test.
#[derive(Default)]
pub(crate) struct Script {
    pub(crate) prediction: Option<(f32, f32)>,
    pub(crate) act: Option<fn(&mut [JointTarget])>,
    pub(crate) reset: Option<fn()>,
    pub(crate) fails: bool,
    pub(crate) reset_fails: bool,
    pub(crate) resets: usize,
    pub(crate) acts: usize,
    pub(crate) terrain: Vec<f32>,
    pub(crate) told: Option<Command>,
    pub(crate) act_hangs: Option<Gate>,
    pub(crate) predict_hangs: Option<Gate>,
}

/// What a hanging call waits for.
#[derive(Clone, Default)]
pub(crate) struct Gate(Arc<(Mutex<bool>, Condvar)>);

impl Gate {
    fn wait(&self) {
        let (is_open, changed) = &*self.0;
        drop(changed.wait_while(is_open.lock().unwrap(), |is_open| !*is_open).unwrap());
    }

    pub(crate) fn open(&self) {
        *self.0.0.lock().unwrap() = true;
        self.0.1.notify_all();
    }
}

#[derive(Clone, Default)]
pub(crate) struct Fake(Arc<Mutex<Script>>);

impl Fake {
    pub(crate) fn with<T>(&self, change: impl FnOnce(&mut Script) -> T) -> T {
        change(&mut self.0.lock().unwrap())
    }
}

impl Controller for Fake {
    fn reset(&mut self, _: &RobotState<'_>) -> Result<(), CallFault> {
        self.with(|script| {
            script.resets += 1;
            if let Some(reset) = script.reset {
                reset();
            }
            if script.reset_fails { Err(CallFault::Failed("no start".into())) } else { Ok(()) }
        })
    }

    fn act(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), CallFault> {
        let hangs = self.with(|script| script.act_hangs.clone());
        hangs.iter().for_each(Gate::wait);
        self.with(|script| {
            script.acts += 1;
            script.terrain = state.terrain_m.to_vec();
            script.told = Some(*command);
            if script.fails {
                return Err(SkillError::new(ErrorCode::Panic, "act panicked: out of cheese").into());
            }
            for (target, position) in joints.iter_mut().zip(state.joint_position_rad.iter()) {
                *target = JointTarget {
                    position_rad: *position,
                    stiffness_nm_per_rad: 77.0,
                    damping_nms_per_rad: 3.0,
                    feed_forward_nm: 0.0,
                };
            }
            if let Some(spoil) = script.act {
                spoil(joints);
            }
            Ok(())
        })
    }
}

impl Predict for Fake {
    fn predict(&mut self, _: &Field) -> (Prediction, Option<CallFault>) {
        let hangs = self.with(|script| script.predict_hangs.clone());
        hangs.iter().for_each(Gate::wait);
        let (viability, cot) = self.with(|script| script.prediction.unwrap());
        (Prediction::of(viability, cot), None)
    }
}

pub(crate) fn fake(viability: f32, cot: f32) -> Fake {
    let fake = Fake::default();
    fake.with(|script| script.prediction = Some((viability, cot)));
    fake
}

pub(crate) fn skill(name: &str, fake: &Fake) -> Skill {
    let patch = TerrainPatch { back_m: 0.2, front_m: 0.4, half_width_m: 0.1, resolution_m: 0.1 };
    Skill {
        rule: Rule {
            name: name.into(),
            viability_threshold: 0.95,
            hold_threshold: 0.95,
            cost_margin: 0.0,
            command: CommandRange {
                kind: CommandKind::Velocity,
                forward_m_per_s: [0.4, 0.7],
                target_distance_m: None,
            },
            time_limit_s: 4.0,
            committed: false,
        },
        needs: Needs {
            policy: false,
            terrain: ROption::RSome(patch),
            foot_contacts: true,
            joint_torques: false,
        },
        controller: Box::new(fake.clone()),
        predictors: Box::new(fake.clone()),
    }
}

/// A loop of 50 Hz with its skills and its time.
pub(crate) struct Loop {
    pub(crate) runtime: Runtime,
    pub(crate) observation: Observation,
}

impl Loop {
    pub(crate) fn new(skills: Vec<Skill>) -> Self {
        let config = RuntimeConfig::of(Windows { switch: 10, stop: 10, resume: 25 });
        let robot = robot();
        let position = robot.stand_position_rad();
        let observation = Observation {
            t_s: 0.0,
            joint_velocity_rad_per_s: vec![0.0; position.len()],
            joint_torque_nm: None,
            foot_contact: Some(vec![true, false, false, true]),
            base_linear_velocity: [0.0; 3],
            base_angular_velocity: [0.0; 3],
            projected_gravity: [0.0, 0.0, -1.0],
            base_in_odom: None,
            elevation: Some(ramp()),
            command: FORWARD,
            field_noise: None,
            heightfield: None,
            joint_position_rad: position,
        };
        Self { runtime: Runtime::from_skills(config, robot, skills), observation }
    }

    /// One tick with fresh terrain.
    pub(crate) fn tick(&mut self) -> Decision {
        // Whole hundredths, whose decimals come back from a log bit for bit.
        let t_s = ((self.observation.t_s * 50.0).round() + 1.0) / 50.0;
        self.observation.t_s = t_s;
        if let Some(elevation) = &mut self.observation.elevation {
            elevation.t_s = t_s;
        }
        self.runtime.tick(&self.observation).decision.clone()
    }

    /// The last of `ticks` ticks.
    pub(crate) fn ticks(&mut self, ticks: usize) -> Decision {
        (1..ticks).for_each(|_| drop(self.tick()));
        self.tick()
    }

    /// The number of ticks until `active` drives.
    pub(crate) fn until(&mut self, active: &str) -> usize {
        (1..200).find(|_| self.tick().active == active).unwrap_or(usize::MAX)
    }

    pub(crate) fn stands_with_stand_gains(&self) -> bool {
        self.runtime
            .joints
            .iter()
            .all(|joint| joint.stiffness_nm_per_rad >= robot().stand.stiffness_nm_per_rad)
    }
}

/// Rising to the front and, less so, to the left.
pub(crate) fn ramp() -> Elevation {
    let mut elevation = Elevation {
        t_s: 0.0,
        resolution_m: 0.1,
        back_m: 1.0,
        front_m: 2.0,
        half_width_m: 0.5,
        height_m: Vec::new(),
    };
    for i in 0..31 {
        for j in 0..11 {
            elevation.height_m.push(0.02 * i as f32 - 0.005 * j as f32 - 0.55);
        }
    }
    elevation
}
