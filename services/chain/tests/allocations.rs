//! The pure cycles allocate nothing: whole scenarios, tick by tick, with a counting allocator; by formula, by geometry and by number,
//! six joints and seven, through their locks.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use chain::{Chain, Tick};
use model::Robot;
use shared_types::scenario::Scenario;

thread_local! {
    /// Allocations of this thread.
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator, counting.
struct Counting;

// SAFETY: every call is handed on to the system's allocator unchanged; the count lives in a constant-initialised thread local without a destructor,
// which allocates nothing itself.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's guarantees are the system's.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn counted(work: impl FnOnce()) -> u64 {
    let before = COUNT.with(Cell::get);
    work();
    COUNT.with(Cell::get) - before
}

fn parsed(name: &str, settings: &[&str]) -> (Robot, Scenario) {
    let settings: Vec<String> = settings
        .iter()
        .map(|setting| (*setting).to_owned())
        .collect();
    let scenario = Scenario::parse(name, sim::scenarios::text(name).unwrap(), &settings).unwrap();
    (Robot::builtin(&scenario.robot).unwrap(), scenario)
}

#[test]
fn no_cycle_allocates() {
    for name in sim::scenarios::names() {
        let (robot, scenario) = parsed(name, &[]);
        let (mut chain, mut tick) = (Chain::new(&robot, &scenario).unwrap(), Tick::default());
        // The simulator of contacts makes room for itself in its first steps.
        (0..10).for_each(|_| chain.step(&mut tick));
        assert_eq!(counted(|| drop(std::hint::black_box(Box::new(7)))), 1);
        let mut ticks = 0;
        let count = counted(|| {
            while !chain.is_over() && ticks < 2_000 {
                chain.step(std::hint::black_box(&mut tick));
                ticks += 1;
            }
        });
        assert_eq!(count, 0, "{name}: allocations in {ticks} ticks");
    }
}

#[test]
fn the_judge_allocates_where_something_happens_and_not_tick_by_tick() {
    for name in ["fig5-wrist-rotation", "straight-up", "iiwa-posture"] {
        let (robot, scenario) = parsed(name, &[]);
        let mut judge = recorder::Judge::new(&robot, &scenario).unwrap();
        let (mut chain, mut tick) = (Chain::new(&robot, &scenario).unwrap(), Tick::default());
        let (mut ticks, mut with_allocations) = (0, 0);
        while !chain.is_over() && ticks < 2_000 {
            chain.step(&mut tick);
            ticks += 1;
            let lent = tick.lent();
            let whole = recorder::Tick::of(&lent).expect("a chain answers every tick");
            let allocations = counted(|| {
                judge.tick(std::hint::black_box(whole));
            });
            with_allocations += u64::from(allocations > 0);
        }
        // The first tick makes its tables; a turn, a limit reached and a new range of a histogram make room for themselves.
        assert!(
            ticks > 500 && with_allocations * 50 < ticks,
            "{name}: {with_allocations} of {ticks} ticks allocate"
        );
    }
}

#[test]
fn nothing_is_allocated_where_singularities_are_found_by_number() {
    for name in ["straight-up", "elbow-in-and-out", "iiwa-posture"] {
        let (robot, scenario) = parsed(
            name,
            &["analysis.numeric=true", "plant.model=\"reference\""],
        );
        let (mut chain, mut tick) = (Chain::new(&robot, &scenario).unwrap(), Tick::default());
        let mut moved = 0.0_f64;
        let count = counted(|| {
            for _ in 0..1_500 {
                chain.step(&mut tick);
                moved = moved.max(tick.control_state.path_time_s);
            }
        });
        assert!(moved > 0.5, "{name}: the path goes on");
        assert_eq!(count, 0, "{name}: allocations");
    }
}
