//! A hop allocates nothing of ours in the steady state: iceoryx2 0.10 allocates one small record for each loan, and that is all there is.

#[path = "../../../tests/counting.rs"]
mod counting;

use std::time::Duration;

use runtime::{ControlPage, Hub, Manifest, Mode, Phase, Process, RunDir, Shell};
use shared_types::{Message, PlantState, TorqueCommand};

use counting::{ALLOCATIONS, LARGEST};

/// Bytes of iceoryx2's record of a loan.
const RECORD: usize = 128;
const MESSAGES: u64 = 1_000;

#[test]
fn one_record_of_iceoryx2_for_each_message_and_nothing_else() {
    let process = |name: &str, reads: &str, writes: &str| Process {
        name: name.into(),
        reads: vec![reads.into()],
        writes: vec![writes.into()],
        ..Process::default()
    };
    let processes = vec![
        process("ping", PlantState::TOPIC, TorqueCommand::TOPIC),
        process("pong", TorqueCommand::TOPIC, PlantState::TOPIC),
    ];
    for mode in [Mode::Lockstep, Mode::Realtime] {
        let run = RunDir::create().unwrap();
        let manifest = Manifest {
            mode,
            rate_hz: 1000,
            wait_limit: Some(Duration::from_secs(10)),
            processes: processes.clone(),
            messages: Vec::new(),
            from: 0,
        };
        manifest.write(&run).unwrap();
        let control_page = ControlPage::create(&run).unwrap();
        let _hub = Hub::create(&run, &manifest).unwrap();
        (0..2).for_each(|index| {
            control_page.process(index).begin_incarnation();
        });
        control_page.begin(Phase::Work);
        let (ping, pong) = (
            Shell::open(run.path(), "ping").unwrap(),
            Shell::open(run.path(), "pong").unwrap(),
        );
        let (mut there, mut arrives) = (
            ping.writer::<TorqueCommand>().unwrap(),
            pong.reader::<TorqueCommand>().unwrap(),
        );
        let (mut back, mut returns) = (
            pong.writer::<PlantState>().unwrap(),
            ping.reader::<PlantState>().unwrap(),
        );
        let mut trip = |tick: u64| {
            let mut command = TorqueCommand::default();
            command.header.tick = tick;
            there.send(command).unwrap();
            let mut state = PlantState::default();
            state.header.tick = arrives.next().unwrap().unwrap().header.tick;
            back.send(state).unwrap();
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
