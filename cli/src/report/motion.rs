//! How a robot moved, packed for a page: millimetres and ten-thousandths. `course.js` unpacks it.

use serde::Serialize;
use vocaloco_core::robot::RobotModel;
use vocaloco_sim::{
    driver::TICK_S,
    kinematics::{forward_kinematics, legs},
    plant::BasePose,
};

use super::{base64::base64, shapes::base_boxes};

/// A robot's poses by tick, and the ground. Text is base64 of little-endian values.
#[derive(Serialize)]
pub(super) struct PackedMotion {
    tick_s: f64,
    ticks: usize,
    legs: usize,
    leg_points: usize,
    /// Centre and half extents in the base frame, m.
    base_boxes: Vec<[[f64; 3]; 2]>,
    /// Boxes: centre and half extents, m.
    terrain: Vec<[f32; 6]>,
    /// i16: base position mm, orientation xyzw × 32767, then each leg's points, mm.
    motion: String,
    /// u8: a bit a foot.
    contact: String,
}

impl PackedMotion {
    /// Packs ticks: the base, the joints in the robot's order, and which feet touch.
    pub(super) fn new<'a>(
        robot: &RobotModel,
        terrain: Vec<[f32; 6]>,
        ticks: impl Iterator<Item = (&'a BasePose, &'a [f32], &'a [bool])>,
    ) -> Self {
        let (mut motion, mut contact) = (Vec::new(), Vec::new());
        for (base, joint_position_rad, foot_contact) in ticks {
            let links = forward_kinematics(&robot.description, base, joint_position_rad);
            motion.extend(base.position_m.map(millimetres));
            motion.extend(base.orientation_xyzw.map(|part| (part * 32767.0).round() as i16));
            for point in legs(&robot.description, &links).concat() {
                motion.extend(point.map(millimetres));
            }
            contact.push(bits(foot_contact));
        }
        let origin = BasePose::from_yaw([0.0; 3], 0.0);
        let stretched = vec![0.0; robot.joint_count()];
        let lines = legs(&robot.description, &forward_kinematics(&robot.description, &origin, &stretched));
        Self {
            tick_s: TICK_S,
            ticks: contact.len(),
            legs: lines.len(),
            leg_points: lines.first().map_or(0, Vec::len),
            base_boxes: base_boxes(robot),
            terrain,
            motion: base64(&motion.iter().flat_map(|value: &i16| value.to_le_bytes()).collect::<Vec<_>>()),
            contact: base64(&contact),
        }
    }
}

fn millimetres(metres: f32) -> i16 {
    (metres * 1000.0).round().clamp(-32767.0, 32767.0) as i16
}

fn bits(flags: &[bool]) -> u8 {
    flags.iter().take(8).enumerate().fold(0, |bits, (place, flag)| bits | u8::from(*flag) << place)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_tick_has_a_pose_in_millimetres_and_a_bit_for_each_foot() {
        let robots = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        let robot = RobotModel::load(&robots, "anymal_d").unwrap();
        let (base, stand) = (BasePose::from_yaw([-1.25, 0.5, 0.6], 0.3), robot.stand_position_rad());
        let tick = (&base, stand.as_slice(), [true, false, false, true].as_slice());
        let packed = PackedMotion::new(&robot, Vec::new(), [tick; 5].into_iter());
        let length = |text: &str| text.len() / 4 * 3 - text.matches('=').count();
        assert_eq!((packed.ticks, packed.legs, packed.leg_points), (5, 4, 4));
        assert_eq!(length(&packed.motion), 5 * (7 + 4 * 4 * 3) * 2);
        assert_eq!(packed.contact, base64(&[0b1001; 5]), "the first and the last foot");
        // x −1.25 m, y 0.5 m, z 0.6 m, in millimetres.
        let first = base64(&[0x1e, 0xfb, 0xf4, 0x01, 0x58, 0x02]);
        assert!(packed.motion.starts_with(&first), "{} for {first}", &packed.motion[..8]);
    }
}
