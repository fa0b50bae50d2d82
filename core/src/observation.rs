//! What a source (simulator, robot, log) hands the runtime each tick, and whether it can be used.

use thiserror::Error;
use vocaloco_plugin_api::{Command, RobotDescription};

use crate::elevation::Elevation;
use crate::heightfield::{Heightfield, Noise};

/// The robot as measured this tick. Joint arrays follow the robot's joint order, contacts its feet.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Time of the measurement, s; it never runs backwards.
    pub t_s: f64,
    /// rad.
    pub joint_position_rad: Vec<f32>,
    /// rad/s.
    pub joint_velocity_rad_per_s: Vec<f32>,
    /// N·m, where the source has them.
    pub joint_torque_nm: Option<Vec<f32>>,
    /// Whether each foot touches, where the source knows.
    pub foot_contact: Option<Vec<bool>>,
    /// Of the base origin in the base frame, m/s.
    pub base_linear_velocity: [f32; 3],
    /// In the base frame, rad/s.
    pub base_angular_velocity: [f32; 3],
    /// Unit vector of gravity in the base frame.
    pub projected_gravity: [f32; 3],
    /// The base in the odometry frame; only position targets need it.
    pub base_in_odom: Option<BaseInOdom>,
    /// The terrain around the robot; none means unknown.
    pub elevation: Option<Elevation>,
    /// What the robot is asked to do.
    pub command: Command,
    /// Noise for the predictors' field, m; only simulators set it.
    pub field_noise: Option<Noise>,
    /// Heights for the predictors' field in place of the elevation's, where a simulator lets its cameras
    /// see less than that holds.
    pub heightfield: Option<Heightfield>,
}

/// The base's pose in the odometry frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseInOdom {
    /// Origin, m.
    pub position_m: [f64; 3],
    /// Rotation from base to odometry frame, x y z w.
    pub orientation_xyzw: [f64; 4],
}

/// A measurement that cannot be used: which field, what it holds, what it should hold.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{field}: found {found}, wanted {wanted}")]
pub struct ObservationFault {
    /// The field, such as `joint_position_rad.LF_HAA`.
    pub field: String,
    /// What it holds.
    pub found: String,
    /// What it should hold.
    pub wanted: String,
}

impl ObservationFault {
    /// A fault of `field`.
    pub fn new(
        field: impl Into<String>,
        found: impl std::fmt::Display,
        wanted: impl std::fmt::Display,
    ) -> Self {
        Self { field: field.into(), found: found.to_string(), wanted: wanted.to_string() }
    }
}

/// What the skills of a deployment need of every observation, besides joints and base.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Required {
    /// Joint torques.
    pub joint_torques: bool,
    /// Foot contacts.
    pub foot_contacts: bool,
    /// The base in the odometry frame.
    pub base_in_odom: bool,
}

impl Required {
    /// The same fields, by their names on a line.
    pub fn fields(self) -> impl Iterator<Item = &'static str> {
        let named = [
            ("joint_torque_nm", self.joint_torques),
            ("foot_contact", self.foot_contacts),
            ("base_in_odom", self.base_in_odom),
        ];
        named.into_iter().filter_map(|(field, needed)| needed.then_some(field))
    }

    /// What an observation holds of them.
    pub fn held_by(observation: &Observation) -> Self {
        Self {
            joint_torques: observation.joint_torque_nm.is_some(),
            foot_contacts: observation.foot_contact.is_some(),
            base_in_odom: observation.base_in_odom.is_some(),
        }
    }

    /// What is needed here and not there.
    #[must_use]
    pub fn beyond(self, other: Self) -> Self {
        Self {
            joint_torques: self.joint_torques && !other.joint_torques,
            foot_contacts: self.foot_contacts && !other.foot_contacts,
            base_in_odom: self.base_in_odom && !other.base_in_odom,
        }
    }
}

/// How far beyond its range a joint may be measured, rad: more is of another unit or another zero.
const BEYOND_RANGE_RAD: f64 = 1.0;
/// How often its limit a joint's velocity may be measured as: more is of another unit.
const BEYOND_LIMIT: f64 = 10.0;
/// How far from the odometry frame's origin the base may be, m: targets are set in single precision.
const FAR_M: f64 = 10_000.0;

impl Observation {
    /// Checks that every array has its length, every value is a finite number, and none is of another unit: a joint
    /// within a radian of its range and ten times its speed limit, gravity of about unit length, orientation of unit length and a position near its origin.
    ///
    /// The terrain is not looked at: without it the robot stops, which is no fault of this kind.
    ///
    /// # Errors
    /// The first field at fault, by joint or foot name.
    pub fn check(&self, robot: &RobotDescription, required: Required) -> Result<(), ObservationFault> {
        if !self.t_s.is_finite() {
            return Err(ObservationFault::new("t_s", self.t_s, "a finite number of seconds"));
        }
        let joints = |field: &str, values: &[f32]| {
            if values.len() != robot.joints.len() {
                let wanted = format!("{}, one a joint", robot.joints.len());
                return Err(ObservationFault::new(field, format!("{} values", values.len()), wanted));
            }
            let bad = values.iter().zip(&robot.joints).find(|(value, _)| !value.is_finite());
            match bad {
                Some((value, joint)) => {
                    Err(ObservationFault::new(format!("{field}.{}", joint.name), value, "a finite number"))
                }
                None => Ok(()),
            }
        };
        joints("joint_position_rad", &self.joint_position_rad)?;
        for (&position_rad, joint) in self.joint_position_rad.iter().zip(&robot.joints) {
            let (low, high) = (joint.lower_rad - BEYOND_RANGE_RAD, joint.upper_rad + BEYOND_RANGE_RAD);
            if !(low..=high).contains(&f64::from(position_rad)) {
                let field = format!("joint_position_rad.{}", joint.name);
                return Err(ObservationFault::new(field, position_rad, format!("{low:.2} to {high:.2} rad")));
            }
        }
        joints("joint_velocity_rad_per_s", &self.joint_velocity_rad_per_s)?;
        for (&velocity, joint) in self.joint_velocity_rad_per_s.iter().zip(&robot.joints) {
            let most = BEYOND_LIMIT * joint.velocity_limit_rad_per_s;
            if !(-most..=most).contains(&f64::from(velocity)) {
                let field = format!("joint_velocity_rad_per_s.{}", joint.name);
                return Err(ObservationFault::new(
                    field,
                    velocity,
                    format!("{:.0} to {most:.0} rad/s", -most),
                ));
            }
        }
        match &self.joint_torque_nm {
            Some(torques) => joints("joint_torque_nm", torques)?,
            None if required.joint_torques => return Err(missing("joint_torque_nm")),
            None => {}
        }
        match &self.foot_contact {
            Some(contacts) if contacts.len() != robot.feet.len() => {
                let wanted = format!("{}, one a foot", robot.feet.len());
                return Err(ObservationFault::new(
                    "foot_contact",
                    format!("{} values", contacts.len()),
                    wanted,
                ));
            }
            None if required.foot_contacts => return Err(missing("foot_contact")),
            _ => {}
        }
        vector("base_linear_velocity_m_per_s", &self.base_linear_velocity)?;
        vector("base_angular_velocity_rad_per_s", &self.base_angular_velocity)?;
        vector("projected_gravity", &self.projected_gravity)?;
        let [x, y, z] = self.projected_gravity.map(f64::from);
        unit("projected_gravity", (x * x + y * y + z * z).sqrt(), 0.5)?;
        vector("command.velocity", &self.command.velocity)?;
        vector("command.target", &self.command.target)?;
        match &self.base_in_odom {
            Some(base) if !base.position_m.iter().chain(&base.orientation_xyzw).all(|v| v.is_finite()) => {
                Err(ObservationFault::new("base_in_odom", format!("{base:?}"), "finite numbers"))
            }
            Some(base) if base.position_m.iter().any(|value| value.abs() > FAR_M) => {
                let found = format!("{:?}", base.position_m);
                let wanted = format!("within {FAR_M} m of an origin near by: centimetres count");
                Err(ObservationFault::new("base_in_odom.position_m", found, wanted))
            }
            Some(base) => {
                let squares = base.orientation_xyzw.iter().map(|value| value * value);
                unit("base_in_odom.orientation_xyzw", squares.sum::<f64>().sqrt(), 0.01)
            }
            None if required.base_in_odom => Err(missing("base_in_odom")),
            None => Ok(()),
        }
    }
}

/// A direction has length 1; noise shortens or stretches it by up to `slack`, another unit does more.
fn unit(field: &str, length: f64, slack: f64) -> Result<(), ObservationFault> {
    if (1.0 - slack..=1.0 + slack).contains(&length) {
        return Ok(());
    }
    Err(ObservationFault::new(field, format!("length {length:.3}"), "length 1: a direction without a unit"))
}

fn missing(field: &str) -> ObservationFault {
    ObservationFault::new(field, "nothing", "a value: a skill of this deployment needs it")
}

fn vector(field: &str, values: &[f32]) -> Result<(), ObservationFault> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => {
            Err(ObservationFault::new(format!("{field}[{index}]"), values[index], "a finite number"))
        }
        None => Ok(()),
    }
}
