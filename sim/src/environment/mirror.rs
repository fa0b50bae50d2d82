//! What a robot that is its own mirror image sees and does on the other side: left and right exchanged.

use vocaloco_plugin_api::{
    RobotDescription,
    contract::{Contract, Factor},
    observation::{HeightOrder, HistoryLayout, ObservationTerm, Term},
};

/// Largest distance between a joint and the mirror image of its partner, m, and difference of two numbers
/// that are held to be the same.
const TOLERANCE: f64 = 1e-6;

/// The reflection of observations and actions in the plane between left and right.
///
/// Each value is one of the original with a sign:
///
/// ```text
/// mirrored[k] = sign[k] · original[from[k]]
/// ```
///
/// # Source
/// Data and losses that exchange left and right: Yu, Turk, Liu, *Learning symmetric and low-energy
/// locomotion*, SIGGRAPH 2018; Mittal et al., *Symmetry considerations for learning task symmetric robot
/// policies*, ICRA 2024.
#[derive(Clone, Debug, PartialEq)]
pub struct Mirror {
    observation: Reflection,
    action: Reflection,
}

type Reflection = Vec<(u32, f32)>;

impl Mirror {
    /// The reflection of a contract's observation and action; `None` where the robot, or the stand that
    /// actions are relative to, is not its own mirror image.
    pub fn new(contract: &Contract, robot: &RobotDescription) -> Option<Self> {
        let joints = reflected_joints(contract, robot)?;
        let feet = reflected_feet(robot)?;
        let frames: Vec<(Reflection, usize)> = contract
            .observation
            .iter()
            .map(|term| Some((reflected_term(term, &joints, &feet)?, term.history)))
            .collect::<Option<_>>()?;
        let mut observation = Vec::new();
        let mut append = |frame: &Reflection| {
            let start = observation.len() as u32;
            observation.extend(frame.iter().map(|(from, sign)| (start + from, *sign)));
        };
        match contract.history_layout {
            HistoryLayout::TermMajor => {
                for (frame, history) in &frames {
                    (0..*history).for_each(|_| append(frame));
                }
            }
            HistoryLayout::TimeMajor => {
                let history = frames.first().map_or(0, |(_, history)| *history);
                for _ in 0..history {
                    for (frame, _) in &frames {
                        append(frame);
                    }
                }
            }
        }
        Some(Self { observation, action: joints })
    }

    /// What the mirrored robot observes.
    pub fn observation(&self, original: &[f32], mirrored: &mut [f32]) {
        reflect(&self.observation, original, mirrored);
    }

    /// What the mirrored robot does.
    pub fn action(&self, original: &[f32], mirrored: &mut [f32]) {
        reflect(&self.action, original, mirrored);
    }
}

fn reflect(reflection: &Reflection, original: &[f32], mirrored: &mut [f32]) {
    for (mirrored, (from, sign)) in mirrored.iter_mut().zip(reflection) {
        *mirrored = sign * original[*from as usize];
    }
}

/// For each joint of the contract its partner on the other side, and the sign between their angles.
///
/// A rotation about `(x, y, z)` is in the mirror one about `(−x, y, −z)`.
fn reflected_joints(contract: &Contract, robot: &RobotDescription) -> Option<Reflection> {
    let number = |name: &String| robot.joints.iter().position(|joint| joint.name.as_str() == name);
    let in_robot: Vec<usize> = contract.joints.iter().map(number).collect::<Option<_>>()?;
    let default_rad = |place: usize| contract.action.default_position_rad.get(&contract.joints[place]);
    let scale = contract.action.scale.in_order("action.scale", &contract.joints).ok()?;
    let partner = |place: usize| {
        let joint = in_robot[place];
        let [x, y, z] = origin_m(robot, joint);
        let at = |other: &usize| {
            near(origin_m(robot, *other), [x, -y, z]) && depth(robot, *other) == depth(robot, joint)
        };
        let other = in_robot.iter().position(at)?;
        let [ax, ay, az] = robot.joints[joint].axis;
        let mirrored = robot.joints[in_robot[other]].axis;
        let sign =
            [1.0, -1.0].into_iter().find(|sign| near(mirrored, [-sign * ax, sign * ay, -sign * az]))?;
        let same_stand = (default_rad(other)? - sign * default_rad(place)?).abs() < TOLERANCE;
        let same_scale = (scale[other] - scale[place]).abs() < TOLERANCE;
        (same_stand && same_scale).then_some((other as u32, sign as f32))
    };
    (0..in_robot.len()).map(partner).collect()
}

fn reflected_feet(robot: &RobotDescription) -> Option<Reflection> {
    let place_m = |foot: usize| {
        let foot = &robot.feet[foot];
        let [x, y, z] = origin_m(robot, foot.joint as usize);
        let [dx, dy, dz] = foot.centre_in_link_m;
        [x + dx, y + dy, z + dz]
    };
    let partner = |foot: usize| {
        let [x, y, z] = place_m(foot);
        let other = (0..robot.feet.len()).find(|other| near(place_m(*other), [x, -y, z]))?;
        Some((other as u32, 1.0))
    };
    (0..robot.feet.len()).map(partner).collect()
}

/// Where a joint sits in the base frame with all joints at zero, m.
fn origin_m(robot: &RobotDescription, joint: usize) -> [f64; 3] {
    let mut at = [0.0; 3];
    let mut next = i32::try_from(joint).unwrap_or(-1);
    while let Some(joint) = usize::try_from(next).ok().and_then(|joint| robot.joints.get(joint)) {
        at.iter_mut().zip(joint.origin_in_parent_m).for_each(|(at, step)| *at += step);
        next = joint.parent;
    }
    at
}

/// Joints between a joint and the base: a hip's two joints may share a place.
fn depth(robot: &RobotDescription, joint: usize) -> usize {
    let parent = |joint: &usize| usize::try_from(robot.joints.get(*joint)?.parent).ok();
    std::iter::successors(Some(joint), parent).count()
}

fn near(a: [f64; 3], b: [f64; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < TOLERANCE)
}

/// One frame of a term; `None` where two partners are scaled differently.
fn reflected_term(term: &ObservationTerm, joints: &Reflection, feet: &Reflection) -> Option<Reflection> {
    let reflection = unscaled_term(term, joints, feet)?;
    let Factor::Each(factors) = &term.scale else { return Some(reflection) };
    let same = |(at, (from, _)): (usize, &(u32, f32))| factors.get(at) == factors.get(*from as usize);
    reflection.iter().enumerate().all(same).then_some(reflection)
}

fn unscaled_term(term: &ObservationTerm, joints: &Reflection, feet: &Reflection) -> Option<Reflection> {
    let signs = |signs: &[f32]| signs.iter().enumerate().map(|(at, sign)| (at as u32, *sign)).collect();
    Some(match term.term {
        Term::BaseLinearVelocity | Term::ProjectedGravity => signs(&[1.0, -1.0, 1.0]),
        Term::BaseAngularVelocity => signs(&[-1.0, 1.0, -1.0]),
        Term::VelocityCommand => signs(&[1.0, -1.0, -1.0]),
        Term::PositionTarget => signs(&[1.0, -1.0, -1.0, 1.0]),
        Term::JointPosition | Term::JointVelocity | Term::JointTorque | Term::LastAction => joints.clone(),
        Term::FootContact => feet.clone(),
        // Left and right are half a cycle apart.
        Term::GaitPhase => signs(&[-1.0, -1.0]),
        Term::Heights => {
            let patch = term.patch.as_ref()?;
            let (rows, columns) = (patch.terrain().rows() as u32, patch.terrain().columns() as u32);
            (0..rows * columns)
                .map(|at| {
                    let from = match patch.order {
                        HeightOrder::RowsFromRight | HeightOrder::RowsFromLeft => {
                            at / columns * columns + (columns - 1 - at % columns)
                        }
                        HeightOrder::ColumnsFromRight => (columns - 1 - at / rows) * rows + at % rows,
                    };
                    (from, 1.0)
                })
                .collect()
        }
    })
}
