//! A network in the ONNX runtime keeps no memory of its runs.
//!
//! Cause: `Session::run` of ort 2.0.0-rc.14 never releases the description that it asks for of each output, some 40
//! bytes a run; a soak of 600,000 ticks showed it. Remedy: `core/src/predictor/run.rs` runs models by the runtime's
//! own interface.

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::atomic::{AtomicIsize, Ordering};

use vocaloco_core::heightfield::{COLUMNS, Heightfield, ROWS};
use vocaloco_core::predictor::{Predictor, Quantity};
use vocaloco_tests::constant_model;

/// The system's allocator with a count of the bytes that are held.
struct Held;

static HELD: AtomicIsize = AtomicIsize::new(0);

#[global_allocator]
static ALLOCATOR: Held = Held;

#[expect(
    unsafe_code,
    reason = "an allocator is unsafe by its trait; each call goes to the system's as it is"
)]
unsafe impl GlobalAlloc for Held {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        HELD.fetch_add(layout.size() as isize, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size() as isize, Ordering::Relaxed);
        unsafe { System.dealloc(place, layout) };
    }
}

#[test]
fn a_thousand_predictions_hold_no_more_memory_than_ten() {
    let model = constant_model("viability", 0.7);
    let mut predictor = Predictor::from_bytes(&model, Path::new("viability.onnx"), Quantity::Viability)
        .expect("a sound model");
    assert_ne!(predictor.runs_on(), "own forward", "the runtime computes it");
    let flat = Heightfield { cells_m: [[0.0; COLUMNS]; ROWS] }.prepare(None).expect("flat ground");
    let mut held_after = |runs: usize| {
        for _ in 0..runs {
            assert_eq!(predictor.predict(&flat).ok(), Some(0.7));
        }
        HELD.load(Ordering::Relaxed)
    };
    let before = held_after(10);
    let grown = held_after(1000) - before;
    assert!(grown.abs() < 1000, "{grown} bytes more after a thousand runs");
}
