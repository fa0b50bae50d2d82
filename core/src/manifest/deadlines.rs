//! `[deadlines]` of a deployment: how long plugins and predictors may take in real time.

use serde::Deserialize;

use super::Finding;
use super::reader::Source;

/// Share of a tick's period that a plugin's call may take unless the deployment says otherwise.
const ACT_SHARE: f64 = 0.4;
/// Share that the predictions of all skills may take together.
const PREDICT_SHARE: f64 = 0.5;
/// Share that all calls may take together; in the rest the loop wakes, stands and answers.
const CALLS_SHARE: f64 = 0.9;

/// How long calls may take before the robot stands instead of waiting.
///
/// | field | meaning | default at period T and N skills |
/// |---|---|---|
/// | `act_s` | one call of the active plugin, its reset before the first included | 0.4·T |
/// | `predict_s` | both predictions of one skill | 0.5·T/N |
///
/// Together, `act_s + N·predict_s`, they take at most 0.9 of a tick: even when everything hangs at once, the
/// tick's targets are there before the next is due. With mixing two plugins act in a tick: then it is
/// `2·act_s`, and 0.2·T.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deadlines {
    /// Longest call of the active plugin, s.
    pub act_s: f64,
    /// Longest prediction of one skill, viability and cost of transport together, s.
    pub predict_s: f64,
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct RawDeadlines {
    act_s: Option<f64>,
    predict_s: Option<f64>,
}

impl Deadlines {
    /// Those of a deployment that says nothing.
    fn of(rate_hz: f64, skills: usize, acting: usize) -> Self {
        let share = |share: f64, among: usize| share / (rate_hz * among.max(1) as f64);
        Self { act_s: share(ACT_SHARE, acting), predict_s: share(PREDICT_SHARE, skills) }
    }

    pub(super) fn checked(
        source: &Source<'_>,
        raw: &RawDeadlines,
        rate_hz: f64,
        skills: usize,
        mixing: bool,
    ) -> Result<Self, Finding> {
        let acting = if mixing { 2 } else { 1 };
        let (default, period_s) = (Self::of(rate_hz, skills, acting), 1.0 / rate_hz);
        let act_s = source.inside("deadlines.act_s", raw.act_s.unwrap_or(default.act_s), 1e-5..=period_s)?;
        let predict_s = raw.predict_s.unwrap_or(default.predict_s);
        let predict_s = source.inside("deadlines.predict_s", predict_s, 1e-7..=period_s)?;
        let all_s = acting as f64 * act_s + skills as f64 * predict_s;
        let most_s = CALLS_SHARE * period_s;
        if all_s <= most_s * (1.0 + 1e-9) {
            return Ok(Self { act_s, predict_s });
        }
        let field = if raw.predict_s.is_some() { "deadlines.predict_s" } else { "deadlines.act_s" };
        let found = format!("{acting}·act_s + {skills}·predict_s = {all_s:.6} s");
        Err(source.finding(
            field,
            found,
            format!("at most {most_s:.6} s, {CALLS_SHARE} of a tick at {rate_hz} Hz"),
        ))
    }
}
