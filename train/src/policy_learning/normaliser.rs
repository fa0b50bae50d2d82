//! Mean and spread of every value of an observation, over what was seen so far.

/// Added to a standard deviation, so that a value that never changes is not blown up.
const SPREAD_FLOOR: f64 = 0.01;

/// Running moments, one set per value of an observation.
#[derive(Clone, Debug, PartialEq)]
pub struct Normaliser {
    /// Rows seen.
    pub count: f64,
    /// Mean of each value.
    pub mean: Vec<f64>,
    /// Sum of squared distances from the mean, of each value.
    pub squares: Vec<f64>,
}

/// `x ← (x − mean)·factor`, a [`Normaliser`] at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Scaling {
    /// What is taken away.
    pub mean: Vec<f32>,
    /// What it is multiplied by then.
    pub factor: Vec<f32>,
}

impl Normaliser {
    /// Nothing seen yet, of `width` values: scales nothing.
    pub fn new(width: usize) -> Self {
        Self { count: 0.0, mean: vec![0.0; width], squares: vec![0.0; width] }
    }

    /// Adds rows.
    ///
    /// ```text
    /// n ← n + 1     d = x − mean     mean ← mean + d/n     squares ← squares + d·(x − mean)
    /// ```
    ///
    /// # Source
    /// Welford (1962).
    pub fn add<'a>(&mut self, rows: impl Iterator<Item = &'a [f32]>) {
        for row in rows {
            self.count += 1.0;
            let share = 1.0 / self.count;
            for ((x, mean), squares) in row.iter().zip(&mut self.mean).zip(&mut self.squares) {
                let distance = f64::from(*x) - *mean;
                *mean += distance * share;
                *squares += distance * (f64::from(*x) - *mean);
            }
        }
    }

    /// Adds what another one saw.
    ///
    /// # Source
    /// Chan, Golub and `LeVeque` (1983), eq. 1.5.
    pub fn merge(&mut self, other: &Self) {
        let count = self.count + other.count;
        if other.count == 0.0 {
            return;
        }
        for at in 0..self.mean.len() {
            let distance = other.mean[at] - self.mean[at];
            self.mean[at] += distance * other.count / count;
            self.squares[at] += other.squares[at] + distance * distance * self.count * other.count / count;
        }
        self.count = count;
    }

    /// The present scaling: `factor = 1 / (standard deviation + 0.01)`; none before anything was seen.
    pub fn scaling(&self) -> Scaling {
        if self.count < 2.0 {
            return Scaling { mean: vec![0.0; self.mean.len()], factor: vec![1.0; self.mean.len()] };
        }
        let factor = |squares: &f64| (1.0 / ((squares / self.count).sqrt() + SPREAD_FLOOR)) as f32;
        Scaling {
            mean: self.mean.iter().map(|mean| *mean as f32).collect(),
            factor: self.squares.iter().map(factor).collect(),
        }
    }
}

impl Scaling {
    /// Scales one row.
    #[inline]
    pub fn apply(&self, row: &mut [f32]) {
        for ((x, mean), factor) in row.iter_mut().zip(&self.mean).zip(&self.factor) {
            *x = (*x - mean) * factor;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_sim::stream::{stream, uniform};

    fn rows(count: usize) -> Vec<[f32; 2]> {
        let mut rng = stream(1, "test/rows", &[]);
        (0..count).map(|_| [uniform(&mut rng, 3.0, 5.0), uniform(&mut rng, -40.0, 10.0)]).collect()
    }

    #[test]
    fn scaled_rows_have_mean_zero_and_spread_one() {
        let rows = rows(4000);
        let mut normaliser = Normaliser::new(2);
        normaliser.add(rows.iter().map(|row| &row[..]));
        let scaling = normaliser.scaling();
        for value in 0..2 {
            let scaled: Vec<f32> = rows
                .iter()
                .map(|row| {
                    let mut row = *row;
                    scaling.apply(&mut row);
                    row[value]
                })
                .collect();
            let mean = scaled.iter().sum::<f32>() / 4000.0;
            let variance = scaled.iter().map(|x| x * x).sum::<f32>() / 4000.0;
            assert!(mean.abs() < 1e-3 && (variance - 1.0).abs() < 0.05, "{mean} {variance}");
        }
    }

    #[test]
    fn parts_merged_are_the_whole() {
        let rows = rows(100);
        let seen = |rows: &[[f32; 2]]| {
            let mut normaliser = Normaliser::new(2);
            normaliser.add(rows.iter().map(|row| &row[..]));
            normaliser
        };
        let mut parts = seen(&rows[..30]);
        parts.merge(&seen(&rows[30..]));
        let whole = seen(&rows);
        for value in 0..2 {
            assert!((parts.mean[value] - whole.mean[value]).abs() < 1e-9);
            assert!((parts.squares[value] / whole.squares[value] - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn nothing_seen_scales_nothing() {
        let mut row = [3.0, -2.0];
        Normaliser::new(2).scaling().apply(&mut row);
        assert_eq!(row, [3.0, -2.0]);
    }
}
