//! Who chooses on a course, and what they see: the arguments that `evaluate success` and `evaluate course` share.

use anyhow::ensure;
use vocaloco_sim::terrain::CourseKind;

use super::success::Sight;
use super::who::Who;
use crate::verbs::noise::NoiseArgs;

#[derive(clap::Args)]
pub(super) struct ArenaArgs {
    /// Who chooses: `vocaloco`, `oracle` (the same, fed with what was collected), `skill:NAME` (alone)
    #[arg(long, value_delimiter = ',', default_value = "vocaloco", value_name = "LIST")]
    pub(super) selector: Vec<Who>,
    /// Deployment whose skills may run
    #[arg(long, default_value = "anymal_stairs", value_name = "NAME")]
    pub(super) deployment: String,
    /// Rollouts a skill, terrain and height that the oracle knows
    #[arg(long, default_value_t = 100, value_name = "N")]
    pub(super) oracle_samples: u64,
    /// What the predictors see: everything, or what depth cameras have seen, the rest filled
    #[arg(long, value_enum, default_value_t = Sight::None)]
    pub(super) occlusion: Sight,
    #[command(flatten)]
    pub(super) noise: NoiseArgs,
}

/// The sizes that a course is driven with: those given or, where none are, its own, which on the courses of
/// stairs are `stairs_m`.
pub(super) fn sizes_m(course: CourseKind, given_m: &[f32], stairs_m: &[f32]) -> Vec<f32> {
    match (given_m, course) {
        ([], CourseKind::Obstacles) => vec![course.demo_size_m()],
        ([], _) => stairs_m.to_vec(),
        (given_m, _) => given_m.to_vec(),
    }
}

/// `--course` and `--size-m` of a command that repeats this; sizes that differ by course are left to be its own.
pub(super) fn courses_flag(courses: &[CourseKind], given_m: &[f32], stairs_m: &[f32]) -> String {
    let ids: Vec<&str> = courses.iter().map(|course| course.id()).collect();
    let mut lists = courses.iter().map(|course| sizes_m(*course, given_m, stairs_m));
    let first = lists.next().unwrap_or_default();
    let sizes = if lists.all(|list| list == first) {
        let sizes: Vec<String> = first.iter().map(ToString::to_string).collect();
        format!(" --size-m {}", sizes.join(","))
    } else {
        String::new()
    };
    format!("--course {}{sizes}", ids.join(","))
}

impl ArenaArgs {
    /// Whether these, and the steps and heights of the courses, are numbers to measure with.
    pub(super) fn check(&self, steps: usize, sizes_m: &[f32]) -> anyhow::Result<()> {
        ensure!(self.oracle_samples > 0, "--oracle-samples: found 0, wanted 1 or more");
        ensure!((1..=40).contains(&steps), "--steps: found {steps}, wanted 1 to 40");
        for size_m in sizes_m {
            ensure!((0.0..=1.0).contains(size_m), "--size-m: found {size_m}, wanted 0 to 1");
        }
        self.noise.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_names_the_sizes_unless_courses_have_each_their_own() {
        use CourseKind::{Obstacles, StairsUp};
        let flag = |courses: &[CourseKind], given_m: &[f32]| courses_flag(courses, given_m, &[0.1, 0.2]);
        assert_eq!(flag(&[StairsUp], &[]), "--course stairs_up --size-m 0.1,0.2");
        assert_eq!(flag(&[Obstacles], &[]), "--course obstacles --size-m 0.5");
        assert_eq!(flag(&[StairsUp, Obstacles], &[]), "--course stairs_up,obstacles");
        assert_eq!(flag(&[StairsUp, Obstacles], &[0.3]), "--course stairs_up,obstacles --size-m 0.3");
    }
}
