//! Claims about data and predictions.

use vocaloco_sim::{
    collected::{Collected, cost_error, viability_scores},
    terrain::TerrainKind,
};

use super::{Claim, Evidence, Verdict, centimetres, percent};

/// A predictor whose expected calibration error is at most this can set thresholds in steps of 5 %.
const CALIBRATED: f64 = 0.05;
/// Skills are compared by cost where they are at least this viable (docs/method.md).
const VIABLE: f64 = 0.9;
/// Very low steps, m.
const LOW_M: f32 = 0.1001;

impl Evidence<'_> {
    pub(super) fn viability_falls_and_cost_rises(&self) -> Claim {
        let down = &self.roles.down;
        let cells = self.findings.cells_of(down, TerrainKind::StairsDown);
        let viable: Vec<&&Collected> = cells.iter().filter(|cell| cell.viable().mean >= VIABLE).collect();
        let cost = |cell: &&&Collected| cell.cost().map_or(f64::NAN, |cost| cost.mean);
        let (ours, agrees) = match (cells.first(), cells.last(), viable.first(), viable.last()) {
            (Some(lowest), Some(highest), Some(cheap), Some(dear)) => {
                let (from, to) = (lowest.viable().mean, highest.viable().mean);
                let words = format!(
                    "{down}: viability {} at {}, {} at {}; CoT {:.2} at {}, {:.2} at {}, the last height with {} viable",
                    percent(from),
                    centimetres(lowest.size_m),
                    percent(to),
                    centimetres(highest.size_m),
                    cost(cheap),
                    centimetres(cheap.size_m),
                    cost(dear),
                    centimetres(dear.size_m),
                    percent(VIABLE),
                );
                (words, to < from && cost(dear) > cost(cheap))
            }
            _ => (format!("{down} is nowhere {} viable down stairs", percent(VIABLE)), false),
        };
        Claim {
            id: "difficulty",
            words: "Going down, viability falls and cost of transport rises with step height; cost ends at 27.5 cm, beyond which the policy is not viable.".to_owned(),
            by: "paper",
            ours,
            verdict: Verdict::of(agrees),
            why: "Agrees when viability at the highest step is below that at the lowest and cost rises over the heights that are 90 % viable. Where a policy stops being viable is its own affair: ours are other policies.".to_owned(),
            n: self.cell_count(cells.len()),
            seed: self.plan.seed,
            command: self.cells_command(&[down], "stairs_down"),
            figure: Some("difficulty"),
        }
    }

    pub(super) fn predictions_follow(&self) -> Claim {
        let mut words = Vec::new();
        let mut worst = 0.0_f64;
        for skill in self.skills {
            if let Some([ece, brier]) = viability_scores(self.on_stairs(skill)) {
                worst = worst.max(ece);
                words.push(format!("{skill}: calibration error {ece:.3}, Brier {brier:.3}"));
            }
        }
        Claim {
            id: "viability",
            words:
                "Predicted viability follows what was collected, calibrated well enough to set thresholds."
                    .to_owned(),
            by: "paper",
            ours: words.join("; "),
            verdict: Verdict::of(worst <= CALIBRATED && !words.is_empty()),
            why: format!(
                "Agrees when the expected calibration error over all heights of both stairs (15 bins) is at most {CALIBRATED} for every skill."
            ),
            n: self.cell_count(self.findings.cells.len()),
            seed: self.plan.seed,
            command: self.cells_command(self.skills, "stairs_up,stairs_down"),
            figure: Some("viability"),
        }
    }

    pub(super) fn cost_follows(&self) -> Claim {
        let mut words = Vec::new();
        let (mut rising, mut close) = (true, true);
        for (skill, terrain) in
            [(&self.roles.up, TerrainKind::StairsUp), (&self.roles.down, TerrainKind::StairsDown)]
        {
            let viable = self.viable_cells(skill, terrain);
            let costs: Vec<f64> = viable.iter().filter_map(|cell| Some(cell.cost()?.mean)).collect();
            let error = cost_error(viable.iter().copied());
            if let (Some(first), Some(last), Some(error)) = (costs.first(), costs.last(), error) {
                rising &= last > first;
                close &= error <= 0.1 * (first + last);
                words.push(format!("{skill} on {terrain}: {first:.2} to {last:.2}, mean error {error:.3}"));
            }
        }
        Claim {
            id: "cost",
            words: "Cost of transport rises with step height, and its prediction follows (points where a skill is at least 90 % viable).".to_owned(),
            by: "paper",
            ours: words.join("; "),
            verdict: Verdict::of(rising && close && words.len() == 2),
            why: "Agrees when, for the best skill up and the best down, cost at the highest viable step is above that at the lowest and the mean absolute error of single rollouts is within 20 % of their mean.".to_owned(),
            n: self.cell_count(self.findings.cells.len()),
            seed: self.plan.seed,
            command: self.cells_command(self.skills, "stairs_up,stairs_down"),
            figure: Some("cost"),
        }
    }

    pub(super) fn level_skill_is_cheapest_on_low_steps(&self) -> Claim {
        let level = &self.roles.level;
        let (mut won, mut compared, mut words) = (0, 0, Vec::new());
        for terrain in [TerrainKind::StairsUp, TerrainKind::StairsDown] {
            for size_m in self.plan.sizes_m.iter().filter(|size| **size <= LOW_M) {
                let cost = |skill: &&str| {
                    let cell = self.findings.cell(skill, terrain, *size_m)?;
                    (cell.viable().mean >= VIABLE).then(|| cell.cost().map(|cost| cost.mean)).flatten()
                };
                let costs: Vec<(&str, f64)> =
                    self.skills.iter().filter_map(|skill| Some((*skill, cost(skill)?))).collect();
                if let Some((winner, cost)) = costs.iter().min_by(|a, b| a.1.total_cmp(&b.1)) {
                    compared += 1;
                    won += usize::from(winner == level);
                    words.push(format!("{terrain} {}: {winner} {cost:.2}", centimetres(*size_m)));
                }
            }
        }
        Claim {
            id: "low_steps",
            words: "The skill for level ground is the cheapest on very low steps.".to_owned(),
            by: "paper",
            ours: format!("{level}, cheapest on flat ground, is cheapest at {won} of {compared} ({})", words.join(", ")),
            verdict: Verdict::of(compared > 0 && won == compared),
            why: "Agrees when the skill that is cheapest on flat ground is also the cheapest of those that are 90 % viable at every height up to 10 cm, up and down.".to_owned(),
            n: self.cell_count(compared * self.skills.len()),
            seed: self.plan.seed,
            command: self.cells_command(self.skills, "stairs_up,stairs_down"),
            figure: Some("cost"),
        }
    }

    pub(super) fn up_skill_fails_down_stairs(&self) -> Claim {
        let up = &self.roles.up;
        let cells = self.findings.cells_of(up, TerrainKind::StairsDown);
        let failing = cells.iter().filter(|cell| cell.viable().mean < VIABLE).count();
        let best = cells.iter().map(|cell| cell.viable().mean).fold(0.0, f64::max);
        Claim {
            id: "up_goes_down",
            words: "The skill for going up fails in more than 10 % of samples on descending stairs, at every height.".to_owned(),
            by: "paper",
            ours: format!(
                "{up} fails in more than 10 % at {failing} of {} heights; at its best it is {} viable",
                cells.len(),
                percent(best)
            ),
            verdict: Verdict::of(!cells.is_empty() && failing == cells.len()),
            why: "A skill that goes down as well as up contradicts no method; it gives the selector one more viable choice.".to_owned(),
            n: self.cell_count(cells.len()),
            seed: self.plan.seed,
            command: self.cells_command(&[up], "stairs_down"),
            figure: Some("viability"),
        }
    }

    fn on_stairs<'a>(&'a self, skill: &'a str) -> impl Iterator<Item = &'a Collected> {
        let cells = self.findings.cells.iter();
        cells.filter(move |cell| cell.skill == skill && cell.terrain != TerrainKind::Flat)
    }

    fn viable_cells(&self, skill: &str, terrain: TerrainKind) -> Vec<&Collected> {
        let cells = self.findings.cells_of(skill, terrain);
        cells.into_iter().filter(|cell| cell.viable().mean >= VIABLE).collect()
    }

    fn cell_count(&self, cells: usize) -> String {
        format!("{} fresh poses × {cells}", self.plan.samples)
    }
}
