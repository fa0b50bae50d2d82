//! `vocaloco`: the command line that people use and robots run, and the only place that prints.
//! Arguments are parsed here; each verb lives in its own file under `verbs/`.

mod allocations;
mod exit;
mod output;
mod progress;
#[cfg(feature = "sim")]
mod report;
mod verbs;

use std::process::ExitCode;

use clap::{CommandFactory, Parser};
use exit::Exit;
use verbs::Verb;

#[global_allocator]
static ALLOCATOR: allocations::Counting = allocations::Counting;

#[derive(Parser)]
#[command(name = "vocaloco", version, about = ABOUT, after_help = EXAMPLES, disable_help_subcommand = true)]
struct Cli {
    #[command(subcommand)]
    verb: Option<Verb>,
}

const ABOUT: &str = "Chooses, at 50 Hz, the cheapest viable locomotion skill of a legged robot.

A plugin is the code, a skill is a plugin bound to its models by a manifest, a deployment says which
skills may run. Every verb has --help, takes --json and --seed, and repeats exactly.";

#[cfg(feature = "sim")]
const EXAMPLES: &str = "Examples:
  vocaloco demo                                   stairs courses, a table and out/demo/report.html
  vocaloco skills list                            what is installed
  vocaloco skills check                           whether it is sound
  vocaloco evaluate viability --skill ascend --terrain stairs_up --size-m 0.1,0.2 --samples 200
  vocaloco look --skill ascend --terrain stairs_up --size-m 0.15 --page out/look.html
  vocaloco explain out/demo/decisions-stairs_up-0.12.mcap --tick 250
  vocaloco bench rollouts                         how fast this machine collects

One more skill, touching no other (docs/add-a-skill.md):
  vocaloco skills new trot --from policy.onnx     from an exported network; without --from a plugin in Rust
  vocaloco collect --skill trot --kind viability --samples 20000 --repeats 1 --plant fast
  vocaloco collect --skill trot --kind cot --samples 8000 --plant fast
  vocaloco train --skill trot

Exit codes: 0 fine, 1 a finding, 2 could not run.";

#[cfg(not(feature = "sim"))]
const EXAMPLES: &str = "Examples:
  vocaloco skills list                            what is installed
  vocaloco skills check                           whether it is sound
  vocaloco run --deployment anymal_stairs --source stdio
  vocaloco explain decisions.mcap --tick 250

This build has no simulator: demo, collect, data, evaluate and look need the feature `sim`.
Exit codes: 0 fine, 1 a finding, 2 could not run.";

fn main() -> ExitCode {
    // The very program that runs, whatever its file is called and even when that was replaced meanwhile.
    #[cfg(target_os = "linux")]
    vocaloco_core::plugin::isolate_with("/proc/self/exe".into());
    match dispatch(Cli::parse()) {
        Ok(exit) => exit.into(),
        Err(error) if output::reader_is_gone(&error) => Exit::Fine.into(),
        Err(error) => {
            // `{:#}` is the whole chain in one line: what failed, then why.
            eprintln!("error: {error:#}");
            Exit::CouldNotRun.into()
        }
    }
}

fn dispatch(cli: Cli) -> anyhow::Result<Exit> {
    if let Some(verb) = cli.verb {
        return verb.run();
    }
    output::line(&Cli::command().render_long_help().to_string())?;
    Ok(Exit::Fine)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_verb_takes_json_and_seed() {
        for verb in Cli::command().get_subcommands() {
            let takes = |name: &str, command: &clap::Command| {
                command.get_arguments().any(|argument| argument.get_long() == Some(name))
            };
            let mut leaves: Vec<_> = verb.get_subcommands().collect();
            if leaves.is_empty() {
                leaves.push(verb);
            }
            for leaf in leaves {
                for flag in ["json", "seed"] {
                    assert!(
                        takes(flag, leaf) || takes(flag, verb),
                        "`{} {}` lacks --{flag}",
                        verb.get_name(),
                        leaf.get_name()
                    );
                }
            }
        }
    }
}
