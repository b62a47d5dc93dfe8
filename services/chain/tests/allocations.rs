//! The pure cycles allocate nothing: whole scenarios, tick by tick, with a counting allocator.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use chain::Chain;
use model::Robot;
use shared_types::scenario::Scenario;

/// The system's allocator, counting what each thread asks for.
struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: everything is the system allocator's; the counter is a plain cell of the thread.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: as required of our caller.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as required of our caller.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn no_cycle_allocates() {
    for name in sim::scenarios::names() {
        let scenario = Scenario::parse(name, sim::scenarios::text(name).unwrap(), &[]).unwrap();
        let mut chain = Chain::new(&Robot::builtin(&scenario.robot).unwrap(), &scenario).unwrap();
        assert!(ALLOCATIONS.get() > 0, "the counter counts");
        // The simulator of contacts makes room for itself in its first steps.
        (0..10).for_each(|_| {
            chain.step();
        });
        ALLOCATIONS.set(0);
        let mut ticks = 0;
        while !chain.is_over() && ticks < 2_000 {
            std::hint::black_box(chain.step());
            ticks += 1;
        }
        assert_eq!(ALLOCATIONS.get(), 0, "{name}: allocations in {ticks} ticks");
    }
}
