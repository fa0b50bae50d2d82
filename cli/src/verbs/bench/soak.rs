//! `bench soak`: the loop for a day and longer, with everything going wrong that may.

mod bundles;
mod memory;
mod record;
mod report;
mod tally;
mod trouble;

use std::hash::{DefaultHasher, Hasher};
use std::io;

use anyhow::{Context, ensure};
use vocaloco_core::decision::{Decision, Forced, STAND};
use vocaloco_core::installation::Installation;
use vocaloco_core::manifest::Deadlines;
use vocaloco_core::registry::load_deployment;
use vocaloco_core::runtime::{
    Followed, Pace, Place, Roster, Runtime, RuntimeConfig, Skill, Supervision, Tick, Watch,
};
use vocaloco_plugin_api::{JointDescription, JointTarget, RobotDescription};

use self::bundles::{Bundles, DEPLOYMENT};
use self::memory::Memory;
use self::record::{Record, SHOWN};
use self::report::{Report, Unanswered};
use self::tally::Tally;
use self::trouble::{Draws, Moody, Senses, Spoilt};
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
/// Every decision is logged, read back and decided again; a second run of the same seed has the same fingerprint,
/// which is of all that was decided and of every target. Exit code 1 when a decision is missing from the log or
/// comes out otherwise, when a fault of the terrain, a measurement or the active skill is not answered by the stand
/// in the same tick, when a skill counts as viable in a tick in which its prediction was spoiled, when a target is
/// no number or outside what its drive may be told, when more files stay open, or when memory grows by more than
/// 5 % of its highest in the first fifth of the ticks. From 200,000 ticks on growth is judged, and skills must drive in a
/// fifth of each fifth of the ticks; from 1,000,000 on every kind of fault must have come. What ticks took is said
/// and not judged: simulated time waits for what hangs. Linux only.
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
const JUDGED_TICKS: u64 = 200_000;
/// Ticks from which on every kind of fault must have come.
const COMPLETE_TICKS: u64 = 1_000_000;
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
    /// Ticks in which a skill drove, of each fifth.
    driven: [u64; 5],
    spoilt: Spoilt,
    fingerprint: Fingerprint,
    bounds: Bounds,
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
        let (mut skills, spoilt) = (Vec::new(), Spoilt::default());
        for (index, skill) in loaded.skills.into_iter().enumerate() {
            let skill = Skill::of(skill, &robot.description)?;
            let draws = Draws::new(seed, "soak.prediction", index as u64);
            skills.push(Moody::around(skill, draws, &tally, &spoilt));
        }
        let loads = skills.len() as u64;
        // A hang of an isolated plugin is not an overrun of the loop's: simulated time waits for it.
        let supervision = Supervision {
            clock,
            deadlines: Deadlines { act_s: 10.0, predict_s: 10.0 },
            pace: Pace::Simulated,
        };
        let bounds = Bounds::of(&robot.description);
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
            bounds,
            bundles,
            runtime,
            watch,
            changes,
            tally,
            loads,
            added: 0,
            removed: 0,
            switches: 0,
            driven: [0; 5],
            spoilt,
            fingerprint: Fingerprint::default(),
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
        self.unsound_targets += u64::from(!self.bounds.hold(joints));
        self.fingerprint.add(decision, joints)?;
        let believed = self.spoilt.believed(decision);
        if believed.is_some() || !is_answered(decision, wanted) {
            self.unanswered += 1;
            if self.first_unanswered.len() < SHOWN {
                self.first_unanswered.push(Unanswered::of(decision, wanted, believed));
            }
        }
        self.driven[(5 * tick / self.args.ticks) as usize] += u64::from(decision.active != STAND);
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
                Place::New(Moody::around(skill, draws, &self.tally, &self.spoilt))
            }
            kept @ Place::Kept(_) => kept,
        };
        let places = places.into_iter().map(&mut wrap).collect();
        drop(self.runtime.adopt(Roster { places, events, deadlines }));
        Ok(())
    }

    fn report(self, wall_s: f64) -> Report {
        let (args, ticks) = (self.args, self.args.ticks);
        let share = |driven: u64, of: u64| if of == 0 { 1.0 } else { driven as f64 / of as f64 };
        let fifths = [0, 1, 2, 3, 4].map(|fifth| {
            let begins = |fifth: u64| (fifth * ticks).div_ceil(5);
            share(self.driven[fifth as usize], begins(fifth + 1) - begins(fifth))
        });
        let mut kinds = trouble::kinds();
        kinds.extend(tally::kinds());
        let faults = self.tally.counts();
        kinds.retain(|kind| !faults.contains_key(*kind));
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
            judges_kinds: ticks >= COMPLETE_TICKS,
            missing_kinds: kinds,
            fingerprint: self.fingerprint.finish(),
            rss_mib: self.memory.curve(),
            open_files: self.memory.open_files(),
            faults,
            skills_added: self.added,
            skills_removed: self.removed,
            switches: self.switches,
            driven_share: share(self.driven.iter().sum(), ticks),
            driven_share_of_fifths: fifths,
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

/// What drives may be told, by joint: range, rad, and effort, N·m. Counted here once more, and not by what the runtime
/// refuses.
struct Bounds(Vec<([f32; 2], f32)>);

impl Bounds {
    fn of(robot: &RobotDescription) -> Self {
        let of = |joint: &JointDescription| {
            ([joint.lower_rad as f32, joint.upper_rad as f32], joint.effort_nm as f32)
        };
        Self(robot.joints.iter().map(of).collect())
    }

    /// Whether all are numbers, there are gains, and neither feed-forward nor a position outside the joint's range asks
    /// for more than its effort.
    fn hold(&self, joints: &[JointTarget]) -> bool {
        joints.len() == self.0.len()
            && joints.iter().zip(&self.0).all(|(target, ([lower, upper], effort_nm))| {
                let slack = 0.25 + effort_nm / target.stiffness_nm_per_rad;
                (lower - slack..=upper + slack).contains(&target.position_rad)
                    && (1.0..=1000.0).contains(&target.stiffness_nm_per_rad)
                    && (0.01..=100.0).contains(&target.damping_nms_per_rad)
                    && target.feed_forward_nm.abs() <= *effort_nm
            })
    }
}

/// Of all that was decided, and of every target, so far.
#[derive(Default)]
struct Fingerprint(DefaultHasher);

impl Fingerprint {
    fn add(&mut self, decision: &Decision, joints: &[JointTarget]) -> anyhow::Result<()> {
        // Nothing is allocated: heaps that are watched grow by others alone. The field is there by its hash.
        let Decision {
            t_s,
            tick,
            command,
            heightfield_hash,
            field: _,
            skills,
            choice,
            active,
            stopped,
            forced,
            committed,
            reason,
            events,
            timings: _,
            roster,
        } = decision;
        let seen = (t_s, tick, command, heightfield_hash, skills, roster);
        let decided = (choice, active, stopped, forced, committed, reason, events);
        serde_json::to_writer(Hashed(&mut self.0), &(seen, decided))?;
        for target in joints {
            let JointTarget { position_rad, stiffness_nm_per_rad, damping_nms_per_rad, feed_forward_nm } =
                *target;
            for value in [position_rad, stiffness_nm_per_rad, damping_nms_per_rad, feed_forward_nm] {
                self.0.write_u32(value.to_bits());
            }
        }
        Ok(())
    }

    fn finish(&self) -> String {
        format!("{:016x}", self.0.finish())
    }
}

/// What is written is hashed.
struct Hashed<'a>(&'a mut DefaultHasher);

impl io::Write for Hashed<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
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

    #[test]
    fn a_target_outside_what_a_drive_may_be_told_is_noticed() {
        let bounds = Bounds(vec![([-1.0, 1.0], 80.0); 2]);
        let stand = JointTarget {
            position_rad: 0.3,
            stiffness_nm_per_rad: 80.0,
            damping_nms_per_rad: 2.0,
            feed_forward_nm: 0.0,
        };
        assert!(bounds.hold(&[stand; 2]) && !bounds.hold(&[stand]));
        for wrong in [
            JointTarget { position_rad: 50.0, ..stand },
            JointTarget { position_rad: f32::NAN, ..stand },
            JointTarget { stiffness_nm_per_rad: 0.0, ..stand },
            JointTarget { stiffness_nm_per_rad: -80.0, ..stand },
            JointTarget { damping_nms_per_rad: 0.0, ..stand },
            JointTarget { damping_nms_per_rad: f32::INFINITY, ..stand },
            JointTarget { feed_forward_nm: f32::NAN, ..stand },
            JointTarget { feed_forward_nm: 1e9, ..stand },
        ] {
            assert!(!bounds.hold(&[stand, wrong]), "{wrong:?}");
        }
    }

    #[test]
    fn one_bit_of_a_target_or_one_word_of_a_decision_is_another_fingerprint() {
        let of = |position_rad: f32, event: &str| {
            let mut fingerprint = Fingerprint::default();
            let decision = Decision { events: vec![event.to_owned()], ..Decision::default() };
            fingerprint.add(&decision, &[JointTarget { position_rad, ..JointTarget::default() }]).unwrap();
            fingerprint.finish()
        };
        assert_eq!(of(0.5, "late"), of(0.5, "late"));
        assert_ne!(of(0.5, "late"), of(f32::from_bits(0.5_f32.to_bits() + 1), "late"));
        assert_ne!(of(0.5, "late"), of(0.5, "last"));
    }
}
