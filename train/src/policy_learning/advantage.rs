//! How much better an action was than expected.

use super::task::End;

/// What the estimate needs of one environment's steps, all in their order.
#[derive(Clone, Copy, Debug)]
pub struct Trace<'a> {
    /// Reward of each step.
    pub rewards: &'a [f32],
    /// Whether the episode ended with it.
    pub ends: &'a [Option<End>],
    /// The critic's value of the state before each step, and of the one after the last: one more.
    pub values: &'a [f32],
    /// Its value of the last state of each episode that timed out, in their order.
    pub timed_out_values: &'a [f32],
}

/// Generalised advantage estimates, one per step.
///
/// ```text
/// δ_t = r_t + γ·V'_t − V_t         A_t = δ_t + γλ·A_{t+1}, without the second term at an episode's end
/// V'_t = V_{t+1} within an episode, V(last state) at a time-out, 0 at a terminal state or a finish
/// ```
///
/// | argument | meaning |
/// |----------|---------|
/// | `discount` | γ, 0 to 1 |
/// | `trace_decay` | λ, 0 to 1: 0 trusts the critic, 1 the rewards |
///
/// # Panics
/// Fewer values than steps and time-outs, which is our bug.
///
/// # Source
/// Schulman et al., *High-dimensional continuous control using generalised advantage estimation*, ICLR 2016,
/// eq. 16; Pardo et al., *Time limits in reinforcement learning*, ICML 2018, for the time-outs.
pub fn advantages(trace: Trace<'_>, discount: f32, trace_decay: f32) -> Vec<f32> {
    let mut advantages = vec![0.0; trace.rewards.len()];
    let mut timed_out = trace.timed_out_values.iter().rev();
    let mut behind = 0.0;
    for t in (0..trace.rewards.len()).rev() {
        let next = match trace.ends[t] {
            None => trace.values[t + 1],
            Some(End::Terminated | End::Finished) => 0.0,
            Some(End::TimedOut) => *timed_out.next().expect("a value for each time-out"),
        };
        if trace.ends[t].is_some() {
            behind = 0.0;
        }
        behind = trace.rewards[t] + discount * next - trace.values[t] + discount * trace_decay * behind;
        advantages[t] = behind;
    }
    advantages
}

#[cfg(test)]
mod tests {
    use super::*;

    const DISCOUNT: f32 = 0.9;
    const DECAY: f32 = 0.8;
    const VALUES: [f32; 4] = [2.0, 3.0, 5.0, 7.0];

    fn of(ends: [Option<End>; 3], timed_out_values: &[f32]) -> Vec<f32> {
        let trace = Trace { rewards: &[1.0, 10.0, 100.0], ends: &ends, values: &VALUES, timed_out_values };
        advantages(trace, DISCOUNT, DECAY)
    }

    #[test]
    fn gae_sums_discounted_surprises() {
        let found = of([None; 3], &[]);
        let delta = [1.0 + 0.9 * 3.0 - 2.0, 10.0 + 0.9 * 5.0 - 3.0, 100.0 + 0.9 * 7.0 - 5.0];
        assert!((found[2] - delta[2]).abs() < 1e-4);
        assert!((found[1] - (delta[1] + 0.72 * delta[2])).abs() < 1e-4);
        assert!((found[0] - (delta[0] + 0.72 * (delta[1] + 0.72 * delta[2]))).abs() < 1e-4);
    }

    #[test]
    fn gae_stops_at_a_terminal_state() {
        for end in [End::Terminated, End::Finished] {
            let found = of([None, Some(end), None], &[]);
            // Neither the next value nor what the next episode brings.
            assert!((found[1] - (10.0 - 3.0)).abs() < 1e-4, "{end:?}: {found:?}");
            assert!((found[0] - (1.0 + 0.9 * 3.0 - 2.0 + 0.72 * 7.0)).abs() < 1e-4, "{end:?}: {found:?}");
        }
    }

    #[test]
    fn gae_bootstraps_at_a_time_out() {
        let found = of([None, Some(End::TimedOut), None], &[4.0]);
        // The value of the state it was cut off in, not of the next episode's first, and no trace across.
        assert!((found[1] - (10.0 + 0.9 * 4.0 - 3.0)).abs() < 1e-4, "{found:?}");
    }

    #[test]
    fn each_time_out_has_its_own_value() {
        let found = of([Some(End::TimedOut), Some(End::Terminated), Some(End::TimedOut)], &[4.0, 6.0]);
        assert!((found[0] - (1.0 + 0.9 * 4.0 - 2.0)).abs() < 1e-4, "{found:?}");
        assert!((found[2] - (100.0 + 0.9 * 6.0 - 5.0)).abs() < 1e-4, "{found:?}");
    }
}
