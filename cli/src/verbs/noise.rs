//! The noise on heights, as the flags that every verb with a course or rollouts shares.

use std::fmt;

use anyhow::ensure;
use serde::Serialize;
use vocaloco_sim::{course::CourseConfig, driver::SensorNoise};

#[derive(clap::Args, Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct NoiseArgs {
    /// Half-width of the noise on every height that the predictors see, m
    #[arg(long, default_value_t = Self::PROTOCOL.field_noise_m, value_name = "M")]
    pub(crate) field_noise_m: f32,
    /// Half-width of the noise on every height that the skills see, m
    #[arg(long, default_value_t = Self::PROTOCOL.patch_noise_m, value_name = "M")]
    pub(crate) patch_noise_m: f32,
}

impl NoiseArgs {
    /// As in docs/method.md.
    pub(crate) const PROTOCOL: Self = Self { field_noise_m: 0.1, patch_noise_m: 0.02 };

    /// Whether these are numbers to measure with.
    pub(crate) fn check(self) -> anyhow::Result<()> {
        for (flag, noise_m) in [("field", self.field_noise_m), ("patch", self.patch_noise_m)] {
            ensure!((0.0..=1.0).contains(&noise_m), "--{flag}-noise-m: found {noise_m}, wanted 0 to 1");
        }
        Ok(())
    }

    /// The course with this noise.
    pub(crate) fn on(self, course: CourseConfig) -> CourseConfig {
        CourseConfig {
            noise: SensorNoise { patch_m: self.patch_noise_m, ..course.noise },
            field_noise_m: self.field_noise_m,
            ..course
        }
    }
}

/// As a command names it.
impl fmt::Display for NoiseArgs {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { field_noise_m, patch_noise_m } = self;
        write!(formatter, "--field-noise-m {field_noise_m} --patch-noise-m {patch_noise_m}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_that_is_none_is_refused_by_its_flag_and_the_rest_is_named_as_given() {
        let protocol = NoiseArgs::PROTOCOL;
        assert!(protocol.check().is_ok());
        assert_eq!(protocol.to_string(), "--field-noise-m 0.1 --patch-noise-m 0.02");
        for wrong in [-0.1, 1.5, f32::NAN] {
            let refused = |noise: NoiseArgs| noise.check().unwrap_err().to_string();
            let field = refused(NoiseArgs { field_noise_m: wrong, ..protocol });
            assert_eq!(field, format!("--field-noise-m: found {wrong}, wanted 0 to 1"));
            let patch = refused(NoiseArgs { patch_noise_m: wrong, ..protocol });
            assert_eq!(patch, format!("--patch-noise-m: found {wrong}, wanted 0 to 1"));
        }
    }
}
