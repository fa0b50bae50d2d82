//! `run`: the 50 Hz loop of a deployment, fed by the simulator, by lines on stdin, or by a log.

#[cfg(feature = "sim")]
mod course;
mod input;
pub(crate) mod pace;
mod replay;
mod stdio;

use std::path::PathBuf;
use std::str::FromStr;

use anyhow::Context as _;
use vocaloco_core::installation::Installation;
use vocaloco_core::lock::{Lock, PublicKey};
use vocaloco_core::registry::{LoadedDeployment, load_deployment, load_locked};
use vocaloco_core::runtime::{Followed, Follower, Runtime};

use super::Shared;
use crate::exit::Exit;
use crate::output;

/// Runs the 50 Hz loop of a deployment.
///
/// `--source stdio`: one JSON object a line in, one a line out, a greeting first (docs/bridge.md); stdin's end is a
/// clean stop, as SIGINT, SIGTERM and SIGHUP are, and exit code 1 says that a line could not be used. `--source
/// sim`: a course in the simulator. `--source replay:FILE`: decides the fields of a log over again and compares;
/// exit code 1 when anything comes out otherwise.
///
/// From stdin, and with `--real-time`, the deployment's files are followed: a skill that it names anew, or whose
/// manifest or models change, takes part within a second, one that is taken away ends in the stand; with
/// `--locked`, once a new lock has it. A bad file changes nothing.
///
/// Without `--real-time` the loop lives in the source's time: calls over their budget are counted, and a
/// run repeats. With it such a call means stand, and the simulator keeps to the clock. What ticks took is
/// the last line on stderr; with `--json` it is an object.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    shared: Shared,
    /// Deployment whose skills may run
    #[arg(long, default_value = "anymal_stairs", value_name = "NAME")]
    deployment: String,
    /// sim, stdio or replay:FILE
    #[arg(long, value_name = "SOURCE")]
    source: Source,
    /// Write every decision to this MCAP file; not with replay:FILE. With stdio a log that is there already is set
    /// aside as FILE.1, FILE.2, …, before its extension
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Stand rather than wait for a plugin or a prediction over its budget; not with replay:FILE
    #[arg(long)]
    real_time: bool,
    /// Take only what the deployment's lock has (`vocaloco lock`)
    #[arg(long)]
    locked: bool,
    /// Take only a lock that this public key has signed, whatever the deployment trusts; may be given more
    /// than once
    #[arg(long, value_name = "KEY", requires = "locked")]
    trust: Vec<PublicKey>,
    #[cfg(feature = "sim")]
    #[command(flatten)]
    course: course::CourseArgs,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Source {
    Sim,
    Stdio,
    Replay(PathBuf),
}

impl FromStr for Source {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.strip_prefix("replay:")) {
            ("sim", _) => Ok(Self::Sim),
            ("stdio", _) => Ok(Self::Stdio),
            (_, Some(file)) if !file.is_empty() => Ok(Self::Replay(file.into())),
            _ => Err(format!("found {text:?}, wanted sim, stdio or replay:FILE")),
        }
    }
}

pub(crate) fn run(args: Args) -> anyhow::Result<Exit> {
    match &args.source {
        Source::Stdio => stdio::run(&args),
        Source::Replay(file) => replay::run(&args, file),
        #[cfg(feature = "sim")]
        Source::Sim => course::run(&args),
        #[cfg(not(feature = "sim"))]
        Source::Sim => {
            anyhow::bail!("--source: found sim, wanted stdio or replay:FILE in a build without `sim`")
        }
    }
}

/// The loop of the deployment, and why skills were refused.
fn start(args: &Args, follows: bool) -> anyhow::Result<(Runtime, Vec<String>)> {
    let installation = Installation::find().context("no installation")?;
    let followed = Followed::now(&installation, &args.deployment);
    let (loaded, refused) = load(args)?;
    let supervision = args.supervision(loaded.deployment.deadlines);
    let (deployment, robot) = (loaded.deployment.clone(), loaded.robot.clone());
    let runtime = Runtime::new(loaded)?.supervised(supervision)?;
    if !follows {
        return Ok((runtime, refused));
    }
    let followed = if args.locked { followed.locked(args.trust.clone()) } else { followed };
    let running: Vec<String> = runtime.rules().iter().map(|rule| rule.name.clone()).collect();
    let follower = Follower::start(followed, deployment, robot, running, Some(supervision))
        .context("found no thread to follow the deployment's files on, wanted one")?;
    Ok((runtime.following(follower), refused))
}

/// The deployment, each refused skill named on stderr, and those lines.
fn load(args: &Args) -> anyhow::Result<(LoadedDeployment, Vec<String>)> {
    let installation = Installation::find().context("no installation")?;
    let name = &args.deployment;
    let loaded = if args.locked {
        let lock = Lock::read(&installation, name).context("--locked")?;
        lock.check_signature(&args.trust).context("--trust")?;
        load_locked(&installation, name, &lock)
    } else {
        load_deployment(&installation, name)
    };
    let loaded = loaded.with_context(|| format!("deployment `{name}`"))?;
    anyhow::ensure!(
        args.locked || loaded.deployment.trusted_keys.is_empty(),
        "deployment `{name}`: trusted_keys: found a run without --locked, wanted --locked: only a lock is signed"
    );
    let refused: Vec<String> = loaded.refused.iter().map(ToString::to_string).collect();
    for line in &refused {
        output::narrate(format_args!("refused: {line}"));
    }
    Ok((loaded, refused))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_is_sim_stdio_or_the_replay_of_a_file() {
        assert_eq!("sim".parse(), Ok(Source::Sim));
        assert_eq!("stdio".parse(), Ok(Source::Stdio));
        assert_eq!("replay:out/a.mcap".parse(), Ok(Source::Replay("out/a.mcap".into())));
        for wrong in ["", "ros2", "replay", "replay:"] {
            assert!(wrong.parse::<Source>().is_err(), "{wrong}");
        }
    }
}
