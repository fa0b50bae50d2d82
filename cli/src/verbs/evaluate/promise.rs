//! `evaluate promise`: viability thresholds of a deployment under which it crashes on at most a share of courses.

use std::collections::BTreeMap;

use anyhow::{Context, ensure};
use serde::{Deserialize, Serialize};
use vocaloco_sim::{
    course::{Blame, CourseConfig, Outcome},
    promise::{bound, most_allowed, most_usual},
    terrain::CourseKind,
};

use super::arena::Arena;
use super::arena_args::{courses_flag, sizes_m};
use super::store::StoreArgs;
use super::success::STAIRS_M;
use crate::verbs::{Shared, noise::NoiseArgs};
use crate::{exit::Exit, output, progress};

/// Raises a deployment's viability thresholds until it keeps a promise on whole courses.
///
/// Promised, with 95 % confidence: on courses drawn as these are, at most the share --alpha ends in a crash.
/// A round drives courses that no round before has driven. Crashes few enough to show the share end the search,
/// unless one height has more of them than that share gives by chance in 19 of 20 cases. Otherwise the skill to
/// which most crashes are laid is refused the quarter of them of which it was least sure, and the next round begins.
/// Every round is kept in --store, and a run that is killed goes on with the next.
/// Thresholds that were chosen by looking at a search are shown with another --seed than it had: the same seed
/// drives the same courses.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Deployment whose skills may run; its thresholds are where the search begins
    #[arg(long, default_value = "anymal_stairs", value_name = "NAME")]
    deployment: String,
    /// Largest share of courses that may end in a crash
    #[arg(long, default_value_t = 0.01, value_name = "SHARE")]
    alpha: f64,
    /// Courses: `stairs_up`, `stairs_down`, `mixed`, `obstacles`
    #[arg(long, value_delimiter = ',', default_value = "stairs_up,stairs_down", value_name = "LIST")]
    course: Vec<CourseKind>,
    /// Step heights, m, each as likely as the others; by default as of `evaluate success`
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    size_m: Vec<f32>,
    /// Rollouts a round, of each course and height
    #[arg(long, default_value_t = 50, value_name = "N")]
    rollouts: u64,
    /// Rounds after which to give up
    #[arg(long, default_value_t = 16, value_name = "N")]
    rounds: u32,
    /// Steps of a flight
    #[arg(long, default_value_t = 6, value_name = "N")]
    steps: usize,
    #[command(flatten)]
    noise: NoiseArgs,
    #[command(flatten)]
    store: StoreArgs,
    #[command(flatten)]
    shared: Shared,
}

/// Chance that the promise does not hold, over all rounds.
const ERROR: f64 = 0.05;
/// Rollouts of a round are numbered from its number times this on, where no evaluation comes.
const FIRST_OF_ROUND: u64 = 1_000_000;
/// Rollouts driven before crashes are counted again.
const BATCH: usize = 64;
/// Thresholds are raised to whole parts of one by so many, decimals that a file can hold.
const PARTS: f64 = 1e4;

/// Rollouts of a round, as far as it came.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Driven {
    rollouts: usize,
    reached: usize,
    stopped: usize,
    crashes: Vec<Crash>,
}

/// A crash; `evaluate course --rollout` drives it again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Crash {
    course: CourseKind,
    size_m: f32,
    rollout: u64,
    blame: Option<Blame>,
}

/// How many crashes a round may have.
#[derive(Clone, Copy, Debug)]
struct Limits {
    allowed: usize,
    a_height: usize,
}

impl Limits {
    fn hold(self, crashes: &[Crash]) -> bool {
        let same = |one: &Crash, other: &Crash| one.course == other.course && one.size_m == other.size_m;
        let at_the_height_of = |one| crashes.iter().filter(|other| same(one, other)).count();
        crashes.len() <= self.allowed && crashes.iter().all(|one| at_the_height_of(one) <= self.a_height)
    }
}

/// A round.
#[derive(Clone, Debug, Serialize)]
struct Round {
    number: u32,
    thresholds: BTreeMap<String, f32>,
    /// Crashes that would still show the share.
    allowed: usize,
    /// Crashes that one course of one height may still have.
    allowed_a_height: usize,
    #[serde(flatten)]
    driven: Driven,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'a> {
    command: String,
    seed: u64,
    version: &'static str,
    alpha: f64,
    confidence: f64,
    rounds: &'a [Round],
    /// Upper end of the interval of the share that crashes; none when nothing can be promised.
    upper_bound: Option<f64>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    args.check()?;
    let mut arena = Arena::load(&args.deployment, &[], args.store.open()?)?;
    let round_size = args.round_size();
    let allowed = most_allowed(round_size, args.alpha, args.error()).with_context(|| {
        let most = args.rounds;
        format!("--rollouts: found {round_size} a round, wanted more: without one crash they would not show the share in one of {most} rounds")
    })?;
    let limits = Limits { allowed, a_height: most_usual(args.rollouts as usize, args.alpha, ERROR) };
    let bar = progress::bar("rollouts", round_size as u64);
    let mut rounds: Vec<Round> = Vec::new();
    let mut kept = false;
    for round in 1..=args.rounds {
        bar.set_position(0);
        bar.set_message(format!("round {round}"));
        let configs = args.configs(round);
        let driven = arena.driven(&configs, limits, &|n| bar.inc(n))?;
        let thresholds: BTreeMap<String, f32> = arena.thresholds().into_iter().collect();
        let Limits { allowed, a_height: allowed_a_height } = limits;
        rounds.push(Round { number: round, thresholds, allowed, allowed_a_height, driven: driven.clone() });
        kept = limits.hold(&driven.crashes);
        if kept {
            break;
        }
        let Some((skill, threshold)) = raised(&driven.crashes, &arena.thresholds()) else { break };
        bar.suspend(|| {
            eprintln!(
                "round {round}: {} crashes in {} rollouts; {skill} from {threshold} on",
                driven.crashes.len(),
                driven.rollouts
            );
        });
        arena.set_threshold(&skill, threshold);
    }
    bar.finish_and_clear();
    args.report(&rounds, kept)?;
    Ok(if kept { Exit::Fine } else { Exit::Finding })
}

/// The skill to which most crashes are laid, and a threshold that refuses the least sure quarter of them; none when
/// no crash is laid at any, or the threshold is at 1 already. More at once would refuse what is safe.
fn raised(crashes: &[Crash], thresholds: &[(String, f32)]) -> Option<(String, f32)> {
    let mut predicted: BTreeMap<&str, Vec<f32>> = BTreeMap::new();
    for blame in crashes.iter().filter_map(|crash| crash.blame.as_ref()) {
        predicted.entry(&blame.skill).or_default().push(blame.predicted);
    }
    let may_rise = |skill: &str| thresholds.iter().find(|(name, old)| name == skill && *old < 1.0);
    let candidates = predicted.into_iter().filter_map(|(skill, seen)| Some((may_rise(skill)?, seen)));
    let ((skill, old), mut seen) = candidates.max_by_key(|(_, seen)| seen.len())?;
    // What drove on although it was refused asks for a step.
    seen.retain(|predicted| predicted >= old);
    seen.sort_by(f32::total_cmp);
    let least_sure = *seen.get(seen.len() / 4).unwrap_or(old);
    let part = |parts: f64| (parts / PARTS) as f32;
    let below = (f64::from(least_sure) * PARTS).floor();
    // The f32 next to a decimal may lie below it, and the next part is then no step.
    let above = [1.0, 2.0].map(|more| part(below + more)).into_iter().find(|raised| *raised > least_sure);
    Some((skill.clone(), above.unwrap_or(1.0).min(1.0)))
}

impl Args {
    fn check(&self) -> anyhow::Result<()> {
        let rollouts = self.rollouts;
        let most = FIRST_OF_ROUND;
        ensure!((1..=most).contains(&rollouts), "--rollouts: found {rollouts}, wanted 1 to {most}");
        ensure!((1..=40).contains(&self.rounds), "--rounds: found {}, wanted 1 to 40", self.rounds);
        ensure!((1..=40).contains(&self.steps), "--steps: found {}, wanted 1 to 40", self.steps);
        let alpha = self.alpha;
        ensure!(alpha > 0.0 && alpha < 1.0, "--alpha: found {alpha}, wanted a share between 0 and 1");
        for size_m in &self.size_m {
            ensure!((0.0..=1.0).contains(size_m), "--size-m: found {size_m}, wanted 0 to 1");
        }
        // The same course twice would be the same rollouts, counted as if they were others.
        let cells = self.cells();
        for (index, cell) in cells.iter().enumerate() {
            let (course, size_m) = (cell.0.id(), cell.1);
            ensure!(
                !cells[..index].contains(cell),
                "--course, --size-m: found {course} of {size_m} m twice, wanted each once"
            );
        }
        self.noise.check()
    }

    /// The chance of error of a round: all together err no more often than [`ERROR`].
    fn error(&self) -> f64 {
        ERROR / f64::from(self.rounds)
    }

    /// Courses and heights.
    fn cells(&self) -> Vec<(CourseKind, f32)> {
        let sizes = |course: &CourseKind| sizes_m(*course, &self.size_m, &STAIRS_M);
        let of = |course: &CourseKind| sizes(course).into_iter().map(|size_m| (*course, size_m)).collect();
        self.course.iter().flat_map::<Vec<_>, _>(of).collect()
    }

    fn round_size(&self) -> usize {
        self.cells().len() * self.rollouts as usize
    }

    /// A round's rollouts, every height once before any is driven twice.
    fn configs(&self, round: u32) -> Vec<CourseConfig> {
        let first = u64::from(round) * FIRST_OF_ROUND;
        let one = |rollout: u64, (course, size_m): (CourseKind, f32)| {
            let course = CourseConfig::evaluation(course, size_m, self.shared.seed, first + rollout);
            CourseConfig { steps: self.steps, recorded: true, ..self.noise.on(course) }
        };
        let cells = self.cells();
        (0..self.rollouts).flat_map(|rollout| cells.iter().map(move |cell| one(rollout, *cell))).collect()
    }

    /// The command that repeats it, on any number of threads.
    fn command(&self) -> String {
        format!(
            "vocaloco evaluate promise --deployment {} --alpha {} {} --rollouts {} --rounds {} --steps {} \
             {} --seed {}",
            self.deployment,
            self.alpha,
            courses_flag(&self.course, &self.size_m, &STAIRS_M),
            self.rollouts,
            self.rounds,
            self.steps,
            self.noise,
            self.shared.seed
        )
    }

    fn report(&self, rounds: &[Round], kept: bool) -> anyhow::Result<()> {
        let last = rounds.last().context("no round was driven")?;
        let upper_bound = kept.then(|| bound(last.driven.crashes.len(), last.driven.rollouts, self.error()));
        if self.shared.json {
            return Ok(output::json(&Report {
                command: self.command(),
                seed: self.shared.seed,
                version: env!("CARGO_PKG_VERSION"),
                alpha: self.alpha,
                confidence: 1.0 - ERROR,
                rounds,
                upper_bound,
            })?);
        }
        output::line("round  rollouts  crashed  allowed  stopped  thresholds")?;
        for Round { number, thresholds, allowed, driven, .. } in rounds {
            let list: Vec<String> =
                thresholds.iter().map(|(name, threshold)| format!("{name} {threshold}")).collect();
            output::line(&format!(
                "{number:>5}  {:>8}  {:>7}  {allowed:>7}  {:>7}  {}",
                driven.rollouts,
                driven.crashes.len(),
                driven.stopped,
                list.join(", ")
            ))?;
        }
        match upper_bound {
            Some(bound) => {
                output::line(&format!(
                    "crashes on at most {bound:.4} of such courses, with 95 % confidence; for the deployment's file:"
                ))?;
                output::line("[viability_thresholds]")?;
                for (name, threshold) in &last.thresholds {
                    output::line(&format!("{name} = {threshold}"))?;
                }
            }
            None => output::line(&format!("no thresholds found that keep crashes to {}", self.alpha))?,
        }
        output::line(&self.command())?;
        Ok(())
    }
}

impl Arena {
    /// Drives rollouts in their order until more have crashed than may, unless that stands already; `progress`
    /// counts them.
    fn driven(
        &self,
        configs: &[CourseConfig],
        limits: Limits,
        progress: &(dyn Fn(u64) + Sync),
    ) -> anyhow::Result<Driven> {
        let standing = || progress(configs.len() as u64);
        let measure = || {
            let mut driven = Driven::default();
            for batch in configs.chunks(BATCH) {
                for (config, (outcome, blame)) in batch.iter().zip(self.ends(batch, &|| progress(1))?) {
                    driven.rollouts += 1;
                    driven.reached += usize::from(outcome == Outcome::Reached);
                    driven.stopped += usize::from(outcome == Outcome::Stopped);
                    let CourseConfig { kind: course, size_m, rollout, .. } = *config;
                    if outcome == Outcome::Crashed {
                        driven.crashes.push(Crash { course, size_m, rollout, blame });
                    }
                }
                if !limits.hold(&driven.crashes) {
                    break;
                }
            }
            Ok(driven)
        };
        self.of_rollouts(
            &format!("promise-{}-{}", limits.allowed, limits.a_height),
            configs,
            (standing, measure),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn crash(skill: &str, predicted: f32) -> Crash {
        let blame = Some(Blame { skill: skill.to_owned(), predicted });
        Crash { course: CourseKind::StairsDown, size_m: 0.1, rollout: 0, blame }
    }

    #[test]
    fn a_round_fails_by_all_its_crashes_or_by_those_of_one_height() {
        let limits = Limits { allowed: 3, a_height: 1 };
        let at = |size_m| Crash { size_m, ..crash("walk", 0.9) };
        let up = Crash { course: CourseKind::StairsUp, ..at(0.1) };
        assert!(limits.hold(&[]));
        assert!(limits.hold(&[at(0.1), at(0.2), up.clone()]));
        assert!(!limits.hold(&[at(0.1), at(0.1)]));
        assert!(!limits.hold(&[at(0.1), at(0.2), at(0.3), up]));
    }

    #[test]
    fn the_skill_of_most_crashes_is_refused_the_quarter_of_which_it_was_least_sure() {
        let thresholds = [("walk".to_owned(), 0.98), ("climb".to_owned(), 0.9)];
        let crashes = [0.975, 0.981, 0.984, 0.9921, 0.9941, 0.999].map(|predicted| crash("walk", predicted));
        let mut crashes = crashes.to_vec();
        crashes.push(crash("climb", 0.95));
        let (skill, threshold) = raised(&crashes, &thresholds).unwrap();
        assert_eq!(skill, "walk");
        assert!(threshold > 0.984 && threshold < 0.9842, "{threshold}");
        // What was refused and drove on is refused sooner.
        let (_, threshold) = raised(&[crash("walk", 0.5)], &thresholds).unwrap();
        assert!(threshold > 0.98 && threshold < 0.9802, "{threshold}");
        // Every step is one, and a short decimal that reads back as it is.
        let mut thresholds = [("walk".to_owned(), 0.9)];
        while let Some((_, threshold)) = raised(&[crash("walk", 0.0)], &thresholds) {
            assert!(threshold > thresholds[0].1, "{threshold}");
            assert!(threshold.to_string().len() <= "0.1234".len(), "{threshold}");
            thresholds[0].1 = threshold;
        }
        assert_eq!(thresholds[0].1, 1.0);
        // Nothing is left to raise.
        let refused = [("walk".to_owned(), 1.0)];
        assert_eq!(raised(&[crash("walk", 0.5)], &refused), None);
        assert_eq!(raised(&[Crash { blame: None, ..crash("walk", 0.5) }], &thresholds), None);
    }
}
