//! The pure cycles allocate nothing: whole scenarios, tick by tick, with a counting allocator; by formula, by geometry and by number,
//! six joints and seven, through their locks.

#[path = "../../../tests/counting.rs"]
mod counting;

use chain::{Chain, Tick};
use model::Robot;
use shared_types::scenario::Scenario;

use counting::ALLOCATIONS;

fn counted(work: impl FnOnce()) -> u64 {
    let before = ALLOCATIONS.get();
    work();
    ALLOCATIONS.get() - before
}

fn parsed(name: &str, settings: &[&str]) -> (Robot, Scenario) {
    let settings: Vec<String> = settings
        .iter()
        .map(|setting| (*setting).to_owned())
        .collect();
    let scenario = Scenario::parse(name, sim::scenarios::text(name).unwrap(), &settings).unwrap();
    (Robot::builtin(&scenario.robot).unwrap(), scenario)
}

/// Every scenario; and by number some of them, on the exact integrator.
#[test]
fn no_cycle_allocates() {
    let by_number = ["analysis.numeric=true", "plant.model=\"reference\""];
    let numbered = ["straight-up", "elbow-in-and-out", "iiwa-posture"];
    let plain = sim::scenarios::names().map(|name| (name, &[][..]));
    for (name, settings) in plain.chain(numbered.map(|name| (name, &by_number[..]))) {
        let (robot, scenario) = parsed(name, settings);
        let (mut chain, mut tick) = (Chain::new(&robot, &scenario).unwrap(), Tick::default());
        // The simulator of contacts makes room for itself in its first steps.
        (0..10).for_each(|_| assert!(chain.step(&mut tick)));
        assert_eq!(counted(|| drop(std::hint::black_box(Box::new(7)))), 1);
        let (mut ticks, mut moved) = (0, 0.0_f64);
        let count = counted(|| {
            while ticks < 2_000 && chain.step(std::hint::black_box(&mut tick)) {
                moved = moved.max(tick.control_state.path_time_s);
                ticks += 1;
            }
        });
        assert_eq!(
            count, 0,
            "{name} {settings:?}: allocations in {ticks} ticks"
        );
        assert!(
            settings.is_empty() || moved > 0.5,
            "{name}: the path goes on"
        );
    }
}

#[test]
fn the_judge_allocates_where_something_happens_and_not_tick_by_tick() {
    for name in ["fig5-wrist-rotation", "straight-up", "iiwa-posture"] {
        let (robot, scenario) = parsed(name, &[]);
        let mut judge = recorder::Judge::new(&robot, &scenario).unwrap();
        let (mut chain, mut tick) = (Chain::new(&robot, &scenario).unwrap(), Tick::default());
        let (mut ticks, mut with_allocations) = (0, 0);
        while ticks < 2_000 && chain.step(&mut tick) {
            ticks += 1;
            let lent = tick.lent();
            let allocations = counted(|| {
                judge.take(std::hint::black_box(&lent));
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
