//! Targets on their way to the drives.

use std::collections::VecDeque;

use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::JointTarget;

/// Hands targets on a fixed number of ticks late. Until the first arrive, the stand holds the joints
/// where they were. The default is none at all.
#[derive(Clone, Debug, Default)]
pub struct Latency {
    /// The oldest first.
    on_the_way: VecDeque<Vec<JointTarget>>,
    arrived: Vec<JointTarget>,
}

impl Latency {
    /// A line of `ticks`, none of them being the drives at once.
    pub fn new(ticks: usize, robot: &RobotModel, joint_position_rad: &[f32]) -> Self {
        let hold = |position_rad: &f32| JointTarget {
            position_rad: *position_rad,
            stiffness_nm_per_rad: robot.stand.stiffness_nm_per_rad,
            damping_nms_per_rad: robot.stand.damping_nms_per_rad,
            feed_forward_nm: 0.0,
        };
        let held: Vec<JointTarget> = joint_position_rad.iter().map(hold).collect();
        Self { on_the_way: vec![held.clone(); ticks].into(), arrived: held }
    }

    /// Sends targets off; what arrives at this tick instead.
    pub fn pass<'a>(&'a mut self, targets: &'a [JointTarget]) -> &'a [JointTarget] {
        let Some(mut due) = self.on_the_way.pop_front() else { return targets };
        // The buffer that is done with carries the newest targets to the end of the line.
        std::mem::swap(&mut due, &mut self.arrived);
        due.clear();
        due.extend_from_slice(targets);
        self.on_the_way.push_back(due);
        &self.arrived
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn target(position_rad: f32) -> [JointTarget; 2] {
        [JointTarget { position_rad, ..JointTarget::default() }; 2]
    }

    #[test]
    fn targets_arrive_as_many_ticks_late_as_asked_and_the_stand_holds_until_then() {
        let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        let robot = RobotModel::load(&robots, "anymal_d").unwrap();
        for ticks in 0..3 {
            let mut line = Latency::new(ticks, &robot, &[0.7, 0.7]);
            let arrivals: Vec<f32> =
                [1.0, 2.0, 3.0, 4.0].map(|sent| line.pass(&target(sent))[1].position_rad).to_vec();
            let wanted = [&[0.7; 2][..ticks], &[1.0, 2.0, 3.0, 4.0][..4 - ticks]].concat();
            assert_eq!(arrivals, wanted, "{ticks} ticks");
        }
        let mut line = Latency::new(1, &robot, &[0.7, 0.7]);
        assert_eq!(line.pass(&target(1.0))[0].stiffness_nm_per_rad, robot.stand.stiffness_nm_per_rad);
    }
}
