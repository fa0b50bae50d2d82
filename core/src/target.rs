//! Position targets: set ahead of the base in the odometry frame, given anew each tick as the base sees
//! them. One place for the loop, for rollouts and for training.

use std::f32::consts::{PI, TAU};

use vocaloco_plugin_api::{Command, CommandKind};

use crate::manifest::SkillManifest;
use crate::observation::BaseInOdom;

/// A target counts as reached from here on, m, along the way to it: as near as a policy may rest (`near_m` of a
/// `training.toml`), so that none waits before it for its time to be over.
const REACHED_M: f32 = 0.15;

/// How far ahead a skill's targets are set, and the time it has for each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TargetRule {
    /// Length of the way, m.
    pub distance_m: f32,
    /// s.
    pub time_s: f64,
}

impl TargetRule {
    /// A manifest's; none of a skill that follows velocities.
    pub fn of(manifest: &SkillManifest) -> Option<Self> {
        let distance_m = manifest.command.target_distance_m? as f32;
        Some(Self { distance_m, time_s: manifest.rollout.time_limit_s })
    }

    /// Where a skill goes that is on its way to `going`: there until it is over, then to the next target,
    /// set as [`PositionTarget::ahead`] says.
    pub fn follow(
        &self,
        going: Option<PositionTarget>,
        base: &BaseInOdom,
        velocity: [f32; 2],
        now_s: f64,
    ) -> PositionTarget {
        let going = going.filter(|target| !target.is_over(base, now_s));
        going.unwrap_or_else(|| PositionTarget::ahead(base, velocity, self.distance_m, self.time_s, now_s))
    }
}

/// A pose to be reached in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionTarget {
    /// In the odometry frame, m.
    position_m: [f32; 2],
    /// Direction of the way to it, and the heading to arrive with, rad, odometry frame.
    yaw_rad: f32,
    /// When its time is over, s.
    until_s: f64,
}

impl PositionTarget {
    /// Ahead of `base` along the commanded velocity, or along its heading where that has no direction.
    ///
    /// | argument | meaning | unit | frame |
    /// |---|---|---|---|
    /// | `base` | where the way begins | m | odometry |
    /// | `velocity` | commanded forward, left | m/s | yaw-aligned base |
    /// | `distance_m`, `time_s` | length of the way, and the time for it | m, s | |
    /// | `now_s` | time of the measurement | s | |
    pub fn ahead(base: &BaseInOdom, velocity: [f32; 2], distance_m: f32, time_s: f64, now_s: f64) -> Self {
        let [forward, left] = velocity;
        let turn_rad = if forward == 0.0 && left == 0.0 { 0.0 } else { libm::atan2f(left, forward) };
        let yaw_rad = wrapped_rad(base.yaw_rad() + turn_rad);
        let (sin, cos) = libm::sincosf(yaw_rad);
        let [x, y] = base.position_xy_m();
        let position_m = [x + distance_m * cos, y + distance_m * sin];
        Self { position_m, yaw_rad, until_s: now_s + time_s }
    }

    /// Whether it is reached or its time is over.
    pub fn is_over(&self, base: &BaseInOdom, now_s: f64) -> bool {
        let (sin, cos) = libm::sincosf(self.yaw_rad);
        let [x, y] = base.position_xy_m();
        let along_m = cos * (self.position_m[0] - x) + sin * (self.position_m[1] - y);
        along_m <= REACHED_M || now_s >= self.until_s
    }

    /// The command of this tick; `velocity` goes along for whoever looks at it.
    pub fn command(&self, base: &BaseInOdom, velocity: [f32; 3], now_s: f64) -> Command {
        let yaw_rad = base.yaw_rad();
        let (sin, cos) = libm::sincosf(yaw_rad);
        let [x, y] = base.position_xy_m();
        let (dx, dy) = (self.position_m[0] - x, self.position_m[1] - y);
        let left_s = (self.until_s - now_s).max(0.0) as f32;
        let target = [cos * dx + sin * dy, cos * dy - sin * dx, wrapped_rad(self.yaw_rad - yaw_rad), left_s];
        Command { kind: CommandKind::PositionTarget, velocity, target }
    }
}

impl BaseInOdom {
    /// Rotation about the vertical, rad: the direction of the base's x axis, seen from above.
    pub fn yaw_rad(&self) -> f32 {
        let [x, y, z, w] = self.orientation_xyzw.map(|value| value as f32);
        libm::atan2f(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    }

    fn position_xy_m(&self) -> [f32; 2] {
        [self.position_m[0] as f32, self.position_m[1] as f32]
    }
}

/// The same angle within ±π.
fn wrapped_rad(angle_rad: f32) -> f32 {
    angle_rad - TAU * libm::floorf((angle_rad + PI) / TAU)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn base(x: f32, y: f32, yaw_rad: f32) -> BaseInOdom {
        let (sin, cos) = libm::sincosf(yaw_rad / 2.0);
        BaseInOdom {
            position_m: [x.into(), y.into(), 0.5],
            orientation_xyzw: [0.0, 0.0, sin.into(), cos.into()],
        }
    }

    fn close(found: [f32; 4], wanted: [f32; 4]) {
        let off = found.iter().zip(wanted).map(|(found, wanted)| (found - wanted).abs()).fold(0.0, f32::max);
        assert!(off < 1e-5, "{found:?}, {wanted:?}");
    }

    #[test]
    fn a_target_lies_ahead_and_stays_where_it_is_while_the_base_moves() {
        let start = base(3.0, -1.0, PI / 2.0);
        let target = PositionTarget::ahead(&start, [0.6, 0.0], 1.5, 6.0, 10.0);
        let seen = |base: &BaseInOdom, now_s| target.command(base, [0.6, 0.0, 0.0], now_s).target;
        close(seen(&start, 10.0), [1.5, 0.0, 0.0, 6.0]);
        close(seen(&base(3.0, 0.0, PI / 2.0), 12.0), [0.5, 0.0, 0.0, 4.0]);
        close(seen(&base(3.2, -1.0, 0.0), 20.0), [-0.2, 1.5, PI / 2.0, 0.0]);
    }

    #[test]
    fn it_lies_along_the_commanded_direction() {
        let target = PositionTarget::ahead(&base(0.0, 0.0, 0.0), [0.0, 0.5], 2.0, 6.0, 0.0);
        close(target.command(&base(0.0, 0.0, 0.0), [0.0; 3], 0.0).target, [0.0, 2.0, PI / 2.0, 6.0]);
    }

    #[test]
    fn it_is_over_when_the_way_is_gone_or_the_time() {
        let target = PositionTarget::ahead(&base(0.0, 0.0, 0.0), [0.6, 0.0], 1.5, 6.0, 0.0);
        assert!(!target.is_over(&base(1.3, 0.3, 0.2), 5.9));
        assert!(target.is_over(&base(1.46, 0.3, 0.2), 5.9), "sideways does not count");
        assert!(target.is_over(&base(0.1, 0.0, 0.0), 6.0));
    }

    #[test]
    fn the_next_target_is_set_where_the_last_is_over() {
        let rule = TargetRule { distance_m: 2.0, time_s: 6.0 };
        let straight = |going, x, now_s| rule.follow(going, &base(x, 0.0, 0.0), [0.6, 0.0], now_s);
        let first = straight(None, 0.0, 0.0);
        assert_eq!(straight(Some(first), 1.8, 5.9), first, "neither reached nor out of time");
        for (x, now_s) in [(1.96, 3.0), (0.5, 6.0)] {
            let next = straight(Some(first), x, now_s);
            close(next.command(&base(x, 0.0, 0.0), [0.0; 3], now_s).target, [2.0, 0.0, 0.0, 6.0]);
        }
    }

    #[test]
    fn angles_are_wrapped_across_the_back() {
        let target = PositionTarget::ahead(&base(0.0, 0.0, 3.0), [0.6, 0.0], 1.0, 6.0, 0.0);
        let heading_rad = target.command(&base(0.0, 0.0, -3.0), [0.0; 3], 0.0).target[2];
        assert!((heading_rad - (6.0 - TAU)).abs() < 1e-5, "{heading_rad}");
    }
}
