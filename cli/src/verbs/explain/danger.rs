//! `--danger`: which cells of the recorded field drive each skill's viability, by the predictors that are
//! installed now.

use std::fmt::Write;

use anyhow::Context;
use serde::Serialize;
use vocaloco_core::{
    danger::{Danger, danger},
    decision::Decision,
    heightfield::{COLUMNS, Heightfield, ROWS},
    installation::Installation,
    manifest::SkillManifest,
    predictor::{Predictor, Quantity},
};

/// A prediction that differs by more than this from the record comes from another model.
const SAME: f32 = 1e-3;

/// What the cells do to one skill's viability.
#[derive(Clone, Debug, Serialize)]
pub(super) struct DangerOf {
    skill: String,
    /// Viability on level ground, and on the recorded field.
    level: f32,
    here: f32,
    /// Whether the installed predictor says what the record says.
    as_recorded: bool,
    /// The cell that takes most: ahead and left of the base, m, and what it takes.
    worst_at_m: [f32; 2],
    worst: f32,
    /// `[row][column]`, back to front, left to right: what each cell adds to viability.
    credit: Vec<Vec<f32>>,
}

/// Of every skill that a decision knows.
pub(super) fn of(decision: &Decision) -> anyhow::Result<Vec<DangerOf>> {
    let field = decision.field.as_ref().with_context(|| {
        format!("--danger: found no usable terrain in tick {}, wanted a tick with a field", decision.tick)
    })?;
    let installation = Installation::find()?;
    let of_skill = |verdict: &vocaloco_core::decision::SkillVerdict| {
        let name = &verdict.name;
        let manifest = SkillManifest::read(&installation.skill_file(name))?;
        let path = installation.skill_folder(name).join(&manifest.models.viability);
        let mut predictor = Predictor::load(&path, Quantity::Viability)?;
        let found = danger(field, |field| predictor.predict(field))?;
        let (cell, worst) = found.worst().unwrap_or((0, 0.0));
        let Danger { level, here, credit } = found;
        anyhow::Ok(DangerOf {
            skill: name.clone(),
            level,
            here,
            as_recorded: verdict.viability.is_some_and(|then| (then - here).abs() <= SAME),
            worst_at_m: Heightfield::point(cell / COLUMNS, cell % COLUMNS),
            worst,
            credit: credit.chunks(COLUMNS).map(<[f32]>::to_vec).collect(),
        })
    };
    decision.skills.iter().map(of_skill).collect()
}

/// In words and as a map: ahead is to the right, left is up.
pub(super) fn lines(dangers: &[DangerOf]) -> Vec<String> {
    let most = dangers
        .iter()
        .flat_map(|danger| danger.credit.iter().flatten())
        .fold(1e-6_f32, |most, credit| most.max(credit.abs()));
    let mut lines = vec![format!(
        "where the danger is: back on the left, ahead on the right; █▓▒░ take viability away, + gives it (█ is {most:.3} a cell)"
    )];
    for danger in dangers {
        let DangerOf { skill, level, here, as_recorded, worst_at_m: [ahead_m, left_m], worst, .. } = danger;
        let mut words = format!("  {skill}: {level:.3} on level ground, {here:.3} here");
        if *worst < -0.001 {
            let _ = write!(
                words,
                "; most is taken {ahead_m:+.1} m ahead, {left_m:+.1} m to the left ({worst:+.3})"
            );
        }
        if !as_recorded {
            words.push_str("; the installed predictor is not the log's");
        }
        lines.push(words);
        for column in 0..COLUMNS {
            let cell = |row: usize| {
                let credit = danger.credit[row][column] / most;
                match credit {
                    c if c < -0.5 => '█',
                    c if c < -0.2 => '▓',
                    c if c < -0.08 => '▒',
                    c if c < -0.03 => '░',
                    c if c > 0.08 => '+',
                    _ => '·',
                }
            };
            lines.push(format!("    {}", (0..ROWS).map(cell).collect::<String>()));
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_map_has_the_danger_ahead_on_the_right_and_the_left_side_on_top() {
        let mut credit = vec![vec![0.0; COLUMNS]; ROWS];
        credit[25][1] = -0.3;
        credit[3][9] = 0.1;
        let danger = DangerOf {
            skill: "trot".into(),
            level: 0.99,
            here: 0.6,
            as_recorded: false,
            worst_at_m: Heightfield::point(25, 1),
            worst: -0.3,
            credit,
        };
        let lines = lines(&[danger]);
        assert!(lines[1].contains("+1.5 m ahead, +0.4 m to the left") && lines[1].contains("not the log's"));
        let marks: Vec<(usize, usize, char)> = lines[2..]
            .iter()
            .enumerate()
            .flat_map(|(column, line)| {
                let cells = line.trim_start().chars().enumerate();
                cells.filter(|(_, mark)| *mark != '·').map(move |(row, mark)| (row, column, mark))
            })
            .collect();
        assert_eq!(marks, [(25, 1, '█'), (3, 9, '+')]);
    }
}
