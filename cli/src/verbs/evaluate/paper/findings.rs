//! Every experiment, in the order of its worth: what was measured, read from the store where it stands.

use std::path::Path;

use anyhow::Context;
use indicatif::ProgressBar;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use vocaloco_core::{
    danger::{Danger, danger},
    decision::Decision,
};
use vocaloco_sim::{
    collected::Collected,
    course::{CourseConfig, CourseRun, SuccessRow},
    occlusion::Occlusion,
    terrain::{CourseKind, TerrainKind},
};

use super::super::arena::{Arena, Sampling, Variation};
use super::super::course::drive;
use super::super::store::as_written;
use super::super::who::Who;
use super::plan::Plan;
use crate::verbs::noise::NoiseArgs;

/// The two staircases.
pub(super) const STAIRS: [CourseKind; 2] = [CourseKind::StairsUp, CourseKind::StairsDown];

/// Everything that was measured.
pub(super) struct Findings {
    /// What skills and predictors are worth, by skill, terrain and height.
    pub(super) cells: Vec<Collected>,
    /// Both staircases, every selector and height.
    pub(super) success: Vec<SuccessRow>,
    /// The course that mixes flat and stairs.
    pub(super) mixed: Vec<SuccessRow>,
    /// By window, ticks.
    pub(super) windows: Vec<(usize, SuccessRow)>,
    /// The oracle's, by the horizon of what it knows, m.
    pub(super) horizons: Vec<(f32, SuccessRow)>,
    /// By one threshold for all skills.
    pub(super) thresholds: Vec<(f32, SuccessRow)>,
    /// By what the predictors see.
    pub(super) sights: Vec<SuccessRow>,
    /// The course of obstacles: with the skills added for it, committed and free, without them, and the baseline.
    pub(super) obstacles: Vec<SuccessRow>,
    /// Courses with every tick.
    pub(super) runs: Vec<Recorded>,
}

/// A course with every tick, packed for the page.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Recorded {
    pub(super) course: CourseKind,
    pub(super) size_m: f32,
    pub(super) selector: String,
    pub(super) outcome: String,
    pub(super) cot: Option<f64>,
    /// Active skills in the order of use.
    pub(super) skills: Vec<String>,
    pub(super) packed: Value,
    /// Of the first change after setting off or, without one, of the tick in which skills are worth least.
    pub(super) danger: Option<DangerMap>,
    pub(super) ticks: Vec<Moment>,
}

/// A tick, for the static figures.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Moment {
    pub(super) t_s: f64,
    pub(super) active: String,
    /// Viability and cost by skill, where predicted.
    pub(super) predictions: Vec<(Option<f32>, Option<f32>)>,
}

/// Which cells drive each skill's viability, at one tick of a run.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct DangerMap {
    pub(super) tick: u64,
    pub(super) t_s: f64,
    pub(super) skills: Vec<DangerOf>,
}

/// The same for one skill.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct DangerOf {
    pub(super) name: String,
    pub(super) level: f32,
    pub(super) here: f32,
    pub(super) credit: Vec<f32>,
}

/// Measures what does not stand.
pub(super) struct Measuring<'a> {
    pub(super) arena: &'a Arena,
    /// The same skills with thresholds that promise something.
    pub(super) promised: Option<&'a Arena>,
    /// The same skills and others added to them, for the course of obstacles.
    pub(super) added: Option<&'a Arena>,
    pub(super) plan: &'a Plan,
    pub(super) baseline: &'a Who,
    pub(super) out: &'a Path,
    pub(super) bar: &'a ProgressBar,
}

impl Measuring<'_> {
    /// Who is compared on the staircases, in the order of the figures.
    pub(super) fn selectors(&self) -> Vec<Who> {
        let alone = self.arena.names().into_iter().map(|name| Who::Skill(name.to_owned()));
        let first = [Who::Vocaloco, Who::Oracle, self.baseline.clone()];
        let mut selectors: Vec<Who> = first.into_iter().chain(alone).collect();
        selectors.dedup();
        selectors
    }

    /// Rollouts of every experiment together, for the progress.
    pub(super) fn pieces(&self) -> u64 {
        let plan = self.plan;
        let skills = self.arena.names().len() as u64;
        let (sizes, both) = (plan.sizes_m.len() as u64, STAIRS.len() as u64);
        let selectors = self.selectors().len() as u64;
        let ablations = both
            * plan.ablation_rollouts
            * (plan.windows.len() * plan.window_sizes_m.len()
                + plan.horizons_m.len() * plan.horizon_sizes_m.len()
                + plan.thresholds.len() * plan.threshold_sizes_m.len()
                + 3 * plan.camera_sizes_m.len()) as u64;
        skills * plan.samples * (1 + both * sizes)
            + both * sizes * selectors * plan.rollouts
            + self.promised.map_or(0, |_| both * sizes * plan.promised_rollouts)
            + plan.mixed_sizes_m.len() as u64 * selectors * plan.rollouts
            + self.added.map_or(0, |_| 4 * plan.rollouts)
            + ablations
    }

    pub(super) fn all(&self) -> anyhow::Result<Findings> {
        Ok(Findings {
            runs: self.runs()?,
            cells: self.cells()?,
            success: [self.success()?, self.promised()?].concat(),
            mixed: self.mixed()?,
            windows: self.windows()?,
            horizons: self.horizons()?,
            thresholds: self.thresholds()?,
            sights: self.sights()?,
            obstacles: self.obstacles()?,
        })
    }

    fn sampling(&self) -> Sampling {
        // The noise of the protocol, as courses have it too.
        Sampling {
            samples: self.plan.samples,
            seed: self.plan.seed,
            field_noise_m: NoiseArgs::PROTOCOL.field_noise_m,
            patch_noise_m: NoiseArgs::PROTOCOL.patch_noise_m,
            horizon_m: None,
        }
    }

    fn cells(&self) -> anyhow::Result<Vec<Collected>> {
        let mut cells = Vec::new();
        for skill in self.arena.names() {
            let mut cell = |terrain, size_m: f32| -> anyhow::Result<()> {
                self.bar.set_message(format!("{skill} on {terrain} of {size_m:.3} m"));
                let progress = || self.bar.inc(1);
                cells.push(self.arena.cell(skill, terrain, size_m, self.sampling(), &progress)?);
                Ok(())
            };
            cell(TerrainKind::Flat, 0.0)?;
            for terrain in [TerrainKind::StairsUp, TerrainKind::StairsDown] {
                for size_m in &self.plan.sizes_m {
                    cell(terrain, *size_m)?;
                }
            }
        }
        Ok(cells)
    }

    fn config(&self, course: CourseKind, size_m: f32) -> CourseConfig {
        let evaluation = CourseConfig::evaluation(course, size_m, self.plan.seed, 0);
        CourseConfig { steps: self.plan.steps, ..evaluation }
    }

    fn row(
        &self,
        config: &CourseConfig,
        n: u64,
        (who, variation): (&Who, Variation),
    ) -> anyhow::Result<SuccessRow> {
        self.bar.set_message(format!("{who} on {} of {:.3} m", config.kind.id(), config.size_m));
        let progress = |n| self.bar.inc(n);
        self.arena.row(config, n, (who, variation), self.plan.samples, &progress)
    }

    fn success(&self) -> anyhow::Result<Vec<SuccessRow>> {
        let mut rows = Vec::new();
        for who in self.selectors() {
            for course in STAIRS {
                for size_m in &self.plan.sizes_m {
                    let config = self.config(course, *size_m);
                    rows.push(self.row(&config, self.plan.rollouts, (&who, Variation::default()))?);
                }
            }
        }
        Ok(rows)
    }

    /// The staircases again, with thresholds that promise something.
    fn promised(&self) -> anyhow::Result<Vec<SuccessRow>> {
        let Some(arena) = self.promised else { return Ok(Vec::new()) };
        let mut rows = Vec::new();
        for course in STAIRS {
            for size_m in &self.plan.sizes_m {
                let config = self.config(course, *size_m);
                self.bar.set_message(format!("{PROMISED} on {} of {size_m:.3} m", course.id()));
                let (who, n) = ((&Who::Vocaloco, Variation::default()), self.plan.promised_rollouts);
                let mut row = arena.row(&config, n, who, self.plan.samples, &|n| self.bar.inc(n))?;
                PROMISED.clone_into(&mut row.selector);
                rows.push(row);
            }
        }
        Ok(rows)
    }

    /// The course of obstacles: with the skills added for it, committed and free, without them, and the baseline.
    fn obstacles(&self) -> anyhow::Result<Vec<SuccessRow>> {
        let Some(added) = self.added else { return Ok(Vec::new()) };
        let kind = CourseKind::Obstacles;
        let config = CourseConfig { steps: self.plan.demo_steps, ..self.config(kind, kind.demo_size_m()) };
        let baseline = self.baseline.to_string();
        let free = Variation { without_commitment: true, ..Variation::default() };
        let mut rows = Vec::new();
        for (arena, who, variation, selector) in [
            (added, Who::Vocaloco, Variation::default(), ADDED),
            (added, Who::Vocaloco, free, FREE),
            (self.arena, Who::Vocaloco, Variation::default(), "vocaloco"),
            (self.arena, self.baseline.clone(), Variation::default(), &baseline),
        ] {
            self.bar.set_message(format!("{selector} on {}", config.kind.id()));
            let chosen = (&who, variation);
            let mut row =
                arena.row(&config, self.plan.rollouts, chosen, self.plan.samples, &|n| self.bar.inc(n))?;
            selector.clone_into(&mut row.selector);
            rows.push(row);
        }
        Ok(rows)
    }

    fn mixed(&self) -> anyhow::Result<Vec<SuccessRow>> {
        let without_cost = Variation { without_cost: true, ..Variation::default() };
        let as_it_is = self.selectors().into_iter().map(|who| (who, Variation::default()));
        // The oracle is about predictions, not about energy.
        let compared = as_it_is.filter(|(who, _)| *who != Who::Oracle);
        let compared: Vec<_> = compared.chain([(Who::Vocaloco, without_cost)]).collect();
        let mut rows = Vec::new();
        for size_m in &self.plan.mixed_sizes_m {
            let config = self.config(CourseKind::Mixed, *size_m);
            for (who, variation) in &compared {
                let mut row = self.row(&config, self.plan.rollouts, (who, *variation))?;
                if variation.without_cost {
                    WITHOUT_COST.clone_into(&mut row.selector);
                }
                rows.push(row);
            }
        }
        Ok(rows)
    }

    fn windows(&self) -> anyhow::Result<Vec<(usize, SuccessRow)>> {
        let mut rows = Vec::new();
        for window in &self.plan.windows {
            let variation = Variation { window: Some(*window), ..Variation::default() };
            for row in self.ablation(variation, &self.plan.window_sizes_m, Occlusion::None)? {
                rows.push((*window, row));
            }
        }
        Ok(rows)
    }

    fn horizons(&self) -> anyhow::Result<Vec<(f32, SuccessRow)>> {
        let mut rows = Vec::new();
        for horizon_m in &self.plan.horizons_m {
            let variation = Variation { horizon_m: Some(*horizon_m), ..Variation::default() };
            for course in STAIRS {
                for size_m in &self.plan.horizon_sizes_m {
                    let (config, n) = (self.config(course, *size_m), self.plan.ablation_rollouts);
                    self.bar
                        .set_message(format!("horizon {horizon_m} m on {} of {size_m:.3} m", course.id()));
                    let (who, samples) = ((&Who::Oracle, variation), self.plan.horizon_samples);
                    let row = self.arena.row(&config, n, who, samples, &|n| self.bar.inc(n))?;
                    rows.push((*horizon_m, row));
                }
            }
        }
        Ok(rows)
    }

    fn thresholds(&self) -> anyhow::Result<Vec<(f32, SuccessRow)>> {
        let mut rows = Vec::new();
        for threshold in &self.plan.thresholds {
            let variation = Variation { threshold: Some(*threshold), ..Variation::default() };
            for row in self.ablation(variation, &self.plan.threshold_sizes_m, Occlusion::None)? {
                rows.push((*threshold, row));
            }
        }
        Ok(rows)
    }

    fn sights(&self) -> anyhow::Result<Vec<SuccessRow>> {
        let mut rows = Vec::new();
        for sight in [Occlusion::None, Occlusion::Camera, Occlusion::CameraUnfilled] {
            rows.extend(self.ablation(Variation::default(), &self.plan.camera_sizes_m, sight)?);
        }
        Ok(rows)
    }

    fn ablation(
        &self,
        variation: Variation,
        sizes_m: &[f32],
        occlusion: Occlusion,
    ) -> anyhow::Result<Vec<SuccessRow>> {
        let mut rows = Vec::new();
        for course in STAIRS {
            for size_m in sizes_m {
                let config = CourseConfig { occlusion, ..self.config(course, *size_m) };
                rows.push(self.row(&config, self.plan.ablation_rollouts, (&Who::Vocaloco, variation))?);
            }
        }
        Ok(rows)
    }

    /// The demo's staircases, the course of energy, and steps that no skill takes: with the method, and with
    /// the baseline where it matters; the course of obstacles with the skills added for it.
    fn runs(&self) -> anyhow::Result<Vec<Recorded>> {
        let Plan { demo_size_m, demo_steps, wall_size_m, seed, .. } = *self.plan;
        let wanted = [
            (CourseKind::StairsUp, demo_size_m, Who::Vocaloco),
            (CourseKind::StairsDown, demo_size_m, Who::Vocaloco),
            (CourseKind::StairsUp, wall_size_m, Who::Vocaloco),
            (CourseKind::StairsUp, wall_size_m, self.baseline.clone()),
            (CourseKind::Mixed, demo_size_m, Who::Vocaloco),
        ];
        let obstacles = CourseKind::Obstacles;
        let added = self.added.map(|arena| (arena, obstacles, obstacles.demo_size_m(), Who::Vocaloco));
        let wanted = wanted.map(|(course, size_m, who)| (self.arena, course, size_m, who));
        let mut runs = Vec::new();
        for (arena, course, size_m, who) in wanted.into_iter().chain(added) {
            self.bar.set_message(format!("{who} on {} of {size_m:.3} m, recorded", course.id()));
            let config = CourseConfig { steps: demo_steps, ..CourseConfig::demo(course, size_m, seed) };
            runs.push(self.run(arena, &config, &who)?);
        }
        Ok(runs)
    }

    fn run(&self, arena: &Arena, config: &CourseConfig, who: &Who) -> anyhow::Result<Recorded> {
        arena.recorded(config, who, || {
            let driven = drive(arena, config, who, self.plan.samples, &self.out.join("logs"))?;
            let run = &driven.run;
            let all = || run.ticks.iter().filter_map(|tick| tick.decision.as_ref());
            let danger = telling(run).filter(|_| STAIRS.contains(&config.kind));
            let danger = danger.map(|decision| self.danger(decision));
            Ok(Recorded {
                course: config.kind,
                size_m: config.size_m,
                selector: who.to_string(),
                outcome: run.outcome.id().to_owned(),
                cot: run.cot,
                skills: run.skills().into_iter().map(str::to_owned).collect(),
                packed: as_written(&driven.packed)?,
                danger: danger.transpose()?.flatten(),
                ticks: all().map(moment).collect(),
            })
        })
    }

    fn danger(&self, decision: &Decision) -> anyhow::Result<Option<DangerMap>> {
        let Some(field) = &decision.field else { return Ok(None) };
        let mut skills = Vec::new();
        for name in self.arena.names() {
            let mut predictor = self.arena.viability(name)?;
            let Danger { level, here, credit } = danger(field, |field| predictor.predict(field))
                .with_context(|| format!("viability of {name}"))?;
            skills.push(DangerOf { name: name.to_owned(), level, here, credit });
        }
        Ok(Some(DangerMap { tick: decision.tick, t_s: decision.t_s, skills }))
    }
}

/// The first change after setting off or, without one, the tick in which skills are worth least.
fn telling(run: &CourseRun) -> Option<&Decision> {
    let decisions = || run.ticks.iter().filter_map(|tick| tick.decision.as_ref());
    let worth = |decision: &Decision| -> f32 {
        decision.skills.iter().map(|skill| skill.viability.unwrap_or(1.0)).sum()
    };
    match run.switches.get(1) {
        Some(change) => {
            let away_s = |decision: &Decision| (decision.t_s - change.t_s).abs();
            decisions().min_by(|a, b| away_s(a).total_cmp(&away_s(b)))
        }
        None => decisions().min_by(|a, b| worth(a).total_cmp(&worth(b))),
    }
}

/// The deployment whose thresholds promise something.
pub(super) const PROMISED: &str = "vocaloco with promised thresholds";

/// The deployment with skills added for the course of obstacles.
pub(super) const ADDED: &str = "vocaloco with skills added";

/// The same, where every skill may be stopped half-way.
pub(super) const FREE: &str = "vocaloco with skills added, none committed";

/// The selector whose cost is the chance of failure.
pub(super) const WITHOUT_COST: &str = "vocaloco without cost";

fn moment(decision: &Decision) -> Moment {
    let predictions = decision.skills.iter().map(|skill| (skill.viability, skill.cot)).collect();
    Moment { t_s: decision.t_s, active: decision.active.clone(), predictions }
}

impl Findings {
    /// What a skill is worth on one terrain of one height.
    pub(super) fn cell(&self, skill: &str, terrain: TerrainKind, size_m: f32) -> Option<&Collected> {
        self.cells.iter().find(|cell| cell.skill == skill && cell.terrain == terrain && cell.size_m == size_m)
    }

    /// The cells of a skill on one terrain, by height.
    pub(super) fn cells_of(&self, skill: &str, terrain: TerrainKind) -> Vec<&Collected> {
        self.cells.iter().filter(|cell| cell.skill == skill && cell.terrain == terrain).collect()
    }

    /// The rows of a selector on one staircase, by height.
    pub(super) fn rows(&self, selector: &str, course: CourseKind) -> Vec<&SuccessRow> {
        self.success.iter().filter(|row| row.selector == selector && row.course == course).collect()
    }

    /// The row of a selector on one staircase of one height.
    pub(super) fn row(&self, selector: &str, course: CourseKind, size_m: f32) -> Option<&SuccessRow> {
        self.rows(selector, course).into_iter().find(|row| row.size_m == size_m)
    }
}
