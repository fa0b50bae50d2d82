//! Fitting one predictor: epochs over shuffled batches, the best of them by the rows held out.
//!
//! Mean squared error, stochastic gradient descent, learning rate 0.005, momentum 0.9 are the
//! method's. Ours: the batch, the number of epochs, mirrored samples, a learning rate that falls,
//! and cost of transport fitted in standard deviations from its mean, which the last layer undoes.

use rand::RngExt;
use rand::seq::SliceRandom;
use serde::Serialize;
use vocaloco_sim::stream::stream;

use super::kernel::FieldCells;
use super::network::{TENSORS, start_values};
use super::samples::{Part, Sample, label_scale, part};
use super::sgd::{Example, Head, Rate, Sgd, answers};

/// How to fit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Options {
    /// Times that every sample is seen.
    pub epochs: usize,
    /// Samples per step.
    pub batch: usize,
    /// Step size at the start; 0.005 is the method's.
    pub learning_rate: f32,
    /// Share of the start's step size that is left in the last epoch; it falls evenly.
    pub final_rate_share: f32,
    /// Momentum; 0.9 is the method's.
    pub momentum: f32,
    /// Whether half of the samples, drawn anew each epoch, are seen with left and right exchanged.
    pub mirror: bool,
    /// Seed of start values, order and mirroring.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            epochs: 100,
            batch: 32,
            learning_rate: 0.005,
            final_rate_share: 0.02,
            momentum: 0.9,
            mirror: true,
            seed: 1,
        }
    }
}

/// The losses of one epoch: mean squared errors, in the label's unit squared.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Epoch {
    /// From 1 on.
    pub epoch: usize,
    /// Over the samples trained on, each as it was seen during the epoch.
    pub training: f64,
    /// Over the rows held out, after the epoch.
    pub validation: f64,
}

/// A fitted predictor.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// The network after the best epoch; its answers are in the label's unit.
    pub parameters: Vec<f32>,
    /// All epochs.
    pub history: Vec<Epoch>,
    /// The epoch whose network was kept.
    pub best: Epoch,
    /// Number of rows whose loss chose the epoch.
    pub held_out_rows: usize,
    /// Answers and labels of the rows that had no part in the fit.
    pub kept_back: Vec<(f32, f32)>,
}

/// Why nothing was fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    /// Too little data on one side of the split.
    #[error(
        "{trained_on} samples to train on, {held_out} held out, {kept_back} kept back; wanted one of each"
    )]
    TooFew {
        /// Samples to train on.
        trained_on: usize,
        /// Samples that choose the epoch.
        held_out: usize,
        /// Samples that have no part in the fit.
        kept_back: usize,
    },
    /// A label or a height that is no number.
    #[error("row {row}: {what} is {value}; wanted a finite number")]
    NotFinite {
        /// The row.
        row: u64,
        /// `label` or `heightfield`.
        what: &'static str,
        /// What was found.
        value: f32,
    },
    /// The descent ran away.
    #[error("the loss is {loss} after epoch {epoch}; a smaller learning rate would help")]
    Diverged {
        /// The epoch.
        epoch: usize,
        /// Its validation loss.
        loss: f64,
    },
}

/// Fits one predictor; `progress` hears of every epoch. Runs on the rayon pool it is called in.
///
/// # Errors
/// [`FitError`]: no data on one side of the split, data that is not finite, a loss that is not.
pub fn fit(
    samples: &[Sample],
    head: Head,
    options: &Options,
    progress: &mut dyn FnMut(&Epoch),
) -> Result<Fitted, FitError> {
    let [trained_on, held_out, kept_back] = [Part::TrainedOn, Part::HeldOut, Part::KeptBack]
        .map(|wanted| samples.iter().filter(|sample| part(sample.row) == wanted).collect::<Vec<_>>());
    check(samples, &trained_on, &held_out, &kept_back)?;
    let (mean, deviation) = match head {
        Head::Sigmoid => (0.0, 1.0),
        Head::Linear => label_scale(&trained_on),
    };
    let answers_to = |parameters: &[f32], samples: &[&Sample]| -> Vec<f32> {
        let fields: Vec<&FieldCells> = samples.iter().map(|sample| &sample.field).collect();
        answers(parameters, head, &fields).iter().map(|y| mean + deviation * y).collect()
    };

    let mut parameters = start_values(&mut stream(options.seed, "train/start", &[]));
    let mut sgd = Sgd::default();
    let mut history = Vec::with_capacity(options.epochs);
    let mut best: Option<(Epoch, Vec<f32>)> = None;
    for epoch in 1..=options.epochs {
        let squared_error =
            run_epoch(&mut sgd, &mut parameters, head, &trained_on, (mean, deviation), options, epoch);
        let validation = mean_squared_error(&answers_to(&parameters, &held_out), &held_out);
        if !validation.is_finite() {
            return Err(FitError::Diverged { epoch, loss: validation });
        }
        let training = squared_error * f64::from(deviation).powi(2) / trained_on.len() as f64;
        let losses = Epoch { epoch, training, validation };
        progress(&losses);
        history.push(losses);
        if best.as_ref().is_none_or(|(best, _)| validation < best.validation) {
            best = Some((losses, parameters.clone()));
        }
    }
    let (best, mut parameters) = best.unwrap_or_else(|| {
        let validation = mean_squared_error(&answers_to(&parameters, &held_out), &held_out);
        (Epoch { epoch: 0, training: f64::NAN, validation }, parameters)
    });
    let answered = answers_to(&parameters, &kept_back);
    unscale(&mut parameters, mean, deviation);
    let kept_back = answered.iter().zip(&kept_back).map(|(answer, sample)| (*answer, sample.label)).collect();
    Ok(Fitted { parameters, history, best, held_out_rows: held_out.len(), kept_back })
}

/// What a fitted network answers to samples, each with its label.
pub fn answered(parameters: &[f32], head: Head, samples: &[Sample]) -> Vec<(f32, f32)> {
    let fields: Vec<&FieldCells> = samples.iter().map(|sample| &sample.field).collect();
    answers(parameters, head, &fields).into_iter().zip(samples.iter().map(|sample| sample.label)).collect()
}

fn check(
    samples: &[Sample],
    trained_on: &[&Sample],
    held_out: &[&Sample],
    kept_back: &[&Sample],
) -> Result<(), FitError> {
    let [trained_on, held_out, kept_back] = [trained_on, held_out, kept_back].map(<[_]>::len);
    if trained_on == 0 || held_out == 0 || kept_back == 0 {
        return Err(FitError::TooFew { trained_on, held_out, kept_back });
    }
    for sample in samples {
        let height = sample.field.iter().find(|height| !height.is_finite());
        let found = height.map(|height| ("heightfield", *height));
        let found = found.or((!sample.label.is_finite()).then_some(("label", sample.label)));
        if let Some((what, value)) = found {
            return Err(FitError::NotFinite { row: sample.row, what, value });
        }
    }
    Ok(())
}

/// One pass over the samples in a fresh order; the sum of squared errors, in scaled labels.
fn run_epoch(
    sgd: &mut Sgd,
    parameters: &mut [f32],
    head: Head,
    samples: &[&Sample],
    (mean, deviation): (f32, f32),
    options: &Options,
    epoch: usize,
) -> f64 {
    let mut rng = stream(options.seed, "train/epoch", &[epoch as u64]);
    let mut order: Vec<usize> = (0..samples.len()).collect();
    order.shuffle(&mut rng);
    let gone = (epoch - 1) as f32 / (options.epochs - 1).max(1) as f32;
    let rate = Rate {
        learning_rate: options.learning_rate * (1.0 - gone * (1.0 - options.final_rate_share)),
        momentum: options.momentum,
    };
    let mut batch = Vec::with_capacity(options.batch);
    let mut squared_error = 0.0;
    for rows in order.chunks(options.batch) {
        batch.clear();
        batch.extend(rows.iter().map(|row| Example {
            field: &samples[*row].field,
            label: (samples[*row].label - mean) / deviation,
            mirrored: options.mirror && rng.random(),
        }));
        squared_error += sgd.step(parameters, head, &batch, rate);
    }
    squared_error
}

fn mean_squared_error(answers: &[f32], samples: &[&Sample]) -> f64 {
    let errors = answers.iter().zip(samples).map(|(answer, sample)| f64::from(answer - sample.label));
    errors.map(|error| error * error).sum::<f64>() / samples.len() as f64
}

/// Makes the last layer answer in the label's unit: `y ← mean + deviation · y`.
fn unscale(parameters: &mut [f32], mean: f32, deviation: f32) {
    let [.., weight, bias] = TENSORS;
    for value in weight.of_mut(parameters) {
        *value *= deviation;
    }
    for value in bias.of_mut(parameters) {
        *value = mean + deviation * *value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_sim::stream::uniform;

    /// Fields with one step somewhere ahead, labelled by a known function of its height.
    fn steps(n: u64, label: impl Fn(f32) -> f32) -> Vec<Sample> {
        (0..n)
            .map(|row| {
                let mut rng = stream(3, "test/steps", &[row]);
                let height = uniform(&mut rng, -0.4, 0.4);
                let edge = 16 + rng.random_range(0..10);
                let field = std::array::from_fn(
                    |at| if at / 11 >= edge { height } else { 0.0 } + 0.01 * (at % 11) as f32,
                );
                Sample { row, field, label: label(height) }
            })
            .collect()
    }

    const QUICK: Options = Options {
        epochs: 12,
        batch: 16,
        learning_rate: 0.005,
        final_rate_share: 0.1,
        momentum: 0.9,
        mirror: false,
        seed: 5,
    };

    #[test]
    fn a_constant_label_is_learned() {
        let options = Options { epochs: 12, learning_rate: 0.02, ..QUICK };
        for (head, label) in [(Head::Linear, 0.37), (Head::Sigmoid, 0.75)] {
            let fitted = fit(&steps(300, |_| label), head, &options, &mut |_| ()).unwrap();
            for (answer, _) in &fitted.kept_back {
                assert!((answer - label).abs() < 0.05, "{head:?}: {answer} instead of {label}");
            }
        }
    }

    #[test]
    fn a_cost_that_grows_with_the_step_is_learned_in_its_own_unit() {
        let options = Options { epochs: 60, ..QUICK };
        let fitted = fit(&steps(1200, |h| 0.3 + 0.5 * h.abs()), Head::Linear, &options, &mut |_| ()).unwrap();
        let mean =
            fitted.kept_back.iter().map(|(_, label)| label).sum::<f32>() / fitted.kept_back.len() as f32;
        let spread: f32 = fitted.kept_back.iter().map(|(_, label)| (label - mean).powi(2)).sum();
        let error: f32 = fitted.kept_back.iter().map(|(answer, label)| (answer - label).powi(2)).sum();
        assert!(error < 0.2 * spread, "{error} of {spread} left");
        // The exported network answers as the fit did: the label's scale is folded in.
        let first = steps(1200, |_| 0.0).into_iter().find(|s| part(s.row) == Part::KeptBack).unwrap();
        let answer = answers(&fitted.parameters, Head::Linear, &[&first.field])[0];
        assert!((answer - fitted.kept_back[0].0).abs() < 1e-5);
    }

    #[test]
    fn the_same_seed_gives_the_same_bytes_on_one_and_two_threads() {
        let samples = steps(200, |h| f32::from(u8::from(h < 0.2)));
        let options = Options { epochs: 2, batch: 24, mirror: true, ..QUICK };
        let fitted = |threads: usize, seed: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let options = Options { seed, ..options };
            pool.install(|| fit(&samples, Head::Sigmoid, &options, &mut |_| ()).unwrap())
        };
        assert_eq!(fitted(1, 5), fitted(2, 5));
        assert_ne!(fitted(1, 5).parameters, fitted(1, 6).parameters);
    }

    #[test]
    fn the_best_epoch_is_kept() {
        let samples = steps(200, |h| f32::from(u8::from(h < 0.2)));
        let fitted = fit(&samples, Head::Sigmoid, &Options { epochs: 6, ..QUICK }, &mut |_| ()).unwrap();
        let lowest = fitted.history.iter().map(|e| e.validation).fold(f64::INFINITY, f64::min);
        assert!((fitted.best.validation - lowest).abs() < 1e-12);
        let held_out: Vec<&Sample> = samples.iter().filter(|s| part(s.row) == Part::HeldOut).collect();
        let fields: Vec<&FieldCells> = held_out.iter().map(|sample| &sample.field).collect();
        let kept = mean_squared_error(&answers(&fitted.parameters, Head::Sigmoid, &fields), &held_out);
        assert!((kept - lowest).abs() < 1e-9);
    }

    #[test]
    fn a_height_that_is_no_number_is_refused_by_row() {
        let mut samples = steps(100, |_| 0.5);
        samples[17].field[40] = f32::NAN;
        let error = fit(&samples, Head::Sigmoid, &QUICK, &mut |_| ()).unwrap_err();
        assert!(matches!(error, FitError::NotFinite { row: 17, what: "heightfield", .. }), "{error}");
        let nothing = fit(&samples[..1], Head::Sigmoid, &QUICK, &mut |_| ()).unwrap_err();
        assert!(matches!(nothing, FitError::TooFew { .. }), "{nothing}");
    }
}
