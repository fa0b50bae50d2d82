//! The motion of the whole robot, from its joint states alone: the other side of the work balance.

use nalgebra::{Isometry3, Matrix3, Quaternion, Translation3, UnitQuaternion, UnitVector3, Vector3};
use vocaloco_core::robot::{Link, RobotModel};

use super::Measurement;
use super::articulation::parent_link;

/// Pose of a link in the world, and the velocity of its origin.
struct LinkMotion {
    pose: Isometry3<f64>,
    linear: Vector3<f64>,
    angular: Vector3<f64>,
}

/// The motion of the whole robot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Momentum {
    /// Kinetic energy, rotors included, J.
    pub kinetic_energy_j: f64,
    /// Momentum along the world's z axis, kg·m/s.
    pub vertical_kg_m_per_s: f64,
}

/// Kinetic energy and vertical momentum of the robot as measured.
///
/// ```text
/// T = Σ_link ½·m·v² + ½·ωᵀ·I·ω  +  Σ_joint ½·armature·q̇²,   p = Σ_link m·v_z
/// ```
///
/// with v of a link's centre of mass in the world.
pub(super) fn momentum(
    robot: &RobotModel,
    described: &[Link],
    measured: &Measurement,
    base_mass_offset_kg: f32,
) -> Momentum {
    let mut links: Vec<LinkMotion> = Vec::with_capacity(robot.links.len());
    let [x, y, z, w] = measured.base.orientation_xyzw.map(f64::from);
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    let position = Vector3::from(measured.base.position_m.map(f64::from));
    links.push(LinkMotion {
        pose: Isometry3::from_parts(Translation3::from(position), rotation),
        linear: rotation * Vector3::from(measured.base_linear_velocity.map(f64::from)),
        angular: rotation * Vector3::from(measured.base_angular_velocity.map(f64::from)),
    });
    let base_scale = 1.0 + f64::from(base_mass_offset_kg) / described[0].mass_kg;
    let mut total = Momentum::default();
    total.add(&described[0], &links[0], base_scale);
    for (index, joint) in robot.description.joints.iter().enumerate() {
        let parent = &links[parent_link(robot, index)];
        let axis = UnitVector3::new_normalize(Vector3::from(joint.axis));
        let turned = UnitQuaternion::from_axis_angle(&axis, f64::from(measured.joint_position_rad[index]));
        let origin = Translation3::from(Vector3::from(joint.origin_in_parent_m));
        let pose = parent.pose * Isometry3::from_parts(origin, turned);
        let arm = pose.translation.vector - parent.pose.translation.vector;
        let velocity = f64::from(measured.joint_velocity_rad_per_s[index]);
        let link = LinkMotion {
            linear: parent.linear + parent.angular.cross(&arm),
            angular: parent.angular + pose.rotation * axis.into_inner() * velocity,
            pose,
        };
        let behind = &described[index + 1];
        total.add(behind, &link, 1.0);
        total.kinetic_energy_j += 0.5 * behind.armature_kg_m2 * velocity * velocity;
        links.push(link);
    }
    total
}

impl Momentum {
    fn add(&mut self, link: &Link, motion: &LinkMotion, scale: f64) {
        let com = motion.pose.rotation * Vector3::from(link.com_in_link_m);
        let velocity = motion.linear + motion.angular.cross(&com);
        let spin = motion.pose.rotation.inverse() * motion.angular;
        let inertia = Matrix3::from(link.inertia_kg_m2);
        let twice_j = link.mass_kg * velocity.norm_squared() + spin.dot(&(inertia * spin));
        self.kinetic_energy_j += 0.5 * scale * twice_j;
        self.vertical_kg_m_per_s += scale * link.mass_kg * velocity.z;
    }
}
