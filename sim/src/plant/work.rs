//! The work that joints do, counted step by step.

use super::STEP_S;

/// Work of all joints over some steps.
///
/// ```text
/// positive = Σ_step Σ_joint max(0, τ·½(q̇₀ + q̇₁))·Δt,   signed: without the max
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Work {
    /// Of driving joints, J.
    pub(crate) positive_j: f64,
    /// With braking counted negative, J.
    pub(crate) signed_j: f64,
}

impl Work {
    /// Adds one step: torques held over it, velocities before and after.
    pub(crate) fn add_step(&mut self, torque_nm: &[f32], before_rad_per_s: &[f32], after_rad_per_s: &[f32]) {
        for ((torque, before), after) in torque_nm.iter().zip(before_rad_per_s).zip(after_rad_per_s) {
            let work = f64::from(torque * 0.5 * (before + after) * STEP_S);
            self.signed_j += work;
            self.positive_j += work.max(0.0);
        }
    }
}
