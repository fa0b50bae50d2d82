//! Where each foot is under the base for given joint positions, and what moves it.

use vocaloco_plugin_api::{FootDescription, RobotDescription};

/// One leg: its joints from foot to base.
#[derive(Clone, Debug)]
pub(super) struct Leg {
    links: Vec<LegJoint>,
    foot_in_link_m: [f64; 3],
}

#[derive(Clone, Debug)]
struct LegJoint {
    index: usize,
    origin_in_parent_m: [f64; 3],
    axis: [f64; 3],
}

impl Leg {
    /// The legs of a robot, in the order of its feet.
    pub(super) fn all(robot: &RobotDescription) -> Vec<Self> {
        let leg = |foot: &FootDescription| {
            let mut links = Vec::new();
            let mut next = i32::try_from(foot.joint).ok();
            while let Some(index) = next.and_then(|index| usize::try_from(index).ok()) {
                let joint = &robot.joints[index];
                links.push(LegJoint {
                    index,
                    origin_in_parent_m: joint.origin_in_parent_m,
                    axis: joint.axis,
                });
                // Parents come before children, so this ends.
                next = Some(joint.parent).filter(|&parent| parent < i32::try_from(index).unwrap_or(0));
            }
            Self { links, foot_in_link_m: foot.centre_in_link_m }
        };
        robot.feet.iter().map(leg).collect()
    }

    /// Indices of its joints, from foot to base.
    pub(super) fn joints(&self) -> impl Iterator<Item = usize> + '_ {
        self.links.iter().map(|joint| joint.index)
    }

    /// The foot's centre in the base frame, m.
    pub(super) fn foot_in_base_m(&self, position_rad: &[f64]) -> [f64; 3] {
        let mut point = self.foot_in_link_m;
        for joint in &self.links {
            point = rotate(point, joint.axis, position_rad[joint.index]);
            point = std::array::from_fn(|axis| point[axis] + joint.origin_in_parent_m[axis]);
        }
        point
    }

    /// How the foot moves along `direction` (base frame) with each joint, m/rad, from foot to base:
    /// `d·(a × r)` with the joint's axis a and the foot's place r seen from it.
    pub(super) fn moves_foot(&self, position_rad: &[f64], direction: [f64; 3]) -> Vec<f64> {
        let column = |link: usize| {
            // Axis and lever in the joint's own frame, carried up to the base together.
            let mut lever = self.foot_in_link_m;
            for (step, joint) in self.links.iter().enumerate().take(link + 1) {
                lever = rotate(lever, joint.axis, position_rad[joint.index]);
                if step < link {
                    lever = std::array::from_fn(|axis| lever[axis] + joint.origin_in_parent_m[axis]);
                }
            }
            let mut motion = cross(self.links[link].axis, lever);
            for joint in &self.links[link + 1..] {
                motion = rotate(motion, joint.axis, position_rad[joint.index]);
            }
            dot(direction, motion)
        };
        (0..self.links.len()).map(column).collect()
    }
}

/// Rodrigues' rotation of `v` about the unit vector `k`:
/// `v′ = v·cos α + (k × v)·sin α + k·(k·v)·(1 − cos α)`.
fn rotate(v: [f64; 3], k: [f64; 3], angle_rad: f64) -> [f64; 3] {
    let (sin, cos) = libm::sincos(angle_rad);
    let along = dot(k, v) * (1.0 - cos);
    let across = cross(k, v);
    std::array::from_fn(|axis| v[axis] * cos + across[axis] * sin + k[axis] * along)
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Scalar product.
pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
