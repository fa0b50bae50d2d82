//! The torque a drive can give at a speed.

/// Torque–speed limits of a drive, the same for every joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Largest torque, N·m.
    pub effort_nm: f32,
    /// Torque at which the driving line meets zero speed, N·m.
    pub saturation_nm: f32,
    /// Speed at which no driving torque is left, rad/s.
    pub velocity_limit_rad_per_s: f32,
}

impl Drive {
    /// The torque that the drive gives when asked for `torque_nm` at `velocity_rad_per_s`.
    ///
    /// ```text
    /// driving (τ·q̇ > 0): |τ| ≤ clamp(saturation·(1 − |q̇| / velocity limit), 0, effort)
    /// braking (τ·q̇ ≤ 0): |τ| ≤ effort
    /// ```
    ///
    /// A torque that is not a number becomes zero: a drive without a set point gives none.
    ///
    /// # Source
    /// The DC motor line of legged robots' actuator models; figures in docs/method.md.
    pub fn limit(&self, torque_nm: f32, velocity_rad_per_s: f32) -> f32 {
        if torque_nm.is_nan() {
            return 0.0;
        }
        let bound = if torque_nm * velocity_rad_per_s > 0.0 {
            let line = self.saturation_nm * (1.0 - velocity_rad_per_s.abs() / self.velocity_limit_rad_per_s);
            line.clamp(0.0, self.effort_nm)
        } else {
            self.effort_nm
        };
        torque_nm.clamp(-bound, bound)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DRIVE: Drive = Drive { effort_nm: 80.0, saturation_nm: 120.0, velocity_limit_rad_per_s: 8.5 };

    #[test]
    fn driving_torque_falls_to_zero_at_the_speed_limit() {
        // 120·(1 − v/8.5) meets 80 at v = 8.5/3.
        for (velocity, expected) in [(0.0, 80.0), (2.8, 80.0), (4.25, 60.0), (8.5, 0.0), (12.0, 0.0)] {
            for sign in [1.0_f32, -1.0] {
                let found = DRIVE.limit(sign * 500.0, sign * velocity);
                assert!((found - sign * expected).abs() < 1e-4, "{velocity} rad/s gave {found} N·m");
            }
        }
    }

    #[test]
    fn braking_torque_is_the_effort_at_any_speed() {
        for velocity in [0.1, 8.5, 30.0] {
            assert!((DRIVE.limit(-500.0, velocity) + 80.0).abs() < f32::EPSILON);
            assert!((DRIVE.limit(500.0, -velocity) - 80.0).abs() < f32::EPSILON);
        }
    }

    #[test]
    fn torque_inside_the_limits_passes_unchanged() {
        assert!((DRIVE.limit(17.5, 4.0) - 17.5).abs() < f32::EPSILON);
        assert!((DRIVE.limit(-17.5, 4.0) + 17.5).abs() < f32::EPSILON);
    }

    #[test]
    fn a_torque_that_is_not_a_number_becomes_zero() {
        assert!(DRIVE.limit(f32::NAN, 1.0).abs() < f32::EPSILON);
    }
}
