//! The rapier side of a plant: everything a step changes, so that a clone of it is a snapshot.

use rapier3d::prelude::*;
use vocaloco_core::robot::{Link, RobotModel, Role, Shape, ShapeKind};

use super::{Engine, JointKind, articulation::Articulation};
use crate::terrain::Terrain;

/// What a contact of a collider means; by the collider's index in its set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Terrain,
    Robot(Role),
}

/// Two parts that pressed on each other in the last step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pressing {
    pub(super) sides: [Part; 2],
    /// Along a normal more than 60° from the vertical: against a riser.
    pub(super) steep: bool,
}

/// The state of one robot on its terrain.
#[derive(Clone)]
pub(super) struct World {
    pub(super) bodies: RigidBodySet,
    pub(super) colliders: ColliderSet,
    pub(super) islands: IslandManager,
    pub(super) broad_phase: BroadPhaseBvh,
    pub(super) narrow_phase: NarrowPhase,
    pub(super) impulse_joints: ImpulseJointSet,
    pub(super) multibody_joints: MultibodyJointSet,
}

/// Handles into a [`World`], the same for all its clones.
pub(super) struct Handles {
    /// By link, the base first.
    pub(super) links: Vec<RigidBodyHandle>,
    pub(super) articulation: Articulation,
    /// By collider index.
    pub(super) parts: Vec<Part>,
    pub(super) robot_colliders: Vec<ColliderHandle>,
}

impl World {
    /// The robot at the origin with all joints at zero, on the terrain.
    pub(super) fn build(robot: &RobotModel, terrain: &Terrain, engine: Engine) -> (Self, Handles) {
        let mut world = Self {
            bodies: RigidBodySet::new(),
            colliders: ColliderSet::new(),
            islands: IslandManager::new(),
            broad_phase: BroadPhaseBvh::new(),
            narrow_phase: NarrowPhase::new(),
            impulse_joints: ImpulseJointSet::new(),
            multibody_joints: MultibodyJointSet::new(),
        };
        let mut parts = Vec::new();
        for solid in &terrain.solids {
            let (shape, pose) = solid.shape();
            // The robot's friction alone decides: see `collider`.
            let ground = ColliderBuilder::new(shape).position(pose).friction(1.0);
            let handle = world.colliders.insert(ground);
            note(&mut parts, handle, Part::Terrain);
        }
        let mut links = Vec::with_capacity(robot.links.len());
        let mut robot_colliders = Vec::new();
        for link in links_with_rotors(robot, engine.joints) {
            let body = RigidBodyBuilder::dynamic()
                .can_sleep(false)
                .additional_mass_properties(mass_properties(&link, link.mass_kg));
            let handle = world.bodies.insert(body);
            for shape in &link.shapes {
                let collider = world.colliders.insert_with_parent(collider(shape), handle, &mut world.bodies);
                note(&mut parts, collider, Part::Robot(shape.role));
                robot_colliders.push(collider);
            }
            world.bodies[handle].recompute_mass_properties_from_colliders(&world.colliders);
            links.push(handle);
        }
        let articulation = Articulation::join(engine.joints, &mut world, robot, &links);
        (world, Handles { links, articulation, parts, robot_colliders })
    }
}

/// The links as the engine gets them. Impulse joints carry no rotor inertia: the nearest to it is to
/// put it on the link behind the joint, which is exact while the link before it does not turn.
pub(super) fn links_with_rotors(robot: &RobotModel, joints: JointKind) -> Vec<Link> {
    let mut links = robot.links.clone();
    if joints == JointKind::Impulse {
        for (link, joint) in links[1..].iter_mut().zip(&robot.description.joints) {
            for (row, row_axis) in link.inertia_kg_m2.iter_mut().zip(joint.axis) {
                for (value, column_axis) in row.iter_mut().zip(joint.axis) {
                    *value += link.armature_kg_m2 * row_axis * column_axis;
                }
            }
            link.armature_kg_m2 = 0.0;
        }
    }
    links
}

fn note(parts: &mut Vec<Part>, handle: ColliderHandle, part: Part) {
    let (index, _) = handle.into_raw_parts();
    debug_assert_eq!(index as usize, parts.len(), "a fresh set numbers its colliders in order");
    parts.push(part);
}

pub(super) fn vector(of: [f64; 3]) -> Vector {
    Vector::from_array(of.map(|value| value as f32))
}

/// A link's mass properties, with its inertia scaled to `mass_kg`.
pub(super) fn mass_properties(link: &Link, mass_kg: f64) -> MassProperties {
    let scale = mass_kg / link.mass_kg;
    let rows = link.inertia_kg_m2.map(|row| row.map(|value| (value * scale) as f32));
    // Symmetric, so rows may serve as columns.
    let inertia = Matrix::from_cols_array_2d(&rows);
    MassProperties::with_inertia_matrix(vector(link.com_in_link_m), mass_kg as f32, inertia)
}

/// Geometry of a shape and its pose in its link.
pub(super) fn shape_geometry(shape: &Shape) -> (SharedShape, Pose) {
    let [x, y, z, w] = shape.orientation_in_link_xyzw.map(|value| value as f32);
    let mut rotation = Rotation::from_xyzw(x, y, z, w).normalize();
    let geometry = match shape.kind {
        ShapeKind::Sphere { radius_m } => SharedShape::ball(radius_m as f32),
        ShapeKind::Capsule { radius_m, half_length_m } => {
            SharedShape::capsule_z(half_length_m as f32, radius_m as f32)
        }
        ShapeKind::Cylinder { radius_m, half_length_m } => {
            // parry's cylinders lie along y.
            rotation *= Rotation::from_rotation_x(std::f32::consts::FRAC_PI_2);
            SharedShape::cylinder(half_length_m as f32, radius_m as f32)
        }
        ShapeKind::Box { half_extents_m: [hx, hy, hz] } => {
            SharedShape::cuboid(hx as f32, hy as f32, hz as f32)
        }
    };
    (geometry, Pose::from_parts(vector(shape.centre_in_link_m), rotation))
}

fn collider(shape: &Shape) -> ColliderBuilder {
    let (geometry, pose) = shape_geometry(shape);
    ColliderBuilder::new(geometry)
        .position(pose)
        .density(0.0)
        .friction_combine_rule(CoefficientCombineRule::Multiply)
}
