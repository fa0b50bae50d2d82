//! Lines out: the greeting, one line a tick, and what is answered to a line that cannot be used.

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use vocaloco_plugin_api::{JointTarget, RobotDescription};

use crate::decision::{Forced, SkillVerdict};
use crate::observation::ObservationFault;
use crate::predictor::backend;
use crate::runtime::{Runtime, Tick};

/// The first line: who speaks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Greeting {
    /// Name of the deployment.
    pub deployment: String,
    /// Name of the robot.
    pub robot: String,
    /// Its joints.
    pub joints: Vec<String>,
    /// Its feet.
    pub feet: Vec<String>,
    /// Rate at which lines are expected, Hz.
    pub rate_hz: f64,
    /// Skills that may run.
    pub skills: Vec<String>,
    /// One line for each skill that was refused.
    pub refused: Vec<String>,
    /// Fields that every line must hold besides those that are always needed.
    pub required: Vec<&'static str>,
    /// The model runtime.
    pub backend: &'static str,
    /// Its version.
    pub backend_version: String,
    /// Version of this program.
    pub version: &'static str,
}

impl Greeting {
    /// The greeting of a runtime.
    pub fn of(runtime: &Runtime, deployment: &str, refused: Vec<String>) -> Self {
        let robot = &runtime.robot().description;
        Self {
            deployment: deployment.to_owned(),
            robot: robot.name.to_string(),
            joints: robot.joints.iter().map(|joint| joint.name.to_string()).collect(),
            feet: robot.feet.iter().map(|foot| foot.name.to_string()).collect(),
            rate_hz: runtime.config().rate_hz,
            skills: runtime.rules().iter().map(|rule| rule.name.clone()).collect(),
            refused,
            required: runtime.required().fields().collect(),
            backend: backend().name,
            backend_version: backend().version.clone(),
            version: env!("CARGO_PKG_VERSION"),
        }
    }
}

/// A tick's line.
#[derive(Serialize)]
pub struct TickLine<'a> {
    t_s: f64,
    active: &'a str,
    choice: &'a str,
    skills: Skills<'a>,
    reason: &'a str,
    stopped: bool,
    forced: Option<Forced>,
    events: &'a [String],
    joints: Joints<'a>,
}

impl<'a> TickLine<'a> {
    /// The line of a tick.
    pub fn of(robot: &'a RobotDescription, tick: &Tick<'a>) -> Self {
        let decision = tick.decision;
        Self {
            t_s: decision.t_s,
            active: &decision.active,
            choice: &decision.choice,
            skills: Skills(&decision.skills),
            reason: &decision.reason,
            stopped: decision.stopped,
            forced: decision.forced,
            events: &decision.events,
            joints: Joints { robot, targets: tick.joints },
        }
    }
}

/// The answer to a line that cannot be used.
#[derive(Serialize)]
pub(super) struct ErrorLine<'a> {
    error: ErrorBody<'a>,
    #[serde(flatten)]
    tick: TickLine<'a>,
}

#[derive(Serialize)]
struct ErrorBody<'a> {
    field: &'a str,
    found: &'a str,
    wanted: &'a str,
}

impl<'a> ErrorLine<'a> {
    pub(super) fn of(robot: &'a RobotDescription, fault: &'a ObservationFault, tick: &Tick<'a>) -> Self {
        let error = ErrorBody { field: &fault.field, found: &fault.found, wanted: &fault.wanted };
        Self { error, tick: TickLine::of(robot, tick) }
    }
}

struct Skills<'a>(&'a [SkillVerdict]);

#[derive(Serialize)]
struct SkillLine {
    viability: Option<f32>,
    cot: Option<f32>,
    viable: bool,
    reason: String,
}

impl Serialize for Skills<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for verdict in self.0 {
            let line = SkillLine {
                viability: verdict.viability,
                cot: verdict.cot,
                viable: verdict.viable,
                reason: verdict.reason.to_string(),
            };
            map.serialize_entry(&verdict.name, &line)?;
        }
        map.end()
    }
}

/// Targets by joint name.
struct Joints<'a> {
    robot: &'a RobotDescription,
    targets: &'a [JointTarget],
}

#[derive(Serialize)]
struct JointLine {
    position_rad: f32,
    stiffness_nm_per_rad: f32,
    damping_nms_per_rad: f32,
    feed_forward_nm: f32,
}

impl Serialize for Joints<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.targets.len()))?;
        for (joint, target) in self.robot.joints.iter().zip(self.targets) {
            let line = JointLine {
                position_rad: target.position_rad,
                stiffness_nm_per_rad: target.stiffness_nm_per_rad,
                damping_nms_per_rad: target.damping_nms_per_rad,
                feed_forward_nm: target.feed_forward_nm,
            };
            map.serialize_entry(joint.name.as_str(), &line)?;
        }
        map.end()
    }
}
