//! What joints and contacts did in rollouts, in counts, so that rollouts add up in any order.

use vocaloco_plugin_api::JointTarget;

use crate::{driver::TICK_S, plant::Measurement};

/// Counts of a non-negative quantity in bins of equal width; the last bin takes all that is beyond.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    bin: f32,
    counts: Vec<u64>,
}

impl Histogram {
    fn new(bin: f32, bins: usize) -> Self {
        Self { bin, counts: vec![0; bins] }
    }

    fn add(&mut self, value: f32) {
        let last = self.counts.len() - 1;
        self.counts[((value.abs() / self.bin) as usize).min(last)] += 1;
    }

    fn merge(&mut self, other: &Self) {
        for (count, more) in self.counts.iter_mut().zip(&other.counts) {
            *count += more;
        }
    }

    /// The upper edge of the bin below which a share of the values lies; 0 without values.
    pub fn quantile(&self, share: f64) -> f64 {
        let total: u64 = self.counts.iter().sum();
        let wanted = share * total as f64;
        let mut seen = 0;
        for (index, count) in self.counts.iter().enumerate() {
            seen += count;
            if seen > 0 && seen as f64 >= wanted {
                return (index + 1) as f64 * f64::from(self.bin);
            }
        }
        0.0
    }
}

/// Joints and contacts of one or more rollouts.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Absolute joint torque in bins of 0.5 N·m, every joint and physics step.
    pub torque_nm: Histogram,
    /// Absolute joint speed in bins of 0.05 rad/s, every joint and physics step.
    pub speed_rad_per_s: Histogram,
    speed_limit_rad_per_s: f32,
    over_limit: u64,
    joint_samples: u64,
    nonfoot_contacts: u64,
    steps: u64,
    target_change_rad: f64,
    target_changes: u64,
    last_targets_rad: Vec<f32>,
}

impl Motion {
    /// Nothing yet, for drives with the given speed limit.
    pub fn new(speed_limit_rad_per_s: f32) -> Self {
        Self {
            torque_nm: Histogram::new(0.5, 200),
            speed_rad_per_s: Histogram::new(0.05, 1000),
            speed_limit_rad_per_s,
            over_limit: 0,
            joint_samples: 0,
            nonfoot_contacts: 0,
            steps: 0,
            target_change_rad: 0.0,
            target_changes: 0,
            last_targets_rad: Vec::new(),
        }
    }

    pub(super) fn add_step(&mut self, measured: &Measurement) {
        for torque_nm in &measured.joint_torque_nm {
            self.torque_nm.add(*torque_nm);
        }
        for speed in &measured.joint_velocity_rad_per_s {
            self.speed_rad_per_s.add(*speed);
            self.over_limit += u64::from(speed.abs() > self.speed_limit_rad_per_s);
            self.joint_samples += 1;
        }
        self.nonfoot_contacts += u64::from(measured.nonfoot_contact);
        self.steps += 1;
    }

    pub(super) fn add_targets(&mut self, targets: &[JointTarget]) {
        for (last, target) in self.last_targets_rad.iter().zip(targets) {
            self.target_change_rad += f64::from((target.position_rad - last).abs());
            self.target_changes += 1;
        }
        self.last_targets_rad.clear();
        self.last_targets_rad.extend(targets.iter().map(|target| target.position_rad));
    }

    /// Adds another rollout's motion.
    pub fn merge(&mut self, other: &Self) {
        self.torque_nm.merge(&other.torque_nm);
        self.speed_rad_per_s.merge(&other.speed_rad_per_s);
        self.over_limit += other.over_limit;
        self.joint_samples += other.joint_samples;
        self.nonfoot_contacts += other.nonfoot_contacts;
        self.steps += other.steps;
        self.target_change_rad += other.target_change_rad;
        self.target_changes += other.target_changes;
    }

    /// Share of joint samples beyond the drive's speed limit.
    pub fn speed_over_limit_share(&self) -> f64 {
        share(self.over_limit, self.joint_samples)
    }

    /// Share of physics steps in which something other than a foot touched.
    pub fn nonfoot_contact_share(&self) -> f64 {
        share(self.nonfoot_contacts, self.steps)
    }

    /// Mean absolute rate of change of the joints' target positions from tick to tick, rad/s.
    pub fn action_rate_rad_per_s(&self) -> f64 {
        if self.target_changes == 0 {
            0.0
        } else {
            self.target_change_rad / self.target_changes as f64 / TICK_S
        }
    }
}

fn share(part: u64, whole: u64) -> f64 {
    if whole == 0 { 0.0 } else { part as f64 / whole as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantile_is_the_upper_edge_of_its_bin() {
        let mut histogram = Histogram::new(0.5, 10);
        assert_eq!(histogram.quantile(0.99), 0.0);
        for n in 0..99 {
            histogram.add(if n % 2 == 0 { 0.2 } else { -0.7 });
        }
        histogram.add(100.0);
        assert_eq!(histogram.quantile(0.5), 0.5);
        assert_eq!(histogram.quantile(0.99), 1.0);
        assert_eq!(histogram.quantile(1.0), 5.0, "beyond the last bin");
    }

    #[test]
    fn merging_is_adding() {
        let target = |position_rad| JointTarget { position_rad, ..JointTarget::default() };
        let mut first = Motion::new(8.5);
        first.add_targets(&[target(0.0), target(0.0)]);
        first.add_targets(&[target(0.1), target(-0.3)]);
        let mut second = Motion::new(8.5);
        second.add_targets(&[target(1.0)]);
        second.merge(&first);
        // Two changes of 0.1 and 0.3 rad in 0.02 s; another rollout's first targets are no change.
        assert!((second.action_rate_rad_per_s() - 10.0).abs() < 1e-5);
    }
}
