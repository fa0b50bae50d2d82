//! The stage of the demo: loads the deployment for each course, drives it, keeps its log.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context as _;
use serde::Serialize;
use vocaloco_core::{
    decision_log::{LogWriter, Setup},
    installation::Installation,
    registry::{LoadedDeployment, load_deployment},
    robot::RobotModel,
    runtime::{Pace, Runtime, Supervision, TickSummary},
};
use vocaloco_sim::{
    course::{CourseConfig, CourseRun, CourseStage, FORWARD_M_PER_S, Outcome, SelectorPilot, drive},
    plant::PlantKind,
    spawn::SpawnRules,
    terrain::{CourseKind, Terrain},
};

use super::{Args, story};
use crate::{
    progress,
    report::{PackedCourse, Story},
    verbs::{noise::NoiseArgs, run::pace::clock},
};

/// Step heights searched for the lowest that walk does not take, cm.
const SEARCHED_CM: std::ops::RangeInclusive<u8> = 14..=30;

/// Everything that stays the same from course to course.
pub(super) struct Stage {
    installation: Installation,
    deployment: String,
    pub(super) robot: Arc<RobotModel>,
    /// Skills with their thresholds, in the deployment's order.
    pub(super) thresholds: Vec<(String, f32)>,
    switch_window: usize,
    seed: u64,
    noise: NoiseArgs,
    out: PathBuf,
}

/// A course that was driven, and what there is to say about it.
pub(super) struct Driven {
    pub(super) run: CourseRun,
    pub(super) terrain: Terrain,
    pub(super) timing: TickSummary,
    pub(super) story: Story,
    /// What the numbers say beyond the outcome; empty when all went as in the paper.
    pub(super) note: String,
}

impl Driven {
    /// Reached, and the skill made for these stairs was never needed.
    pub(super) fn walked_through(&self) -> bool {
        self.run.outcome == Outcome::Reached && !self.run.skills().contains(&story::made_for(&self.run))
    }
}

impl Stage {
    pub(super) fn new(installation: Installation, loaded: &LoadedDeployment, args: &Args) -> Self {
        let threshold = |skill: &vocaloco_core::registry::LoadedSkill| {
            (skill.manifest.name.clone(), skill.manifest.selection.viability_threshold)
        };
        Self {
            installation,
            deployment: args.deployment.clone(),
            robot: Arc::clone(&loaded.robot),
            thresholds: loaded.skills.iter().map(threshold).collect(),
            switch_window: loaded.deployment.switch_window,
            seed: args.shared.seed,
            noise: args.noise,
            out: args.out.clone(),
        }
    }

    fn course(&self, kind: CourseKind, size_m: f32) -> CourseConfig {
        self.noise.on(CourseConfig::demo(kind, size_m, self.seed))
    }

    /// Drives one course and writes its decisions beside the page.
    pub(super) fn drive(&self, kind: CourseKind, size_m: f32, expected: Outcome) -> anyhow::Result<Driven> {
        let what = format!("{} of {:.0} cm", kind.id(), size_m * 100.0);
        let spinner = progress::spinner(&format!("driving {what}"));
        let (run, terrain, timing) = self.simulate(&self.course(kind, size_m)).with_context(|| what)?;
        spinner.finish_and_clear();
        let (story, note) = story::tell(&run, &self.robot, &self.thresholds, expected);
        Ok(Driven { run, terrain, timing, story, note })
    }

    fn simulate(&self, config: &CourseConfig) -> anyhow::Result<(CourseRun, Terrain, TickSummary)> {
        let loaded = load_deployment(&self.installation, &self.deployment)?;
        let deadlines = loaded.deployment.deadlines;
        let supervision = Supervision { clock, deadlines, pace: Pace::Simulated };
        let mut runtime = Runtime::new(loaded)?.supervised(supervision)?;
        let CourseStage { terrain, mut plant } = CourseStage::set(&self.robot, config)?;
        let setup = Setup::of(&runtime, &self.deployment);
        let run = drive(config, &mut SelectorPilot::new(config, &mut plant, &terrain, &mut runtime))?;
        self.log(&run, &setup)?;
        Ok((run, terrain, runtime.times()))
    }

    /// The lowest steps on which the skill made for them is chosen, if there are any.
    pub(super) fn lowest_with_a_switch(&self, kind: CourseKind) -> anyhow::Result<Option<Driven>> {
        for size_cm in SEARCHED_CM.step_by(2) {
            let mut driven = self.drive(kind, f32::from(size_cm) / 100.0, Outcome::Reached)?;
            if !driven.walked_through() {
                let lead = "The lowest steps, searched by 2 cm, that walk alone does not take.";
                driven.story.summary = format!("{lead} {}", driven.story.summary);
                return Ok(Some(driven));
            }
        }
        Ok(None)
    }

    fn log(&self, run: &CourseRun, setup: &Setup) -> anyhow::Result<()> {
        let path = self.out.join(format!("decisions-{}.mcap", story::id(run)));
        let mut log = LogWriter::create(&path, setup)?;
        for decision in run.ticks.iter().filter_map(|tick| tick.decision.as_ref()) {
            log.write(decision)?;
        }
        Ok(log.finish()?)
    }

    pub(super) fn packed(&self, driven: &Driven) -> PackedCourse {
        PackedCourse::new(driven.story.clone(), &driven.run, &self.robot, &driven.terrain, &self.thresholds)
    }

    /// The fully expanded configuration, with the command that repeats it.
    pub(super) fn config(&self, command: &str, driven: &[Driven]) -> Config {
        let courses = driven.iter().map(|Driven { run, .. }| {
            let CourseConfig { kind, size_m, steps, start_m, spawn, noise, field_noise_m, .. } =
                self.course(run.kind, run.size_m);
            CourseEntry {
                course: kind.id(),
                size_m,
                steps,
                start_m,
                spawn,
                field_noise_m,
                joint_position_noise_rad: noise.joint_position_rad,
                joint_velocity_noise_rad_per_s: noise.joint_velocity_rad_per_s,
                linear_velocity_noise_m_per_s: noise.linear_velocity_m_per_s,
                angular_velocity_noise_rad_per_s: noise.angular_velocity_rad_per_s,
                gravity_noise: noise.gravity,
                patch_noise_m: noise.patch_m,
            }
        });
        Config {
            schema: 1,
            command: command.to_owned(),
            seed: self.seed,
            version: env!("CARGO_PKG_VERSION"),
            deployment: self.deployment.clone(),
            robot: self.robot.name.clone(),
            robot_files: self.robot.file_hashes.iter().cloned().collect(),
            plant: PlantKind::Reference.id(),
            switch_window: self.switch_window,
            viability_thresholds: self.thresholds.iter().cloned().collect(),
            forward_m_per_s: FORWARD_M_PER_S,
            courses: courses.collect(),
        }
    }
}

/// `config.json`.
#[derive(Serialize)]
pub(super) struct Config {
    schema: u32,
    command: String,
    seed: u64,
    version: &'static str,
    deployment: String,
    robot: String,
    robot_files: BTreeMap<String, String>,
    plant: &'static str,
    switch_window: usize,
    viability_thresholds: BTreeMap<String, f32>,
    forward_m_per_s: f32,
    courses: Vec<CourseEntry>,
}

#[derive(Serialize)]
struct CourseEntry {
    course: &'static str,
    size_m: f32,
    steps: usize,
    start_m: [f32; 2],
    spawn: SpawnRules,
    field_noise_m: f32,
    joint_position_noise_rad: f32,
    joint_velocity_noise_rad_per_s: f32,
    linear_velocity_noise_m_per_s: f32,
    angular_velocity_noise_rad_per_s: f32,
    gravity_noise: f32,
    patch_noise_m: f32,
}
