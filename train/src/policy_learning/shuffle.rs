//! Rows in a random order.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// `0..rows` in an order drawn from `rng`.
///
/// # Source
/// Fisher and Yates (1938), as Durstenfeld (1964).
pub(super) fn shuffled(rows: usize, rng: &mut ChaCha8Rng) -> Vec<u32> {
    let mut order: Vec<u32> = (0..rows as u32).collect();
    for last in (1..rows).rev() {
        order.swap(last, rng.random_range(0..=last));
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_sim::stream::stream;

    #[test]
    fn every_row_comes_once_and_not_in_order() {
        let order = shuffled(1000, &mut stream(1, "test/shuffle", &[]));
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().enumerate().all(|(at, row)| at == *row as usize));
        let moved = order.iter().enumerate().filter(|(at, row)| *at != **row as usize).count();
        assert!(moved > 950, "{moved}");
    }
}
