//! A hop allocates nothing of ours in the steady state: iceoryx2 0.10 allocates one small record for each loan, and that is all there is.

use super::*;

#[path = "../../../../tests/counting.rs"]
mod counting;

use counting::{ALLOCATIONS, LARGEST};

/// Bytes of iceoryx2's record of a loan.
const RECORD: usize = 128;
const MESSAGES: u64 = 1_000;

#[test]
fn one_record_of_iceoryx2_for_each_message_and_nothing_else() {
    for mode in [Mode::Lockstep, Mode::Realtime] {
        let stage = stage_of(mode, &["plant", "estimator"], |manifest| {
            manifest.processes[0].reads.push("estimate".into());
            manifest.wait_limit = Some(Duration::from_secs(10));
        });
        let (plant, estimator) = (stage.shell("plant"), stage.shell("estimator"));
        let mut there = plant.writer::<SensorSample>().unwrap();
        let mut arrives = estimator.reader().unwrap();
        let (mut back, mut returns) = (
            estimator.writer::<StateEstimate>().unwrap(),
            plant.reader::<StateEstimate>().unwrap(),
        );
        let mut trip = |tick: u64| {
            send(&mut there, [tick]);
            assert_eq!(next(&mut arrives), Ok(Some(tick)));
            send(&mut back, [tick]);
            assert_eq!(returns.next().unwrap().unwrap().header.tick, tick);
        };
        // Connections are made in the first trips.
        (0..10).for_each(&mut trip);
        let before = ALLOCATIONS.replace(0);
        LARGEST.set(0);
        (10..10 + MESSAGES).for_each(&mut trip);
        let (allocations, largest) = (ALLOCATIONS.get(), LARGEST.get());
        assert!(before > 0, "the counter counts");
        assert_eq!(
            allocations,
            2 * MESSAGES,
            "{mode:?}: one for each of two messages a trip"
        );
        assert!(largest <= RECORD, "{mode:?}: {largest} bytes at once");
    }
}
