//! A run's directory in shared memory, and the messages that it keeps.

use std::os::unix::fs::FileExt;

use recorder::{Contents, Cut, Item, MESSAGES, RecordReader, RecordWriter};
use runtime::{ControlPage, MAX_PROCESSES, MOST_FAULTS, Manifest, RunDir};
use shared_types::SingularityReport;
use shared_types::fault::ScheduledFault;
use shared_types::graph::{BUILT_IN, Graph};

use super::input::Hand;

thread_local! {
    /// A run's directory, for the files in it.
    static RUN: RunDir = RunDir::create().expect("shared memory");
}

/// The run of the record.
pub fn contents() -> Contents {
    Contents::of_topics(0x0123_4567_89ab_cdef, 1000, |_| true)
}

/// A record of any bytes is read to its end or refused with a sentence, and what is read of it can be written again. The first byte tells whether the head
/// of a record stands before the others: a fuzzer would not find it.
pub fn record(bytes: &[u8]) {
    let (choice, rest) = bytes.split_first().unwrap_or((&0, &[]));
    RUN.with(|run| {
        let (path, contents) = (run.path().join(MESSAGES), contents());
        let mut file = Vec::new();
        if choice & 1 != 0 {
            let head = RecordWriter::create(&path, &contents).expect("shared memory");
            let bytes = head.bytes() as usize;
            drop(head);
            file = std::fs::read(&path).expect("shared memory");
            file.truncate(bytes);
        }
        file.extend_from_slice(rest);
        std::fs::write(&path, &file).expect("shared memory");
        match RecordReader::open(&path, &contents) {
            Ok(mut record) => {
                let (mut count, mut messages) = (0, 0);
                while let Some(item) = record.next_item() {
                    if let Item::Message { message, .. } = item {
                        count += 1;
                        messages += message.len();
                    }
                }
                let flaws = record.damage().len();
                assert!(messages <= file.len() * 300 && flaws <= 2 * file.len() + 1);
                let mut again = RecordReader::open(&path, &contents).expect("a record");
                let copy = path.with_added_extension("copy");
                RecordWriter::continuing(&copy, &contents, &mut again)
                    .and_then(RecordWriter::finish)
                    .expect("all that was read");
                let mut copied = RecordReader::open(&copy, &contents).expect("a whole record");
                while let Some(item) = copied.next_item() {
                    count -= usize::from(matches!(item, Item::Message { .. }));
                }
                assert_eq!(count, 0);
                let cut = Cut::newest(&path, &contents, |_| true).expect("what was read once");
                assert!(cut.is_none_or(|cut| cut.processes.len() <= file.len()));
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    });
}

/// A manifest as a run has it, but shorter.
pub const MANIFEST: &str = r#"{"mode":"lockstep","rate_hz":1000,"wait_limit":{"secs":10,"nanos":0},"processes":[
{"name":"plant","reads":["torque"],"writes":["sensor"],"makes_ticks":true,"core":0,"priority":80},
{"name":"controller","reads":["sensor"],"writes":["torque"],"core":null,"priority":null}]}"#;

/// A manifest of any bytes is refused with a sentence, or one that a run can be held by.
pub fn manifest(bytes: &[u8]) {
    RUN.with(|run| {
        std::fs::write(run.path().join("manifest.json"), bytes).expect("shared memory");
        match Manifest::read(run) {
            Ok(manifest) => {
                assert!(manifest.period_ns() > 0 && manifest.processes.len() <= MAX_PROCESSES);
                for topic in manifest.topics() {
                    let woken = manifest.woken_by(topic).chain(manifest.writer_of(topic));
                    woken.for_each(|index| assert!(index < manifest.processes.len()));
                }
                manifest.write(run).expect("what was read can be written");
                assert_eq!(Manifest::read(run).expect("and read again"), manifest);
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    });
}

/// For any bytes on a run's control page, a reader stays within bounds: counts, times, the arm's state, every fault in the fault table.
pub fn control_page(bytes: &[u8]) {
    RUN.with(|run| {
        let path = run.path().join("control_page");
        let _ = std::fs::remove_file(&path);
        drop(ControlPage::create(run).expect("shared memory"));
        let file = std::fs::OpenOptions::new()
            .write(true)
            .open(&path)
            .expect("shared memory");
        let size = file.metadata().expect("shared memory").len();
        let mut hand = Hand(bytes);
        while !hand.0.is_empty() {
            // Behind the mark by which a control page is known.
            let (place, word) = (u64::from(u32::from_ne_bytes(hand.take())), hand.take::<8>());
            file.write_all_at(&word, 8 + 8 * (place % (size / 8 - 1)))
                .expect("shared memory");
        }
        let control_page = ControlPage::open(run).expect("its size and mark are right");
        let report = control_page.latest::<SingularityReport>();
        let _ = (control_page.stop(), report.listed());
        for index in 0..MAX_PROCESSES {
            let line = control_page.process(index);
            let (step, age) = (line.step(), line.age());
            let _ = (
                line.state(),
                line.counts(),
                line.pid(),
                step.count(),
                step.since(&age).quantile_us(0.99),
                age.longest_us(),
            );
        }
        let graph = Graph::parse("graph.toml", BUILT_IN).expect("the built-in graph");
        let accounts: Vec<_> = control_page.fault_table().records().collect();
        assert!(accounts.len() <= MOST_FAULTS);
        for (_, account) in accounts {
            for process in &graph.process {
                let target = graph.target(&process.name).expect("a process of the graph");
                if let Some(fault) = account.scheduled.fault(&process.name, &target) {
                    let _ = (fault.to_string(), fault.schedule(&target, 1000, 1));
                }
            }
        }
        let scheduled = ScheduledFault::death(3, 0, 1000);
        if let Some(place) = control_page.fault_table().request(&scheduled) {
            assert!(place < MOST_FAULTS && !control_page.fault_table().is_in_force(place));
        }
        control_page.fault_table().mark_detected(3, 5, 5);
        control_page.ring_all();
    });
}
