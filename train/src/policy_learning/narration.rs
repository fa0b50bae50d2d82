//! What a run tells on stderr: a bar for who watches, a line per segment for who reads it later.

use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use super::trainer::{DriveRecord, ImitationRecord, IterationRecord};

/// Seconds of an environment's step.
const TICK_S: f64 = 0.02;

/// The narrator of one run.
pub(super) struct Narration {
    bar: ProgressBar,
    json: bool,
}

/// How far a run is and how fast.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    /// Rounds or iterations done and wanted.
    pub(super) done: [u64; 2],
    /// Steps a second since the last line, learning included.
    pub(super) steps_per_s: f64,
    /// Time left at that pace, minutes.
    pub(super) minutes_left: f64,
}

impl Narration {
    /// Over `length` rounds and iterations; hidden when stderr is no terminal.
    pub(super) fn new(length: u64, json: bool) -> Self {
        let bar = ProgressBar::new(length);
        let style = ProgressStyle::with_template("{bar:24} {pos}/{len}, {msg}, {eta} left");
        Self { bar: if let Ok(style) = style { bar.with_style(style) } else { bar }, json }
    }

    /// A round is over.
    pub(super) fn round(&self, record: &ImitationRecord) {
        self.bar.inc(1);
        self.bar.set_message(format!("imitation, loss {:.4}", record.fit.fresh_loss));
    }

    /// An iteration is over.
    pub(super) fn iteration(&self, record: &IterationRecord) {
        self.bar.inc(1);
        self.bar.set_message(format!(
            "reward {:.4}, level {:.2}, KL {:.4}",
            record.drive.reward, record.drive.level, record.update.divergence
        ));
    }

    /// The line of a round.
    pub(super) fn round_line(&self, record: &ImitationRecord, pace: Pace) {
        if self.json {
            self.line(&json!({ "round": record, "steps_per_s": pace.steps_per_s }).to_string());
        } else {
            self.line(&format!(
                "imitation {}/{}: {} steps, {:.0} steps/s, expert drives {:.0} %, loss {:.5} on fresh states, \
                 {:.5} on {} kept; {}",
                pace.done[0],
                pace.done[1],
                record.steps,
                pace.steps_per_s,
                100.0 * record.fit.expert_share,
                record.fit.fresh_loss,
                record.fit.loss,
                record.fit.samples,
                drive(&record.drive),
            ));
        }
    }

    /// The line of a segment, by its last iteration.
    pub(super) fn segment_line(&self, record: &IterationRecord, pace: Pace) {
        if self.json {
            let line = json!({
                "iteration": record,
                "steps_per_s": pace.steps_per_s,
                "minutes_left": pace.minutes_left,
            });
            self.line(&line.to_string());
        } else {
            self.line(&format!(
                "iteration {}/{}: {} steps, {:.0} steps/s, {:.0} min left; KL {:.4}, learning rate {:.1e}, \
                 std {:.3}, value loss {:.4}; {}",
                pace.done[0],
                pace.done[1],
                record.steps,
                pace.steps_per_s,
                pace.minutes_left,
                record.update.divergence,
                record.learning_rate,
                record.std,
                record.update.value_loss,
                drive(&record.drive),
            ));
        }
    }

    /// The bar goes.
    pub(super) fn end(&self) {
        self.bar.finish_and_clear();
    }

    fn line(&self, text: &str) {
        self.bar.suspend(|| eprintln!("{text}"));
    }
}

fn drive(record: &DriveRecord) -> String {
    let terms: Vec<String> = record.terms.iter().map(|(name, value)| format!("{name} {value:.5}")).collect();
    format!(
        "level {:.2}, {} episodes of {:.1} s, {:.0} % falls, reward {:.5} a step: {}",
        record.level,
        record.episodes,
        record.episode_steps * TICK_S,
        100.0 * record.terminated_share,
        record.reward,
        terms.join(", ")
    )
}
