//! Where shapes of the robot meet the ground and each other.

use rapier3d::{
    math::{Matrix, Pose, Rotation, Vector},
    parry::{bounding_volume::Aabb, query, shape::SharedShape},
};
use vocaloco_core::robot::{RobotModel, Shape, ShapeKind};

use super::{Motion, tree::Tree};
use crate::{
    plant::world::{Part, shape_geometry},
    terrain::Terrain,
};

/// Closer than this is a contact, m: a foot at 2 m/s is seen a step ahead.
const PREDICTION_M: f32 = 0.01;

/// Two shapes within reach of each other; side 1 may be the ground.
#[derive(Clone, Copy)]
pub(super) struct Contact {
    pub(super) pair: [u32; 2],
    pub(super) links: [Option<usize>; 2],
    /// From the base's origin, in the world.
    pub(super) point: Vector,
    /// From side 1 to side 2.
    pub(super) normal: Vector,
    pub(super) distance_m: f32,
    pub(super) friction: f32,
}

/// Shapes of robot and ground; the ground's come first.
#[derive(Clone)]
pub(super) struct Shapes {
    ground: Vec<(SharedShape, Pose, Aabb)>,
    robot: Vec<OnLink>,
    /// Of the robot's shapes, those that may meet.
    pairs: Vec<LimbPair>,
    around: Vec<Around>,
    /// By limb, in the base frame, how far its shapes reach.
    limbs: Vec<[Vector; 2]>,
    /// Of the ground's, those that the robot may meet now.
    near: Vec<usize>,
}

/// Two limbs, or one and itself, and their shapes that may meet.
#[derive(Clone)]
struct LimbPair {
    limbs: [usize; 2],
    shapes: Vec<[usize; 2]>,
}

#[derive(Clone)]
struct OnLink {
    link: usize,
    /// 0 is the base, others by the joint that carries them.
    limb: usize,
    part: Part,
    geometry: SharedShape,
    centre_in_link: Vector,
    rotation_in_link: Rotation,
    /// Half the extents of the core, which `radius` surrounds, along the shape's axes.
    core: Vector,
    radius: f32,
}

/// Boxes around a shape: centre from the base's origin and half extents.
#[derive(Clone, Copy, Default)]
struct Around {
    centre: Vector,
    half_in_world: Vector,
    centre_in_base: Vector,
    half_in_base: Vector,
}

impl Shapes {
    pub(super) fn of(robot: &RobotModel, tree: &Tree, terrain: &Terrain) -> Self {
        let ground = terrain.solids.iter().map(|solid| {
            let (shape, pose) = solid.shape();
            let around = shape.compute_aabb(&pose);
            (shape, pose, around)
        });
        let mut shapes = Vec::new();
        for (link, described) in robot.links.iter().enumerate() {
            let limb = tree.path[link].first().map_or(0, |joint| joint + 1);
            shapes.extend(described.shapes.iter().map(|shape| OnLink::of(link, limb, shape)));
        }
        let parent = |link: usize| link.checked_sub(1).map(|joint| tree.joints[joint].parent);
        let mut pairs: Vec<LimbPair> = Vec::new();
        for second in 0..shapes.len() {
            for first in 0..second {
                let [a, b] = [shapes[first].link, shapes[second].link];
                if a != b && parent(a) != Some(b) && parent(b) != Some(a) {
                    let limbs = [shapes[first].limb, shapes[second].limb];
                    match pairs.iter_mut().find(|pair| pair.limbs == limbs) {
                        Some(pair) => pair.shapes.push([first, second]),
                        None => pairs.push(LimbPair { limbs, shapes: vec![[first, second]] }),
                    }
                }
            }
        }
        let around = vec![Around::default(); shapes.len()];
        let limbs = vec![[Vector::ZERO; 2]; tree.path.len()];
        Self { ground: ground.collect(), robot: shapes, pairs, around, limbs, near: Vec::new() }
    }

    /// What a side of a contact is.
    pub(super) fn part(&self, side: u32) -> Part {
        let robot = (side as usize).checked_sub(self.ground.len());
        robot.map_or(Part::Terrain, |index| self.robot[index].part)
    }

    /// Gives every contact, in a fixed order.
    pub(super) fn meet(
        &mut self,
        tree: &Tree,
        motion: &Motion,
        friction: f32,
        mut found: impl FnMut(Contact),
    ) {
        self.look_around(tree, motion.base_position);
        let base = motion.base_position;
        for (index, shape) in self.robot.iter().enumerate() {
            let around = &self.around[index];
            let reach = around.half_in_world + Vector::splat(PREDICTION_M);
            let (low, high) = (base + around.centre - reach, base + around.centre + reach);
            for solid in &self.near {
                let (geometry, pose, aabb) = &self.ground[*solid];
                if apart(low, high, aabb) {
                    continue;
                }
                let at = shape.pose(tree, base);
                let met = query::contact(pose, &**geometry, &at, &*shape.geometry, PREDICTION_M);
                if let Ok(Some(met)) = met {
                    found(Contact {
                        pair: [*solid as u32, (self.ground.len() + index) as u32],
                        links: [None, Some(shape.link)],
                        point: met.point1 - base,
                        normal: met.normal1,
                        distance_m: met.dist,
                        friction,
                    });
                }
            }
        }
        for LimbPair { limbs: [one, other], shapes } in &self.pairs {
            let ([low, high], [other_low, other_high]) = (self.limbs[*one], self.limbs[*other]);
            let reach = Vector::splat(PREDICTION_M);
            if (low - reach).cmpgt(other_high).any() || (high + reach).cmplt(other_low).any() {
                continue;
            }
            for [first, second] in shapes {
                if let Some(contact) = self.meet_itself(tree, [*first, *second], friction) {
                    found(contact);
                }
            }
        }
    }

    /// Finds the boxes around all shapes and limbs, and the ground that they may meet.
    fn look_around(&mut self, tree: &Tree, base: Vector) {
        let from_base = tree.placed[0].axes.transpose();
        let (mut low, mut high) = (Vector::INFINITY, Vector::NEG_INFINITY);
        self.limbs.fill([Vector::INFINITY, Vector::NEG_INFINITY]);
        for (shape, around) in self.robot.iter().zip(&mut self.around) {
            *around = shape.around(tree, from_base);
            low = low.min(around.centre - around.half_in_world);
            high = high.max(around.centre + around.half_in_world);
            let [limb_low, limb_high] = &mut self.limbs[shape.limb];
            *limb_low = limb_low.min(around.centre_in_base - around.half_in_base);
            *limb_high = limb_high.max(around.centre_in_base + around.half_in_base);
        }
        // Wider than any one shape's reach is by rounding.
        let reach = Vector::splat(2.0 * PREDICTION_M);
        let (low, high) = (base + low - reach, base + high + reach);
        self.near.clear();
        self.near.extend((0..self.ground.len()).filter(|solid| !apart(low, high, &self.ground[*solid].2)));
    }

    /// Two of the robot's shapes.
    fn meet_itself(&self, tree: &Tree, shapes: [usize; 2], friction: f32) -> Option<Contact> {
        let [a, b] = shapes.map(|shape| &self.around[shape]);
        let gap = (a.centre_in_base - b.centre_in_base).abs() - a.half_in_base - b.half_in_base;
        if gap.cmpgt(Vector::splat(PREDICTION_M)).any() {
            return None;
        }
        let [a, b] = shapes.map(|shape| &self.robot[shape]);
        let (pose_a, pose_b) = (a.pose(tree, Vector::ZERO), b.pose(tree, Vector::ZERO));
        let met = query::contact(&pose_a, &*a.geometry, &pose_b, &*b.geometry, PREDICTION_M).ok()??;
        Some(Contact {
            pair: shapes.map(|index| (self.ground.len() + index) as u32),
            links: [Some(a.link), Some(b.link)],
            point: met.point1,
            normal: met.normal1,
            distance_m: met.dist,
            friction: friction * friction,
        })
    }
}

fn apart(low: Vector, high: Vector, aabb: &Aabb) -> bool {
    low.cmpgt(aabb.maxs).any() || high.cmplt(aabb.mins).any()
}

impl OnLink {
    fn of(link: usize, limb: usize, shape: &Shape) -> Self {
        let (geometry, pose) = shape_geometry(shape);
        let (core, radius) = match shape.kind {
            ShapeKind::Sphere { radius_m } => (Vector::ZERO, radius_m),
            ShapeKind::Capsule { radius_m, half_length_m } => {
                (Vector::new(0.0, 0.0, half_length_m as f32), radius_m)
            }
            ShapeKind::Cylinder { radius_m, half_length_m } => {
                // Its axis is parry's y.
                (Vector::new(radius_m as f32, half_length_m as f32, radius_m as f32), 0.0)
            }
            ShapeKind::Box { half_extents_m } => {
                (Vector::from_array(half_extents_m.map(|half| half as f32)), 0.0)
            }
        };
        Self {
            link,
            limb,
            part: Part::Robot(shape.role),
            geometry,
            centre_in_link: pose.translation,
            rotation_in_link: pose.rotation,
            core,
            radius: radius as f32,
        }
    }

    /// With the base's origin at `base`.
    fn pose(&self, tree: &Tree, base: Vector) -> Pose {
        let link = &tree.placed[self.link];
        let centre = base + link.origin + link.axes * self.centre_in_link;
        Pose::from_parts(centre, link.rotation * self.rotation_in_link)
    }

    fn around(&self, tree: &Tree, from_base: Matrix) -> Around {
        let link = &tree.placed[self.link];
        let centre = link.origin + link.axes * self.centre_in_link;
        let radius = Vector::splat(self.radius);
        let (mut half_in_world, mut half_in_base) = (radius, radius);
        let along = [
            self.rotation_in_link * Vector::X,
            self.rotation_in_link * Vector::Y,
            self.rotation_in_link * Vector::Z,
        ];
        for (half, axis) in self.core.to_array().into_iter().zip(along) {
            if half > 0.0 {
                let edge = link.axes * (axis * half);
                half_in_world += edge.abs();
                half_in_base += (from_base * edge).abs();
            }
        }
        Around { centre, half_in_world, centre_in_base: from_base * centre, half_in_base }
    }
}
