//! `bench soak`: the loop for a day and longer, with everything going wrong that may.

mod bundles;
mod memory;
mod record;
mod report;
mod tally;
mod trouble;

use anyhow::{Context, ensure};
use vocaloco_core::decision::{Decision, Forced, STAND};
use vocaloco_core::installation::Installation;
use vocaloco_core::manifest::Deadlines;
use vocaloco_core::registry::load_deployment;
use vocaloco_core::runtime::{
    Followed, Pace, Place, Roster, Runtime, RuntimeConfig, Skill, Supervision, Tick, Watch,
};
use vocaloco_plugin_api::JointTarget;

use self::bundles::{Bundles, DEPLOYMENT};
use self::memory::Memory;
use self::record::{Record, SHOWN};
use self::report::{Report, Unanswered};
use self::tally::Tally;
use self::trouble::{Draws, Moody, Senses};
use crate::exit::Exit;
use crate::verbs::Shared;
use crate::verbs::run::pace::clock;
use crate::{output, progress};

/// Ticks of the runtime as fast as they go, with random faults, and skills that come and go.
///
/// Four bundles are packed and installed into a folder of their own: the deployment's first two skills, one
/// whose plugin answers nonsense, panics and fails, and one in a process of its own that crashes, leaks and
/// hangs (two seconds of the clock each time). Both misbehave as the tests' plugin `faulty` does, which has to
/// lie on the plugin path; `cargo vocaloco bench soak` builds it there. Predictions and measurements are
/// spoiled likewise. All of it follows from the seed.
///
/// Every decision is logged, read back and decided again. Exit code 1 when one is missing or comes out
/// otherwise, when a fault of the terrain, a measurement or the active skill is not answered by the stand in the
/// same tick, when a target is no number, when more files stay open, or when memory grows by more than 5 % of its
/// highest in the first fifth of the ticks. A run of fewer than 50,000 ticks has not seen all that it keeps for
/// good: its growth is said and not judged. Linux only.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Ticks to run; a day at 50 Hz is 4,320,000
    #[arg(long, default_value_t = 20_000, value_name = "N")]
    ticks: u64,
    /// Deployment whose first two skills are the sound ones
    #[arg(long, default_value = "anymal_stairs", value_name = "NAME")]
    deployment: String,
    #[command(flatten)]
    shared: Shared,
}

/// Ticks from which on growth is judged.
const JUDGED_TICKS: u64 = 50_000;
/// Ticks of one log.
const SEGMENT_TICKS: u64 = 500;
/// Ticks between two changes of skills, at least and less than.
const CHANGE_TICKS: [u64; 2] = [100, 600];
/// Seconds of a tick.
const TICK_S: f64 = 0.02;

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    ensure!(
        cfg!(target_os = "linux"),
        "bench soak: found another system, wanted Linux, which isolates plugins"
    );
    ensure!(args.ticks > 0, "--ticks: found 0, wanted 1 or more");
    let bundles = Bundles::pack(&Installation::find()?, &args.deployment, args.shared.seed)?;
    let report = Soak::start(args, bundles)?.run()?;
    let broken = report.broken();
    if args.shared.json {
        output::json(&report)?;
    } else {
        report.say()?;
    }
    for line in &broken {
        eprintln!("{line}");
    }
    Ok(if broken.is_empty() { Exit::Fine } else { Exit::Finding })
}

/// The loop, what troubles it, and what is counted.
struct Soak<'a> {
    args: &'a Args,
    bundles: Bundles,
    runtime: Runtime,
    watch: Watch,
    senses: Senses,
    changes: Draws,
    next_change: u64,
    tally: Tally,
    record: Record,
    memory: Memory,
    loads: u64,
    added: u64,
    removed: u64,
    switches: u64,
    driven: u64,
    unanswered: u64,
    first_unanswered: Vec<Unanswered>,
    unsound_targets: u64,
    driver: String,
    /// Skills that are out of service.
    retired: Vec<String>,
}

impl<'a> Soak<'a> {
    fn start(args: &'a Args, mut bundles: Bundles) -> anyhow::Result<Self> {
        for index in 0..bundles.names().len() {
            bundles.install(index)?;
        }
        let seed = args.shared.seed;
        let installation = bundles.installation();
        let followed = Followed::now(installation, DEPLOYMENT);
        let loaded = load_deployment(installation, DEPLOYMENT).context("the bundles' deployment")?;
        ensure!(loaded.refused.is_empty(), "found {:?}, wanted every bundle's skill", loaded.refused);
        let deployment = loaded.deployment.clone();
        let (config, robot) = (RuntimeConfig::from(&deployment), loaded.robot.clone());
        let tally = Tally::default();
        let mut skills = Vec::new();
        for (index, skill) in loaded.skills.into_iter().enumerate() {
            let skill = Skill::of(skill, &robot.description)?;
            skills.push(Moody::around(skill, Draws::new(seed, "soak.prediction", index as u64), &tally));
        }
        let loads = skills.len() as u64;
        // A hang of an isolated plugin is not an overrun of the loop's: simulated time waits for it.
        let supervision = Supervision {
            clock,
            deadlines: Deadlines { act_s: 10.0, predict_s: 10.0 },
            pace: Pace::Simulated,
        };
        let runtime = Runtime::from_skills(config, robot.clone(), skills)
            .with_switching(deployment.switching)
            .supervised(supervision)?;
        let running: Vec<String> = runtime.rules().iter().map(|rule| rule.name.clone()).collect();
        let watch = Watch::new(followed, deployment, robot, running, None);
        let mut changes = Draws::new(seed, "soak.change", 0);
        Ok(Self {
            args,
            senses: Senses::new(runtime.robot(), seed, &tally),
            record: Record::start(&bundles.folder().join("decisions.mcap"), &runtime)?,
            next_change: changes.between(CHANGE_TICKS),
            memory: Memory::of(args.ticks),
            bundles,
            runtime,
            watch,
            changes,
            tally,
            loads,
            added: 0,
            removed: 0,
            switches: 0,
            driven: 0,
            unanswered: 0,
            first_unanswered: Vec::new(),
            unsound_targets: 0,
            driver: STAND.to_owned(),
            retired: Vec::new(),
        })
    }

    fn run(mut self) -> anyhow::Result<Report> {
        let began = clock();
        let ticks = self.args.ticks;
        let bar = progress::bar("soaking", ticks);
        for tick in 0..ticks {
            if tick == self.next_change {
                self.change()?;
                self.next_change = tick + self.changes.between(CHANGE_TICKS);
            }
            self.tick(tick)?;
            if (tick + 1) % SEGMENT_TICKS == 0 || tick + 1 == ticks {
                self.record.turn_over(&self.runtime)?;
                self.memory.sample(tick)?;
                bar.set_position(tick + 1);
            }
        }
        bar.finish_and_clear();
        Ok(self.report(clock().saturating_sub(began).as_secs_f64()))
    }

    fn tick(&mut self, tick: u64) -> anyhow::Result<()> {
        let (observation, wanted) = self.senses.at(tick, TICK_S * tick as f64);
        let Tick { decision, joints, .. } = self.runtime.tick(&observation);
        self.unsound_targets += u64::from(!joints.iter().all(is_sound));
        if !is_answered(decision, wanted) {
            self.unanswered += 1;
            if self.first_unanswered.len() < SHOWN {
                self.first_unanswered.push(Unanswered::of(decision, wanted));
            }
        }
        self.driven += u64::from(decision.active != STAND);
        if decision.active != self.driver {
            self.switches += 1;
            self.driver.clone_from(&decision.active);
        }
        for event in &decision.events {
            self.tally.count_event(event);
        }
        let retired = decision.skills.iter().filter(|skill| skill.reason.is_out_of_service());
        self.retired.clear();
        self.retired.extend(retired.map(|skill| skill.name.clone()));
        self.record.write(decision)
    }

    /// Installs or removes a skill, every other time one that is missing or out of service.
    fn change(&mut self) -> anyhow::Result<()> {
        let names = self.bundles.names();
        let needs_change = |name: &&String| !self.bundles.is_installed(name) || self.retired.contains(name);
        let needy: Vec<String> = names.iter().filter(needs_change).cloned().collect();
        let from = if needy.is_empty() || self.changes.is_one_in(2) { names } else { &needy };
        let name = &from[self.changes.below(from.len() as u64) as usize];
        let index = names.iter().position(|known| known == name).context("a bundle's name")?;
        if self.bundles.is_installed(name) {
            self.bundles.remove(index)?;
            self.removed += 1;
        } else {
            self.bundles.install(index)?;
            self.added += 1;
        }
        let found = self.watch.look().or_else(|| self.watch.look());
        let Roster { places, events, deadlines } =
            found.context("a changed installation: found no change of skills")?;
        let mut wrap = |place| match place {
            Place::New(skill) => {
                self.loads += 1;
                let draws = Draws::new(self.args.shared.seed, "soak.prediction", self.loads);
                Place::New(Moody::around(skill, draws, &self.tally))
            }
            kept @ Place::Kept(_) => kept,
        };
        let places = places.into_iter().map(&mut wrap).collect();
        drop(self.runtime.adopt(Roster { places, events, deadlines }));
        Ok(())
    }

    fn report(self, wall_s: f64) -> Report {
        let (args, ticks) = (self.args, self.args.ticks);
        Report {
            command: format!(
                "vocaloco bench soak --ticks {ticks} --deployment {} --seed {}",
                args.deployment, args.shared.seed
            ),
            seed: args.shared.seed,
            version: env!("CARGO_PKG_VERSION"),
            deployment: args.deployment.clone(),
            ticks,
            missed: ticks.saturating_sub(self.record.read()),
            replay_differs: self.record.differing(),
            unanswered: self.unanswered,
            first_unanswered: self.first_unanswered,
            unsound_targets: self.unsound_targets,
            rss_growth: self.memory.growth(),
            judges_growth: ticks >= JUDGED_TICKS,
            rss_mib: self.memory.curve(),
            open_files: self.memory.open_files(),
            faults: self.tally.counts(),
            skills_added: self.added,
            skills_removed: self.removed,
            switches: self.switches,
            driven_share: self.driven as f64 / ticks as f64,
            wall_s,
            ticks_per_s: ticks as f64 / wall_s,
            timing: self.runtime.times(),
            differences: self.record.into_differences(),
        }
    }
}

/// Whether a fault that must end in the stand does: the one that was put in, and any that the decision names.
fn is_answered(decision: &Decision, wanted: Option<Forced>) -> bool {
    let stands = decision.active == STAND;
    let is_said = wanted.is_none_or(|wanted| decision.forced == Some(wanted));
    is_said && (stands || !decision.forced.is_some_and(Forced::is_stop))
}

fn is_sound(target: &JointTarget) -> bool {
    let JointTarget { position_rad, stiffness_nm_per_rad, damping_nms_per_rad, feed_forward_nm } = *target;
    [position_rad, stiffness_nm_per_rad, damping_nms_per_rad, feed_forward_nm].iter().all(|it| it.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_answered_by_the_stand_of_the_same_tick_and_its_name_alone() {
        let decision =
            |active: &str, forced| Decision { active: active.into(), forced, ..Decision::default() };
        let [terrain, fault] = [Forced::Terrain, Forced::Fault].map(Some);
        assert!(is_answered(&decision("walk", None), None));
        assert!(is_answered(&decision(STAND, terrain), terrain));
        assert!(is_answered(&decision(STAND, fault), None));
        assert!(!is_answered(&decision("walk", fault), None), "goes on after a fault");
        assert!(!is_answered(&decision("walk", terrain), terrain));
        assert!(!is_answered(&decision(STAND, None), terrain), "stands for another reason");
    }
}
