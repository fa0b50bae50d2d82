//! The two ways a robot is stepped, behind one face: rapier's pipeline, or the plant's own dynamics.

use vocaloco_core::robot::RobotModel;

use super::{
    BasePose, Engine, JointKind, Variation,
    articulation::Motion,
    rapier::{Rapier, Workspace},
    reduced::{self, Reduced},
    world::{Pressing, World},
};
use crate::terrain::Terrain;

/// What no step changes of a robot and its ground.
pub(super) enum Pattern {
    Rapier(Box<Rapier>),
    Reduced(Box<Reduced>),
}

/// What a step changes.
#[derive(Clone)]
pub(super) enum Body {
    Rapier(Box<World>),
    Reduced(reduced::Motion),
}

/// Work space of the steps of one body; between bodies it is to [`forget`](Self::forget).
pub(super) enum Stepper {
    Rapier(Box<Workspace>),
    Reduced(Box<Reduced>),
}

const OTHER_KIND: &str = "pattern, body and stepper of a plant are of one kind";

impl Pattern {
    pub(super) fn new(robot: &RobotModel, terrain: &Terrain, engine: Engine) -> Self {
        match engine.joints {
            JointKind::Reduced => Self::Reduced(Box::new(Reduced::new(robot, terrain, engine.iterations))),
            JointKind::Multibody | JointKind::Impulse => {
                Self::Rapier(Box::new(Rapier::new(robot, terrain, engine)))
            }
        }
    }

    pub(super) fn stepper(&self) -> Stepper {
        match self {
            Self::Rapier(_) => Stepper::Rapier(Box::new(Workspace::new())),
            Self::Reduced(reduced) => Stepper::Reduced(reduced.clone()),
        }
    }

    /// The robot at rest in a pose.
    pub(super) fn placed(&self, robot: &RobotModel, pose: &BasePose, joint_position_rad: &[f32]) -> Body {
        match self {
            Self::Rapier(rapier) => Body::Rapier(Box::new(rapier.placed(robot, pose, joint_position_rad))),
            Self::Reduced(_) => Body::Reduced(reduced::Motion::at(pose, joint_position_rad)),
        }
    }

    /// The plant's own dynamics take the variation with each step.
    pub(super) fn vary(&self, body: &mut Body, robot: &RobotModel, variation: &Variation) {
        if let (Self::Rapier(rapier), Body::Rapier(world)) = (self, body) {
            rapier.vary(world, robot, variation);
        }
    }

    pub(super) fn push(&self, body: &mut Body, velocity_in_world: [f32; 3]) {
        match (self, body) {
            (Self::Rapier(rapier), Body::Rapier(world)) => rapier.push(world, velocity_in_world),
            (Self::Reduced(_), Body::Reduced(motion)) => {
                for (velocity, added) in motion.velocity.iter_mut().zip(velocity_in_world) {
                    *velocity += added;
                }
            }
            _ => unreachable!("{OTHER_KIND}"),
        }
    }

    /// Joints and the base's velocity, and the base's pose.
    pub(super) fn read(&self, body: &Body, robot: &RobotModel, motion: &mut Motion<'_>) -> BasePose {
        match (self, body) {
            (Self::Rapier(rapier), Body::Rapier(world)) => rapier.read(world, robot, motion),
            (Self::Reduced(_), Body::Reduced(own)) => {
                own.read(motion);
                own.base()
            }
            _ => unreachable!("{OTHER_KIND}"),
        }
    }

    /// Gives every contact that pressed in the last step.
    pub(super) fn for_each_pressing(&self, body: &Body, found: impl FnMut(Pressing)) {
        match (self, body) {
            (Self::Rapier(rapier), Body::Rapier(world)) => rapier.pressing(world).for_each(found),
            (Self::Reduced(reduced), Body::Reduced(motion)) => reduced.pressing(motion).for_each(found),
            _ => unreachable!("{OTHER_KIND}"),
        }
    }

    /// Poses of the links, the base first.
    pub(super) fn link_poses(&self, body: &Body) -> Vec<BasePose> {
        match (self, body) {
            (Self::Rapier(rapier), Body::Rapier(world)) => rapier.link_poses(world),
            (Self::Reduced(reduced), Body::Reduced(motion)) => reduced.link_poses(motion),
            _ => unreachable!("{OTHER_KIND}"),
        }
    }
}

impl Stepper {
    /// Before another body is stepped than the one stepped last.
    pub(super) fn forget(&mut self) {
        if let Self::Rapier(work) = self {
            work.forget();
        }
    }

    /// One physics step under joint torques.
    pub(super) fn step(
        &mut self,
        pattern: &Pattern,
        body: &mut Body,
        robot: &RobotModel,
        torque_nm: &[f32],
        variation: &Variation,
    ) {
        match (self, pattern, body) {
            (Self::Rapier(work), Pattern::Rapier(rapier), Body::Rapier(world)) => {
                rapier.step(work, world, robot, torque_nm);
            }
            (Self::Reduced(reduced), _, Body::Reduced(motion)) => reduced.step(motion, torque_nm, variation),
            _ => unreachable!("{OTHER_KIND}"),
        }
    }
}
