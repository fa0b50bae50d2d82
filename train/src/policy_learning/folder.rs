//! The folder of a run: its checkpoint, its curves in three forms, its policy so far, what it was run with.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde::Serialize;

use super::checkpoint::{Run, decode, encode};
use super::config::Plan;
use super::curves::Curves;
use super::event_file;
use super::learner::{Learner, Widths};
use super::picture;
use crate::files::write_whole;

/// Where a run keeps what it has.
pub struct RunFolder {
    path: PathBuf,
}

impl RunFolder {
    /// The folder at `path`, which the first write makes.
    pub fn new(path: PathBuf) -> Self {
        Self { path }
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The checkpoint's file.
    pub fn checkpoint(&self) -> PathBuf {
        self.path.join("checkpoint.safetensors")
    }

    /// The policy's file, as it was at the last checkpoint.
    pub fn policy(&self) -> PathBuf {
        self.path.join("policy.onnx")
    }

    /// Writes with what the run was started.
    ///
    /// # Errors
    /// The folder does not take it.
    pub fn write_run(&self, run: &impl Serialize) -> anyhow::Result<()> {
        write_whole(&self.path.join("run.json"), &serde_json::to_vec_pretty(run)?)
    }

    /// Writes all that a stopped run goes on from, and what one wants to look at meanwhile.
    ///
    /// # Errors
    /// The folder does not take it.
    pub fn write(
        &self,
        learner: &Learner,
        run: &Run,
        curves: &Curves,
        policy: &[u8],
        title: &str,
    ) -> anyhow::Result<()> {
        let write = |name: &str, bytes: &[u8]| write_whole(&self.path.join(name), bytes);
        write("curves.csv", curves.csv().as_bytes())?;
        write("curves.svg", picture::svg(curves, title).as_bytes())?;
        write("events.out.tfevents.1.vocaloco", &event_file::encode(curves))?;
        write("policy.onnx", policy)?;
        // Last: whoever goes on from it finds the rest.
        write_whole(&self.checkpoint(), &encode(learner, run))
    }

    /// What a stopped run goes on from.
    ///
    /// # Errors
    /// There is nothing, it does not fit, or it was run with another seed or configuration.
    pub fn resume(&self, run: &Run, plan: &Plan, widths: Widths) -> anyhow::Result<(Learner, Curves)> {
        let file = self.checkpoint();
        let (learner, found) = read_checkpoint(&file, plan, widths)?;
        if found.seed != run.seed {
            bail!("{}: seed: found {}, wanted {}", file.display(), found.seed, run.seed);
        }
        if found.config != run.config {
            let [found, wanted] = first_difference(&found.config, &run.config);
            bail!(
                "{}: the run's configuration: found {found}, wanted {wanted}; a run resumes under the same one",
                file.display()
            );
        }
        let path = self.path.join("curves.csv");
        let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        let mut curves = Curves::parse(&text).with_context(|| path.display().to_string())?;
        curves.truncate((learner.rounds + learner.iteration) as usize);
        Ok((learner, curves))
    }
}

/// The learner of a checkpoint and the run that it belongs to.
///
/// # Errors
/// There is no such file, or it does not fit.
pub fn read_checkpoint(path: &Path, plan: &Plan, widths: Widths) -> anyhow::Result<(Learner, Run)> {
    let context = || path.display().to_string();
    let bytes = std::fs::read(path).with_context(context)?;
    decode(&bytes, plan, widths).with_context(context)
}

/// The first lines in which two texts differ.
fn first_difference<'a>(a: &'a str, b: &'a str) -> [&'a str; 2] {
    let mut lines = a.lines().zip(b.lines());
    lines.find(|(a, b)| a != b).map_or(["another length"; 2], |(a, b)| [a.trim(), b.trim()])
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTHS: Widths = Widths { observation: 3, privileged: 4, action: 2 };

    fn written() -> (tempfile::TempDir, RunFolder, Plan, Run) {
        let folder = tempfile::tempdir().unwrap();
        let plan = Plan::with_environment(2, ());
        let run = Run { seed: 1, config: "{\n  \"a\": 1,\n  \"b\": 2\n}".to_owned() };
        let mut learner = Learner::new(&plan, WIDTHS, 1);
        learner.iteration = 2;
        let curves = Curves::parse("row,reward\n1,0.5\n2,0.25\n3,0.125\n").unwrap();
        let files = RunFolder::new(folder.path().join("walk-seed1"));
        files.write(&learner, &run, &curves, b"onnx", "walk").unwrap();
        (folder, files, plan, run)
    }

    #[test]
    fn a_resumed_run_has_its_learner_and_the_rows_up_to_its_checkpoint() {
        let (_kept, files, plan, run) = written();
        let (learner, curves) = files.resume(&run, &plan, WIDTHS).unwrap();
        assert_eq!((learner.iteration, curves.rows()), (2, 2));
    }

    #[test]
    fn another_configuration_is_refused_by_the_line_that_differs() {
        let (_kept, files, plan, run) = written();
        let other = Run { config: run.config.replace('2', "3"), ..run.clone() };
        let error = files.resume(&other, &plan, WIDTHS).unwrap_err().to_string();
        assert!(error.contains("found \"b\": 2, wanted \"b\": 3"), "{error}");
        let error = files.resume(&Run { seed: 9, ..run }, &plan, WIDTHS).unwrap_err().to_string();
        assert!(error.contains("seed: found 1, wanted 9"), "{error}");
    }

    #[test]
    fn nothing_to_resume_is_said_with_the_file_s_name() {
        let files = RunFolder::new("/nowhere".into());
        let run = Run { seed: 1, config: String::new() };
        let error = files.resume(&run, &Plan::with_environment(1, ()), WIDTHS).unwrap_err().to_string();
        assert!(error.contains("/nowhere/checkpoint.safetensors"), "{error}");
    }
}
