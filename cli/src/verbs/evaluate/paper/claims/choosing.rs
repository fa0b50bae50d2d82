//! Claims about choosing, stopping and switching.

use vocaloco_sim::{
    course::SuccessRow,
    occlusion::{DROP_M, Occlusion},
    terrain::CourseKind,
};

use super::super::findings::{PROMISED, STAIRS, WITHOUT_COST};
use super::{Claim, Evidence, Verdict, centimetres, course_words, percent};

/// A course that no deployed skill reaches this often is not viable.
const UNVIABLE: f64 = 0.5;
/// The best skill reaches a safe course at least this often.
const SAFE: f64 = 0.99;
/// What is asked for where it is safe: reached at least, stopped at most.
const REACHED: f64 = 0.95;
const STOPPED: f64 = 0.04;
/// As in docs/method.md, m.
const PAPER_HORIZON_M: f32 = 1.5;
/// Crashes allowed at every height.
const CRASHED: f64 = 0.01;

/// The mean of a value over the rows of one setting.
fn mean_of<K: PartialEq>(rows: &[(K, SuccessRow)], of: K, value: fn(&SuccessRow) -> f64) -> f64 {
    let values = || rows.iter().filter(|(setting, _)| *setting == of).map(|(_, row)| value(row));
    values().sum::<f64>() / values().count().max(1) as f64
}

impl Evidence<'_> {
    /// The most that any deployed skill alone reaches of a course.
    fn best_alone(&self, course: CourseKind, size_m: f32) -> f64 {
        let alone = self.skills.iter().filter_map(|skill| {
            self.findings.row(&format!("skill:{skill}"), course, size_m).map(|row| row.reached)
        });
        alone.fold(0.0, f64::max)
    }

    fn vocaloco(&self) -> impl Iterator<Item = &SuccessRow> {
        STAIRS.into_iter().flat_map(|course| self.findings.rows("vocaloco", course))
    }

    fn success_of(&self, selectors: &[&str]) -> String {
        self.success_command("stairs_up,stairs_down", selectors, &self.plan.sizes_m, self.plan.rollouts)
    }

    pub(super) fn stops_where_the_baseline_crashes(&self) -> Claim {
        let baseline = self.baseline_selector();
        let unviable: Vec<&SuccessRow> =
            self.vocaloco().filter(|row| self.best_alone(row.course, row.size_m) < UNVIABLE).collect();
        let mean = |share: &dyn Fn(&SuccessRow) -> f64| {
            unviable.iter().map(|row| share(row)).sum::<f64>() / unviable.len().max(1) as f64
        };
        let stopped = mean(&|row| row.stopped);
        let fell = mean(&|row| {
            self.findings.row(&baseline, row.course, row.size_m).map_or(0.0, |row| row.crashed + row.stuck)
        });
        let reached =
            mean(&|row| self.findings.row(&baseline, row.course, row.size_m).map_or(0.0, |row| row.reached));
        let ours = if unviable.is_empty() {
            "some skill alone reaches half of the courses at every height".to_owned()
        } else {
            format!(
                "over {} courses of which no skill alone reaches half: VOCALoco stops in {}, crashes in {}; {} crashes or gets stuck in {}, reaches {}",
                unviable.len(),
                percent(stopped),
                percent(mean(&|row| row.crashed)),
                self.baseline,
                percent(fell),
                percent(reached)
            )
        };
        Claim {
            id: "stops",
            words: "On unviable terrain the selection halts where the end-to-end baseline goes on and crashes or gets stuck.".to_owned(),
            by: "paper",
            ours,
            verdict: Verdict::of(!unviable.is_empty() && stopped >= 0.5 && fell >= 0.5 && mean(&|row| row.crashed) < fell),
            why: "Agrees when, over these courses, VOCALoco stops in at least half, the baseline fails in at least half, and VOCALoco crashes less often than that.".to_owned(),
            n: format!("{} × {} courses × 2 selectors", self.plan.rollouts, unviable.len()),
            seed: self.plan.seed,
            command: self.success_of(&["vocaloco", &baseline]),
            figure: Some("success_up"),
        }
    }

    pub(super) fn at_twenty_two_centimetres(&self) -> Claim {
        let baseline = self.baseline_selector();
        let nearest = self.plan.sizes_m.iter().copied();
        let size_m = nearest.min_by(|a, b| (a - 0.225).abs().total_cmp(&(b - 0.225).abs())).unwrap_or(0.225);
        let (mut words, mut agrees) = (Vec::new(), true);
        for course in STAIRS {
            let rows =
                (self.findings.row("vocaloco", course, size_m), self.findings.row(&baseline, course, size_m));
            if let (Some(ours), Some(theirs)) = rows {
                agrees &= ours.crashed < theirs.crashed
                    || ours.reached >= 1.0
                    || theirs.crashed == 0.0 && ours.crashed == 0.0;
                words.push(format!(
                    "{}: VOCALoco reaches {}, crashes {}, stops {}, its best skill alone reaches {}; {} reaches {}, crashes {}, stuck {}",
                    course_words(ours),
                    percent(ours.reached),
                    percent(ours.crashed),
                    percent(ours.stopped),
                    percent(self.best_alone(course, size_m)),
                    self.baseline,
                    percent(theirs.reached),
                    percent(theirs.crashed),
                    percent(theirs.stuck),
                ));
            }
        }
        Claim {
            id: "at_22",
            words: "At 22.5 cm there are fewer crashes than with the baseline, or 100 % success.".to_owned(),
            by: "paper",
            ours: words.join(". "),
            verdict: Verdict::of(agrees && words.len() == STAIRS.len()),
            why: format!("Judged at {}, the nearest height measured, up and down.", centimetres(size_m)),
            n: format!("{} × 2 courses × 2 selectors", self.plan.rollouts),
            seed: self.plan.seed,
            command: self.success_command(
                "stairs_up,stairs_down",
                &["vocaloco", &baseline],
                &[size_m],
                self.plan.rollouts,
            ),
            figure: Some("success_up"),
        }
    }

    pub(super) fn few_crashes(&self) -> Claim {
        let rows: Vec<&SuccessRow> = self.vocaloco().collect();
        Claim {
            id: "crashes",
            words: "Crashes stay at or below 1 % at every height of both courses.".to_owned(),
            by: "our promise",
            ours: crashes(&rows),
            verdict: Verdict::of(!rows.is_empty() && rows.iter().all(|row| row.crashed <= CRASHED)),
            why: "Judged with the thresholds of the deployment as it stands; the next line is of thresholds set for α = 0.01.".to_owned(),
            n: format!("{} a height", self.plan.rollouts),
            seed: self.plan.seed,
            command: self.success_of(&["vocaloco"]),
            figure: Some("success_up"),
        }
    }

    pub(super) fn promised_crashes(&self) -> Claim {
        let words = "With viability thresholds promised at α = 0.01, crashes stay at or below 1 % at every height of both courses.";
        let Some(deployment) = self.promised else {
            let why = "There is no deployment with such thresholds.";
            let claim = Self::unmeasured("promised_crashes", words, why, self.plan.seed);
            return Claim { by: "our promise", ..claim };
        };
        let all = STAIRS.into_iter().flat_map(|course| self.findings.rows(PROMISED, course));
        let rows: Vec<&SuccessRow> = all.collect();
        let evidence = Evidence { deployment, ..*self };
        let mean = |share: fn(&SuccessRow) -> f64| {
            rows.iter().map(|row| share(row)).sum::<f64>() / rows.len().max(1) as f64
        };
        Claim {
            id: "promised_crashes",
            words: words.to_owned(),
            by: "our promise",
            ours: format!(
                "{}; over all heights {} reached, {} stopped",
                crashes(&rows),
                percent(mean(|row| row.reached)),
                percent(mean(|row| row.stopped))
            ),
            verdict: Verdict::of(!rows.is_empty() && rows.iter().all(|row| row.crashed <= CRASHED)),
            why: "The upper bound says what this many rollouts can show. What the strictness costs is the share that stops.".to_owned(),
            n: format!("{} a height", self.plan.promised_rollouts),
            seed: self.plan.seed,
            command: evidence.success_command(
                "stairs_up,stairs_down",
                &["vocaloco"],
                &self.plan.sizes_m,
                self.plan.promised_rollouts,
            ),
            figure: Some("success_up"),
        }
    }

    pub(super) fn reaches_what_is_safe(&self) -> Claim {
        let safe: Vec<&SuccessRow> =
            self.vocaloco().filter(|row| self.best_alone(row.course, row.size_m) >= SAFE).collect();
        let n = safe.len().max(1) as f64;
        let reached = safe.iter().map(|row| row.reached).sum::<f64>() / n;
        let stopped = safe.iter().map(|row| row.stopped).sum::<f64>() / n;
        let oracle: f64 = safe
            .iter()
            .filter_map(|row| self.findings.row("oracle", row.course, row.size_m))
            .map(|row| row.reached)
            .sum::<f64>()
            / n;
        let keeps = |row: &SuccessRow| row.reached >= REACHED && row.stopped <= STOPPED;
        let short: Vec<String> = safe
            .iter()
            .filter(|row| !keeps(row))
            .map(|row| {
                let (reached, stopped) = (percent(row.reached), percent(row.stopped));
                format!("{} ({reached}, {stopped})", course_words(row))
            })
            .collect();
        let promised = |row: &&SuccessRow| self.findings.row(PROMISED, row.course, row.size_m);
        let with_promise: Vec<&SuccessRow> = safe.iter().filter_map(promised).collect();
        let promised = if with_promise.is_empty() {
            String::new()
        } else {
            let kept = with_promise.iter().filter(|row| keeps(row)).count();
            format!("; with promised thresholds {kept} of {} courses keep it", with_promise.len())
        };
        let ours = if safe.is_empty() {
            "no skill alone reaches 99 % of any course".to_owned()
        } else {
            format!(
                "{} courses: reached {}, false stops {}; short of it: {}; the oracle reaches {}{promised}",
                safe.len(),
                percent(reached),
                percent(stopped),
                if short.is_empty() { "none".to_owned() } else { short.join(", ") },
                percent(oracle),
            )
        };
        Claim {
            id: "safe",
            words: "Where the best skill alone reaches 99 % of a course, VOCALoco reaches at least 95 % and stops in at most 4 %.".to_owned(),
            by: "our promise",
            ours,
            verdict: Verdict::of(!safe.is_empty() && short.is_empty()),
            why: "Every such course must keep it, not their mean. What the oracle reaches more is what predictions cost; what it misses too is what switching and thresholds cost.".to_owned(),
            n: format!("{} × {} courses", self.plan.rollouts, safe.len()),
            seed: self.plan.seed,
            command: self.success_of(&["vocaloco", "oracle"]),
            figure: Some("success_up"),
        }
    }

    pub(super) fn demo_switches(&self) -> Claim {
        let level = &self.roles.level;
        let demo = |course: CourseKind| {
            let method = self.findings.runs.iter().filter(|run| run.selector == "vocaloco");
            method.into_iter().find(|run| run.course == course && run.size_m == self.plan.demo_size_m)
        };
        let (mut words, mut agrees) = (Vec::new(), true);
        for (course, made_for) in [(STAIRS[0], &self.roles.up), (STAIRS[1], &self.roles.down)] {
            if let Some(run) = demo(course) {
                agrees &= run.outcome == "reached" && run.skills == [level.as_str(), made_for, level];
                words.push(format!(
                    "{}: {} by {}",
                    course.id().replace('_', " "),
                    run.outcome,
                    if run.skills.is_empty() { "no skill".to_owned() } else { run.skills.join(" → ") }
                ));
            }
        }
        Claim {
            id: "demo",
            words: "On three steps of 12 cm at 0.6 m/s: walk → ascend → walk going up, walk → descend → walk going down, with no trouble at the switches.".to_owned(),
            by: "paper",
            ours: words.join("; "),
            verdict: Verdict::of(agrees && words.len() == STAIRS.len()),
            why: format!(
                "Agrees when both are reached by exactly {level} → {} → {level} and {level} → {} → {level}, the skills that turned out best on the level, up and down. A level skill that is viable on these steps and cheaper is rightly kept.",
                self.roles.up, self.roles.down
            ),
            n: "1 of each".to_owned(),
            seed: self.plan.seed,
            command: format!(
                "vocaloco evaluate course --size-m {} --steps {} --deployment {} --seed {}",
                self.plan.demo_size_m, self.plan.demo_steps, self.deployment, self.plan.seed
            ),
            figure: Some("timeline"),
        }
    }

    pub(super) fn energy(&self) -> Claim {
        let baseline = self.baseline_selector();
        let (mut words, mut cheaper, mut compared) = (Vec::new(), 0, 0);
        for size_m in &self.plan.mixed_sizes_m {
            let of = |selector: &str| {
                self.findings.mixed.iter().find(|row| row.size_m == *size_m && row.selector == selector)
            };
            let robust = of(&format!("skill:{}", self.roles.robust));
            let cost = |row: Option<&SuccessRow>| row.and_then(|row| row.cot_mean);
            let costs = (cost(of("vocaloco")), cost(of(&baseline)), robust);
            if let (Some(ours), theirs, Some(robust)) = costs {
                compared += 1;
                let below = |other: Option<f64>| other.is_none_or(|other| ours <= other);
                cheaper += usize::from(below(theirs) && below(robust.cot_mean));
                let number =
                    |cost: Option<f64>| cost.map_or("never reached".to_owned(), |cost| format!("{cost:.3}"));
                words.push(format!(
                    "{}: VOCALoco {ours:.3}, {} {}, {} alone (the most robust) {}, without the cost term {}",
                    centimetres(*size_m),
                    self.baseline,
                    number(theirs),
                    self.roles.robust,
                    number(robust.cot_mean),
                    number(cost(of(WITHOUT_COST))),
                ));
            }
        }
        Claim {
            id: "energy",
            words: "Choosing by cost saves energy: on a course of flat and stairs, CoT is below the baseline's and below that of always running the most robust skill.".to_owned(),
            by: "paper, our measure",
            ours: if words.is_empty() { "VOCALoco reached none of these courses".to_owned() } else { words.join(". ") },
            verdict: Verdict::of(compared > 0 && cheaper == compared),
            why: "Mean CoT of the rollouts that reached the target, standing included. Agrees when it is not above either at any height. The most robust skill is the most viable over both stairs and all heights.".to_owned(),
            n: format!("{} a height and selector", self.plan.rollouts),
            seed: self.plan.seed,
            command: self.success_command("mixed", &["vocaloco", &baseline], &self.plan.mixed_sizes_m, self.plan.rollouts),
            figure: Some("energy"),
        }
    }

    pub(super) fn windows(&self) -> Claim {
        let mean = |window: usize, value| mean_of(&self.findings.windows, window, value);
        let words: Vec<String> = self
            .plan
            .windows
            .iter()
            .map(|window| {
                format!(
                    "{window}: {:.1} switches, reached {}",
                    mean(*window, |row| row.switches_mean),
                    percent(mean(*window, |row| row.reached))
                )
            })
            .collect();
        let switches: Vec<f64> =
            self.plan.windows.iter().map(|window| mean(*window, |row| row.switches_mean)).collect();
        let fewer = switches.windows(2).all(|pair| pair[1] <= pair[0] + 0.05);
        Claim {
            id: "window",
            words: "A window of ten ticks keeps the robot from switching at every change of mind.".to_owned(),
            by: "paper",
            ours: words.join("; "),
            verdict: Verdict::of(switches.len() > 1 && fewer && switches.first() > switches.last()),
            why: "Agrees when switches a run fall as the window grows. The stop window has the same length here, as in a deployment that does not name it.".to_owned(),
            n: format!("{} a window, height and course", self.plan.ablation_rollouts),
            seed: self.plan.seed,
            command: self.all_command(),
            figure: Some("window"),
        }
    }

    pub(super) fn horizons(&self) -> Claim {
        let mean = |horizon_m: f32, value| mean_of(&self.findings.horizons, horizon_m, value);
        let point = |horizon_m: &f32| {
            (*horizon_m, mean(*horizon_m, |row| row.switches_mean), mean(*horizon_m, |row| row.reached))
        };
        let points: Vec<(f32, f64, f64)> = self.plan.horizons_m.iter().map(point).collect();
        let words: Vec<String> = points
            .iter()
            .map(|(horizon_m, switches, reached)| {
                format!("{horizon_m} m: {switches:.1} switches, reached {}", percent(*reached))
            })
            .collect();
        let paper = points.iter().find(|(horizon_m, ..)| *horizon_m == PAPER_HORIZON_M);
        let agrees = paper.is_some_and(|(of_paper, switches, reached)| {
            points.iter().all(
                |(horizon_m, others, reach)| {
                    if horizon_m < of_paper { others > switches } else { reach <= reached }
                },
            )
        });
        Claim {
            id: "horizon",
            words: "Horizons shorter than 1.5 m switch too often, longer ones are too noisy.".to_owned(),
            by: "paper",
            ours: words.join("; "),
            verdict: Verdict::of(agrees && points.len() > 1),
            why: "Agrees when every shorter horizon switches more often than 1.5 m and no longer one reaches more. It is the oracle that chooses, by what was collected over each horizon: the noise of predictors trained for another horizon, of which the paper speaks too, is not in it.".to_owned(),
            n: format!("{} a horizon, height and course", self.plan.ablation_rollouts),
            seed: self.plan.seed,
            command: self.all_command(),
            figure: Some("horizon"),
        }
    }

    pub(super) fn thresholds(&self) -> Claim {
        let curve = self.threshold_curve();
        let words: Vec<String> = curve
            .iter()
            .map(|point| {
                format!(
                    "{}: stops {} where it is safe, crashes {} where it is not",
                    point.threshold,
                    percent(point.false_stops),
                    percent(point.crashes)
                )
            })
            .collect();
        let (first, last) = (curve.first(), curve.last());
        let agrees = first.zip(last).is_some_and(|(first, last)| {
            last.false_stops >= first.false_stops && last.crashes <= first.crashes
        });
        Claim {
            id: "threshold",
            words: "Higher thresholds stop more often on safe terrain; lower ones let unsafe terrain through.".to_owned(),
            by: "paper",
            ours: words.join("; "),
            verdict: Verdict::of(agrees && curve.len() > 1),
            why: "Agrees between the lowest and the highest threshold, one for all skills. Safe: some skill alone reaches 95 % of the course; unsafe: none reaches half.".to_owned(),
            n: format!("{} a threshold, height and course", self.plan.ablation_rollouts),
            seed: self.plan.seed,
            command: self.all_command(),
            figure: Some("threshold"),
        }
    }

    /// Stops on safe courses and crashes on unsafe ones, by threshold.
    pub(in super::super) fn threshold_curve(&self) -> Vec<ThresholdPoint> {
        let point = |threshold: &f32| {
            let rows: Vec<&SuccessRow> = self
                .findings
                .thresholds
                .iter()
                .filter(|(of, _)| of == threshold)
                .map(|(_, row)| row)
                .collect();
            let mean = |keep: &dyn Fn(f64) -> bool, share: &dyn Fn(&SuccessRow) -> f64| {
                let kept = || rows.iter().filter(|row| keep(self.best_alone(row.course, row.size_m)));
                kept().map(|row| share(row)).sum::<f64>() / kept().count() as f64
            };
            ThresholdPoint {
                threshold: *threshold,
                false_stops: mean(&|best| best >= REACHED, &|row| row.stopped),
                crashes: mean(&|best| best < UNVIABLE, &|row| row.crashed),
                reached: mean(&|best| best >= REACHED, &|row| row.reached),
            }
        };
        self.plan.thresholds.iter().map(point).collect()
    }

    pub(super) fn filling(&self) -> Claim {
        let rows = |sight: Occlusion| self.findings.sights.iter().filter(move |row| row.occlusion == sight);
        let mean = |sight: Occlusion, share: fn(&SuccessRow) -> f64| {
            rows(sight).map(share).sum::<f64>() / rows(sight).count().max(1) as f64
        };
        let hidden = |course: CourseKind| {
            let of_course = rows(Occlusion::Camera).filter(|row| row.course == course);
            let unseen: Vec<_> = of_course.filter_map(|row| row.unseen).collect();
            let ticks: u64 = unseen.iter().map(|unseen| unseen.ticks).sum();
            unseen.iter().map(|unseen| unseen.drop_ticks).sum::<u64>() as f64 / ticks.max(1) as f64
        };
        let reached = |sight| percent(mean(sight, |row| row.reached));
        let crashed = |sight| percent(mean(sight, |row| row.crashed));
        let [filled, unfilled] = [Occlusion::Camera, Occlusion::CameraUnfilled];
        Claim {
            id: "fill",
            words: "Filling occluded cells from behind lets the selector work on what the cameras give.".to_owned(),
            by: "paper",
            ours: format!(
                "reached with everything seen {}, cameras and fill {}, cameras and no fill {}; crashed {}, {}, {}. Filling hides a drop of {DROP_M} m or more in {} of ticks down stairs, {} up",
                reached(Occlusion::None),
                reached(filled),
                reached(unfilled),
                crashed(Occlusion::None),
                crashed(filled),
                crashed(unfilled),
                percent(hidden(CourseKind::StairsDown)),
                percent(hidden(CourseKind::StairsUp)),
            ),
            verdict: Verdict::of(
                mean(filled, |row| row.reached) + 0.05 >= mean(Occlusion::None, |row| row.reached)
                    && mean(filled, |row| row.crashed) <= mean(Occlusion::None, |row| row.crashed) + 0.05,
            ),
            why: "Agrees when, with cameras and fill, reached and crashed are within 5 points of seeing everything. Four cameras, rays over the terrain, a map that remembers; without fill an unknown cell is read as level with the ground under the base.".to_owned(),
            n: format!("{} a sight, height and course", self.plan.ablation_rollouts),
            seed: self.plan.seed,
            command: format!("{} --occlusion camera", self.success_command("stairs_up,stairs_down", &["vocaloco"], &self.plan.camera_sizes_m, self.plan.ablation_rollouts)),
            figure: Some("fill"),
        }
    }
}

/// Where most crash, and what that many rollouts can show.
fn crashes(rows: &[&SuccessRow]) -> String {
    let bound = rows.iter().map(|row| row.crashed_high).fold(0.0, f64::max);
    let over = rows.iter().filter(|row| row.crashed > CRASHED).count();
    let worst = rows.iter().max_by(|a, b| a.crashed.total_cmp(&b.crashed));
    worst.map_or("–".to_owned(), |row| {
        format!(
            "most at {}: {} (95 % interval {} to {}); over 1 % at {over} of {} heights; the largest upper bound is {}",
            course_words(row),
            tenths(row.crashed),
            tenths(row.crashed_low),
            tenths(row.crashed_high),
            rows.len(),
            tenths(bound)
        )
    })
}

/// A share in percent, to a tenth.
fn tenths(share: f64) -> String {
    format!("{:.1} %", share * 100.0)
}

/// What one threshold for all skills came to; NaN where no course is safe, or none unsafe.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(in super::super) struct ThresholdPoint {
    pub(in super::super) threshold: f32,
    pub(in super::super) false_stops: f64,
    pub(in super::super) crashes: f64,
    pub(in super::super) reached: f64,
}
