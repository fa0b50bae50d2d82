//! Learning curves: a table that grows by a row per round and iteration, written as CSV, as a
//! `TensorBoard` event file and as a picture. A resumed run reads the CSV back.

use std::fmt::Write;

use anyhow::{Context, ensure};

use super::trainer::{DriveRecord, ImitationRecord, IterationRecord};

/// Columns before the reward's terms.
const COLUMNS: [&str; 16] = [
    "steps",
    "reward",
    "episode_steps",
    "episode_reward",
    "terminated_share",
    "level",
    "divergence",
    "learning_rate",
    "std",
    "surrogate_loss",
    "value_loss",
    "clipped_share",
    "imitation_loss",
    "fresh_imitation_loss",
    "expert_share",
    "samples",
];

/// The table; what a phase has no number for stays empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curves {
    columns: Vec<String>,
    rows: Vec<Vec<Option<f64>>>,
}

impl Curves {
    /// Names of the columns.
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Number of rows: rounds, then iterations.
    pub fn rows(&self) -> usize {
        self.rows.len()
    }

    /// The numbers of a column with the rows they stand in, from 1.
    pub fn column(&self, name: &str) -> Vec<(usize, f64)> {
        let Some(at) = self.columns.iter().position(|column| column == name) else { return Vec::new() };
        let rows = self.rows.iter().enumerate();
        rows.filter_map(|(row, values)| Some((row + 1, values[at]?))).collect()
    }

    /// Forgets rows beyond the first `rows`: they are found again.
    pub fn truncate(&mut self, rows: usize) {
        self.rows.truncate(rows);
    }

    /// A round of imitation.
    pub fn add_round(&mut self, record: &ImitationRecord) {
        let mut values = self.row(record.steps, &record.drive);
        values[12] = Some(record.fit.loss);
        values[13] = Some(record.fit.fresh_loss);
        values[14] = Some(record.fit.expert_share);
        values[15] = Some(record.fit.samples as f64);
        self.rows.push(values);
    }

    /// An iteration of reinforcement learning.
    pub fn add_iteration(&mut self, record: &IterationRecord) {
        let mut values = self.row(record.steps, &record.drive);
        values[6] = Some(record.update.divergence);
        values[7] = Some(f64::from(record.learning_rate));
        values[8] = Some(f64::from(record.std));
        values[9] = Some(record.update.surrogate_loss);
        values[10] = Some(record.update.value_loss);
        values[11] = Some(record.update.clipped_share);
        values[12] = Some(record.update.imitation_loss);
        self.rows.push(values);
    }

    fn row(&mut self, steps: u64, drive: &DriveRecord) -> Vec<Option<f64>> {
        if self.columns.is_empty() {
            let terms = drive.terms.iter().map(|(name, _)| format!("reward/{name}"));
            self.columns = COLUMNS.iter().map(|name| (*name).to_owned()).chain(terms).collect();
        }
        let ended = drive.episodes > 0;
        let mut values = vec![None; self.columns.len()];
        values[0] = Some(steps as f64);
        values[1] = Some(drive.reward);
        values[2] = ended.then_some(drive.episode_steps);
        values[3] = ended.then_some(drive.episode_reward);
        values[4] = ended.then_some(drive.terminated_share);
        values[5] = Some(drive.level);
        for (value, (_, term)) in values[COLUMNS.len()..].iter_mut().zip(&drive.terms) {
            *value = Some(*term);
        }
        values
    }

    /// As CSV, with the row's number in front.
    pub fn csv(&self) -> String {
        let mut text = format!("row,{}\n", self.columns.join(","));
        for (row, values) in self.rows.iter().enumerate() {
            let cells: Vec<String> = values
                .iter()
                .map(|value| value.map_or_else(String::new, |value| value.to_string()))
                .collect();
            let _ = writeln!(text, "{},{}", row + 1, cells.join(","));
        }
        text
    }

    /// From CSV.
    ///
    /// # Errors
    /// A line has another number of cells than the first, or what is no number.
    pub fn parse(text: &str) -> anyhow::Result<Self> {
        let mut lines = text.lines();
        let columns: Vec<String> =
            lines.next().unwrap_or_default().split(',').skip(1).map(str::to_owned).collect();
        let mut rows = Vec::new();
        for (at, line) in lines.enumerate() {
            let cell = |cell: &str| {
                if cell.is_empty() { Ok(None) } else { cell.parse().map(Some) }
            };
            let row: Result<Vec<Option<f64>>, _> = line.split(',').skip(1).map(cell).collect();
            let row = row.with_context(|| format!("line {}: found what is no number", at + 2))?;
            ensure!(
                row.len() == columns.len(),
                "line {}: found {} cells, wanted {}",
                at + 2,
                row.len() + 1,
                columns.len() + 1
            );
            rows.push(row);
        }
        Ok(Self { columns, rows })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) fn curves() -> Curves {
        let drive = DriveRecord { reward: 0.1, terms: vec![("speed", 0.25)], ..DriveRecord::default() };
        let mut curves = Curves::default();
        curves.add_round(&ImitationRecord {
            round: 1,
            steps: 100,
            drive: drive.clone(),
            fit: super::super::imitation::RoundRecord { loss: 0.5, ..Default::default() },
        });
        curves.add_iteration(&IterationRecord {
            iteration: 1,
            steps: 200,
            drive,
            update: super::super::ppo::UpdateRecord { divergence: 0.01, ..Default::default() },
            learning_rate: 1e-3,
            std: 0.3,
        });
        curves
    }

    #[test]
    fn a_table_is_read_as_it_was_written() {
        let curves = curves();
        assert_eq!(Curves::parse(&curves.csv()).unwrap(), curves);
        assert_eq!(curves.column("divergence"), [(2, 0.01)]);
        assert_eq!(curves.column("reward/speed"), [(1, 0.25), (2, 0.25)]);
    }

    #[test]
    fn a_line_that_is_cut_short_is_refused_by_its_number() {
        let text = curves().csv();
        let error = Curves::parse(&text[..text.len() - 30]).unwrap_err().to_string();
        assert!(error.contains("line 3"), "{error}");
    }
}
