//! The robot in MuJoCo, driven as rapier's plant is.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use serde::{Deserialize, Serialize};
use vocaloco_core::robot::{RobotModel, Role};
use vocaloco_plugin_api::JointTarget;

use super::{TransferError, ground::Ground, link::Link};
use crate::{
    physics::Physics,
    plant::{BasePose, Measurement, PlantKind, Variation, Work, speed},
    terrain::Terrain,
};

/// MuJoCo's steps to one of ours, as many as the reference plant takes.
pub const SUBSTEPS: usize = PlantKind::Reference.engine().iterations;

/// A Python interpreter that has the package `mujoco`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interpreter(pub String);

impl Default for Interpreter {
    fn default() -> Self {
        Self("python3".to_owned())
    }
}

/// A robot on a terrain in MuJoCo.
///
/// A process that fails leaves a measurement that is not a number, so that a rollout ends as a fault;
/// [`check`](Self::check) says why.
pub struct MujocoPlant {
    robot: Arc<RobotModel>,
    link: Link,
    version: String,
    variation: Variation,
    measurement: Measurement,
    velocity_before: Vec<f32>,
    work: Work,
    failure: Option<TransferError>,
}

#[derive(Serialize)]
#[serde(tag = "do", rename_all = "snake_case")]
enum Question<'a> {
    Open {
        model: &'a Path,
        substeps: usize,
        joints: Vec<&'a str>,
        feet: Vec<&'a str>,
        base_shapes: Vec<&'a str>,
    },
    Terrain {
        solids: Vec<Ground<'a>>,
    },
    Place {
        position_m: [f32; 3],
        orientation_xyzw: [f32; 4],
        joint_position_rad: &'a [f32],
    },
    Vary {
        friction: f32,
        base_mass_offset_kg: f32,
    },
    Push {
        velocity_in_world: [f32; 3],
    },
    Step {
        torque_nm: &'a [f32],
    },
    Heights {
        points_m: &'a [[f32; 2]],
    },
    TimeStand {
        #[serde(flatten)]
        stand: StandQuestion<'a>,
        rounds: usize,
        steps: usize,
    },
    TimeRollouts {
        #[serde(flatten)]
        stand: StandQuestion<'a>,
        rounds: usize,
        steps: usize,
        rollouts: usize,
        threads: usize,
    },
}

/// How motors hold the robot where it is.
#[derive(Serialize)]
struct StandQuestion<'a> {
    position_rad: &'a [f32],
    stiffness_nm_per_rad: f32,
    damping_nms_per_rad: f32,
    effort_nm: f32,
    settling_steps: usize,
}

impl Question<'_> {
    /// For messages.
    const fn action(&self) -> &'static str {
        match self {
            Self::Open { .. } => "open the robot's file",
            Self::Terrain { .. } => "lay the terrain",
            Self::Place { .. } => "place the robot",
            Self::Vary { .. } => "vary friction and mass",
            Self::Push { .. } => "push the base",
            Self::Step { .. } => "step",
            Self::Heights { .. } => "look at heights",
            Self::TimeStand { .. } => "time its steps",
            Self::TimeRollouts { .. } => "time its rollouts",
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Opened {
    version: String,
    mass_kg: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Done {}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Heights {
    heights_m: Vec<Option<f32>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Timed {
    step_us: f64,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Answer {
    State(State),
    Diverged { diverged: bool },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    joint_position_rad: Vec<f32>,
    joint_velocity_rad_per_s: Vec<f32>,
    position_m: [f32; 3],
    orientation_xyzw: [f32; 4],
    linear_in_world: [f32; 3],
    angular_in_base: [f32; 3],
    foot_contact: Vec<bool>,
    base_contact: bool,
    nonfoot_contact: bool,
}

impl MujocoPlant {
    /// Starts the interpreter on the robot's MJCF, `robots_folder/<name>.xml`, over no terrain yet.
    ///
    /// # Errors
    /// The interpreter or the package is missing, or the file is not this robot there.
    pub fn start(
        interpreter: &Interpreter,
        robots_folder: &Path,
        robot: &Arc<RobotModel>,
    ) -> Result<Self, TransferError> {
        let model: PathBuf = robots_folder.join(format!("{}.xml", robot.name));
        Self::open(Link::start(&interpreter.0)?, &model, robot)
    }

    pub(super) fn open(mut link: Link, model: &Path, robot: &Arc<RobotModel>) -> Result<Self, TransferError> {
        let shapes = robot.links.iter().flat_map(|link| &link.shapes);
        let base_shapes = shapes.filter(|shape| shape.role == Role::Base).map(|shape| shape.name.as_str());
        let question = Question::Open {
            model,
            substeps: SUBSTEPS,
            joints: robot.description.joints.iter().map(|joint| joint.name.as_str()).collect(),
            feet: robot.description.feet.iter().map(|foot| foot.name.as_str()).collect(),
            base_shapes: base_shapes.collect(),
        };
        let opened: Opened = link.ask(question.action(), &question)?;
        let wanted_kg = robot.description.mass_kg;
        // Phrased as "is inside", so that NaN is another robot.
        if !((-1e-6..=1e-6).contains(&(opened.mass_kg - wanted_kg))) {
            let model = model.display().to_string();
            return Err(TransferError::OtherRobot { model, found_kg: opened.mass_kg, wanted_kg });
        }
        let stand = robot.stand_position_rad();
        let feet = robot.description.feet.len();
        Ok(Self {
            robot: Arc::clone(robot),
            link,
            version: opened.version,
            variation: Variation::default(),
            measurement: Measurement::at_rest(BasePose::from_yaw([0.0; 3], 0.0), &stand, feet),
            velocity_before: vec![0.0; stand.len()],
            work: Work::default(),
            failure: None,
        })
    }

    /// Version of MuJoCo.
    pub fn version(&self) -> &str {
        &self.version
    }

    /// Lays another terrain; the variation is the default again, and the robot is to be placed.
    ///
    /// # Errors
    /// The process fails.
    pub fn lay(&mut self, terrain: &Terrain) -> Result<(), TransferError> {
        let question = Question::Terrain { solids: Ground::of(terrain) };
        let Done {} = self.link.ask(question.action(), &question)?;
        self.vary(&Variation::default());
        self.check()
    }

    /// Sets the robot down at rest; work counts from here, the variation stays.
    ///
    /// # Errors
    /// The process fails.
    pub fn place(&mut self, pose: &BasePose, joint_position_rad: &[f32]) -> Result<(), TransferError> {
        let BasePose { position_m, orientation_xyzw } = *pose;
        self.measurement.joint_torque_nm.fill(0.0);
        self.observe(&Question::Place { position_m, orientation_xyzw, joint_position_rad });
        self.reset_work();
        self.check()
    }

    /// Heights of the terrain as MuJoCo has it, NaN where there is none: to check it against ours.
    ///
    /// # Errors
    /// The process fails.
    pub fn heights_m(&mut self, points_m: &[[f32; 2]]) -> Result<Vec<f32>, TransferError> {
        let question = Question::Heights { points_m };
        let Heights { heights_m } = self.link.ask(question.action(), &question)?;
        Ok(heights_m.into_iter().map(|height| height.unwrap_or(f32::NAN)).collect())
    }

    /// Time of one of MuJoCo's steps of 5 ms while the robot stands where it was placed, µs on one
    /// thread, as [`speed::standing_step_us`] takes it: motors are position servos with the stand's
    /// gains, and the steps of a round are one call, so that the interpreter takes no part.
    ///
    /// # Errors
    /// The process fails, or the robot falls.
    pub fn standing_step_us(&mut self) -> Result<f64, TransferError> {
        let stand_rad = self.robot.stand_position_rad();
        let question = Question::TimeStand {
            stand: self.stand_question(&stand_rad),
            rounds: speed::ROUNDS,
            steps: speed::STEPS,
        };
        let Timed { step_us } = self.link.ask(question.action(), &question)?;
        Ok(step_us)
    }

    /// Wall time for one of the steps of `mujoco.rollout` while robots stand where this one was placed,
    /// µs, as [`speed::rollouts_step_us`] takes it.
    ///
    /// # Errors
    /// The process fails, or the robot falls.
    pub fn rollouts_step_us(&mut self, position_rad: &[f32], threads: usize) -> Result<f64, TransferError> {
        let question = Question::TimeRollouts {
            stand: self.stand_question(position_rad),
            rounds: speed::ROLLOUT_ROUNDS,
            steps: speed::ROLLOUT_STEPS,
            rollouts: speed::ROLLOUTS,
            threads,
        };
        let Timed { step_us } = self.link.ask(question.action(), &question)?;
        Ok(step_us)
    }

    fn stand_question<'a>(&self, position_rad: &'a [f32]) -> StandQuestion<'a> {
        StandQuestion {
            position_rad,
            stiffness_nm_per_rad: self.robot.stand.stiffness_nm_per_rad,
            damping_nms_per_rad: self.robot.stand.damping_nms_per_rad,
            effort_nm: self.robot.drive.effort_nm,
            settling_steps: speed::SETTLING_STEPS,
        }
    }

    /// Whether everything since the last check was answered.
    ///
    /// # Errors
    /// What was not.
    pub fn check(&mut self) -> Result<(), TransferError> {
        self.failure.take().map_or(Ok(()), Err)
    }

    fn observe(&mut self, question: &Question<'_>) {
        if self.failure.is_some() {
            return;
        }
        let joints = self.robot.joint_count();
        match self.link.ask(question.action(), question) {
            Ok(Answer::State(state))
                if state.joint_position_rad.len() == joints
                    && state.joint_velocity_rad_per_s.len() == joints
                    && state.foot_contact.len() == self.robot.description.feet.len() =>
            {
                state.into_measurement(&mut self.measurement);
            }
            Ok(Answer::Diverged { diverged: true }) => self.lose(),
            Ok(_) => {
                let found = "a state of another robot".to_owned();
                self.fail(TransferError::OutOfTurn { action: question.action(), found });
            }
            Err(error) => self.fail(error),
        }
    }

    fn fail(&mut self, error: TransferError) {
        self.failure = Some(error);
        self.lose();
    }

    /// A measurement that no rollout takes for one.
    fn lose(&mut self) {
        self.measurement.base.position_m = [f32::NAN; 3];
        self.measurement.joint_velocity_rad_per_s.fill(0.0);
    }
}

impl State {
    fn into_measurement(self, measurement: &mut Measurement) {
        let base = BasePose { position_m: self.position_m, orientation_xyzw: self.orientation_xyzw };
        measurement.base_linear_velocity = base.vector_in_body(self.linear_in_world);
        measurement.base_angular_velocity = self.angular_in_base;
        measurement.projected_gravity = base.vector_in_body([0.0, 0.0, -1.0]);
        measurement.base = base;
        measurement.joint_position_rad = self.joint_position_rad;
        measurement.joint_velocity_rad_per_s = self.joint_velocity_rad_per_s;
        measurement.foot_contact = self.foot_contact;
        measurement.base_contact = self.base_contact;
        measurement.nonfoot_contact = self.nonfoot_contact;
    }
}

impl Physics for MujocoPlant {
    fn robot(&self) -> &Arc<RobotModel> {
        &self.robot
    }

    fn measure(&self) -> &Measurement {
        &self.measurement
    }

    fn vary(&mut self, variation: &Variation) {
        self.variation = *variation;
        let Variation { friction, base_mass_offset_kg, motor_strength: _ } = *variation;
        let question = Question::Vary { friction, base_mass_offset_kg };
        if let Err(error) = self.link.ask::<Done>(question.action(), &question) {
            self.fail(error);
        }
    }

    fn push(&mut self, velocity_in_world: [f32; 3]) {
        self.observe(&Question::Push { velocity_in_world });
    }

    fn step(&mut self, targets: &[JointTarget]) {
        self.measurement.drive(&self.robot.drive, self.variation.motor_strength, targets);
        self.velocity_before.copy_from_slice(&self.measurement.joint_velocity_rad_per_s);
        let torque_nm = std::mem::take(&mut self.measurement.joint_torque_nm);
        self.observe(&Question::Step { torque_nm: &torque_nm });
        self.measurement.joint_torque_nm = torque_nm;
        self.work.add_step(
            &self.measurement.joint_torque_nm,
            &self.velocity_before,
            &self.measurement.joint_velocity_rad_per_s,
        );
    }

    fn positive_work_j(&self) -> f64 {
        self.work.positive_j
    }

    fn signed_work_j(&self) -> f64 {
        self.work.signed_j
    }

    fn reset_work(&mut self) {
        self.work = Work::default();
    }

    fn total_mass_kg(&self) -> f32 {
        self.robot.description.mass_kg as f32 + self.variation.base_mass_offset_kg
    }
}
