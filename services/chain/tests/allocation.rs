//! The control path allocates nothing: estimator, analyzer and controller, by formula, by geometry and by number, six joints and seven, through their locks.

use chain::Chain;
use model::Robot;
use shared_types::scenario::Scenario;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

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
        // SAFETY: the caller's promises are the system's.
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

#[test]
fn the_counter_counts() {
    assert_eq!(counted(|| drop(std::hint::black_box(Box::new(7)))), 1);
}

#[test]
fn nothing_is_allocated_from_sample_to_torque() {
    let numeric = &["analysis.numeric=true"][..];
    for (name, settings) in [
        ("fig5-wrist-rotation", &[][..]),
        ("straight-up", &[]),
        ("straight-up", numeric),
        ("elbow-in-and-out", numeric),
        ("ur5-wrist", &[]),
        ("iiwa-posture", &[]),
        ("iiwa-posture", numeric),
    ] {
        let settings: Vec<String> = settings.iter().map(|s| (*s).to_owned()).chain(["plant.model=\"reference\"".to_owned()]).collect();
        let scenario = Scenario::parse(name, sim::scenarios::text(name).unwrap(), &settings).unwrap();
        let robot = Robot::builtin(&scenario.robot).unwrap();
        // The samples of a run, then the same chain again on them, counted.
        let mut chain = Chain::new(&robot, &scenario).unwrap();
        let samples: Vec<_> = (0..1500).map(|_| chain.step().sensor).collect();
        let mut estimator = estimator::cycle(&robot, &scenario).unwrap();
        let mut analyzer = analyzer::cycle(&robot, &scenario).unwrap();
        let mut controller = controller::cycle(&robot, &scenario).unwrap();
        let mut moved = 0.0_f64;
        let count = counted(|| {
            for sample in &samples {
                let estimate = estimator.step(sample);
                let report = analyzer.step(&estimate);
                let command = controller.step(&estimate, &report);
                moved = moved.max(command.path_time_s);
            }
        });
        assert!(moved > 0.5, "{name}: the path goes on");
        assert_eq!(count, 0, "{name} {settings:?}: allocations in {} ticks", samples.len());
    }
}
