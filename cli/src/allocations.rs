//! The system's allocator with a count of each thread's allocations, which `bench tick` asks for.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// The program's allocator. A plugin's library has one of its own and is not counted.
pub(crate) struct Counting;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

/// Allocations and reallocations of this thread so far.
pub(crate) fn count() -> u64 {
    COUNT.get()
}

fn add_one() {
    // A thread that ends may allocate after its variables are gone.
    let _ended = COUNT.try_with(|count| count.set(count.get() + 1));
}

#[expect(
    unsafe_code,
    reason = "an allocator is unsafe by its trait; each call goes to the system's as it is"
)]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        add_one();
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        add_one();
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        add_one();
        unsafe { System.realloc(place, layout, size) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        unsafe { System.dealloc(place, layout) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_allocation_counts_and_arithmetic_does_not() {
        let before = count();
        let sum = (0..10).map(std::hint::black_box).sum::<u64>();
        assert_eq!((count(), sum), (before, 45));
        let text = std::hint::black_box(sum.to_string());
        assert!(count() > before, "{text}");
    }
}
