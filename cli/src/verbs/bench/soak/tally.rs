//! Faults by kind, counted by whoever brings them or sees them.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Counts that the parts of a soak share.
#[derive(Clone, Debug, Default)]
pub(super) struct Tally(Arc<Mutex<BTreeMap<String, u64>>>);

/// What a decision's event says of a plugin, and what it is counted as.
const EVENTS: [(&str, &str); 10] = [
    ("(segmentation fault)", "plugin: segmentation fault in its process"),
    ("(abort", "plugin: abort or more memory than allowed in its process"),
    ("no answer for", "plugin: hangs in its process"),
    (OTHERWISE, "plugin: its process ended otherwise"),
    ("panicked", "plugin: panic, or more targets than joints"),
    ("asked for an error", "plugin: error"),
    ("position_rad NaN", "plugin: targets that are no numbers, or missing"),
    ("position_rad", "plugin: position out of range"),
    ("stiffness_nm_per_rad", "plugin: stiffness out of range"),
    ("damping_nms_per_rad", "plugin: damping out of range"),
];

/// What must have come to plugins in a long run.
pub(super) fn kinds() -> Vec<&'static str> {
    EVENTS.iter().filter(|(part, _)| *part != OTHERWISE).map(|(_, kind)| *kind).collect()
}

/// Nothing that is brought about.
const OTHERWISE: &str = "ended";

impl Tally {
    /// One more of a kind.
    pub(super) fn count(&self, kind: &str) {
        let mut counts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match counts.get_mut(kind) {
            Some(count) => *count += 1,
            None => drop(counts.insert(kind.to_owned(), 1)),
        }
    }

    /// Counts what an event says of a plugin that is taken out of service, and nothing else.
    pub(super) fn count_event(&self, event: &str) {
        if event.contains("is taken out of service") {
            let known = EVENTS.iter().find(|(part, _)| event.contains(part));
            self.count(known.map_or("plugin: other", |(_, kind)| kind));
        }
    }

    /// How many of each kind.
    pub(super) fn counts(&self) -> BTreeMap<String, u64> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plugins_out_of_service_are_counted_by_what_they_did_and_other_events_are_not() {
        let tally = Tally::default();
        for event in [
            "skill wild is taken out of service: act: LH_HFE: position_rad 1000000000, -3 to 3 wanted",
            "skill wild is taken out of service: act: LH_HFE: position_rad NaN, -3 to 3 wanted",
            "skill fragile is taken out of service: act: found its process ended by signal 11 (segmentation fault)",
            "skill wild is gone: it has no manifest any more",
        ] {
            tally.count_event(event);
        }
        let counts = tally.counts();
        let kinds: Vec<_> = counts.keys().map(|kind| kind.split(": ").nth(1).unwrap()).collect();
        let [position, segfault, nan] = [
            "position out of range",
            "segmentation fault in its process",
            "targets that are no numbers, or missing",
        ];
        assert_eq!(kinds, [position, segfault, nan]);
        assert!(counts.values().all(|&count| count == 1), "{counts:?}");
    }
}
