//! Where each foot is under the base for given joint positions.

use vocaloco_plugin_api::RobotDescription;

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
        let leg = |foot: &vocaloco_plugin_api::FootDescription| {
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

    /// Indices of its joints.
    pub(super) fn joints(&self) -> impl Iterator<Item = usize> + '_ {
        self.links.iter().map(|joint| joint.index)
    }

    /// The foot's centre in the base frame, m, with joint positions from `position_rad`.
    pub(super) fn foot_in_base_m(&self, position_rad: impl Fn(usize) -> f64) -> [f64; 3] {
        let mut point = self.foot_in_link_m;
        for joint in &self.links {
            point = rotate(point, joint.axis, position_rad(joint.index));
            for (coordinate, origin) in point.iter_mut().zip(joint.origin_in_parent_m) {
                *coordinate += origin;
            }
        }
        point
    }
}

/// Rodrigues' rotation of `v` about the unit vector `k`:
/// `v′ = v·cos α + (k × v)·sin α + k·(k·v)·(1 − cos α)`.
fn rotate(v: [f64; 3], k: [f64; 3], angle_rad: f64) -> [f64; 3] {
    let (sin, cos) = libm::sincos(angle_rad);
    let along = dot(k, v) * (1.0 - cos);
    let across = [k[1] * v[2] - k[2] * v[1], k[2] * v[0] - k[0] * v[2], k[0] * v[1] - k[1] * v[0]];
    std::array::from_fn(|axis| v[axis] * cos + across[axis] * sin + k[axis] * along)
}

/// Scalar product.
pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
