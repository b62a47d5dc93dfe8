//! A run's directory in shared memory, and the messages that it keeps.

use std::os::unix::fs::FileExt;
use std::path::Path;

use message_log::{LogReader, LogWriter, Logs, Place};
use runtime::{ControlPage, MAX_PROCESSES, MOST_FAULTS, Manifest, RunDir};
use shared_types::Message;
use shared_types::fault::ScheduledFault;
use shared_types::graph::{BUILT_IN, Graph};
use shared_types::topics::{self, COUNT, Each, TOPICS, Topic};

use super::input::Hand;

thread_local! {
    /// A run's directory, for the files in it.
    static RUN: RunDir = RunDir::create().expect("shared memory");
}

/// Bytes of a message log before its first block.
const HEAD: usize = 40;

/// The logs of a run.
pub fn logs() -> Logs {
    Logs::new(0x0123_4567_89ab_cdef, TOPICS)
}

/// A file of kept messages of any bytes is read to its end or refused with a sentence, and a writer that continues it corrupts nothing.
pub fn message_log(bytes: &[u8]) {
    fn check<M: Message>(bytes: &[u8], run: &Path) {
        let path = run.join(format!("{}.log", M::TOPIC));
        let read = || -> Result<Vec<M>, String> {
            let mut kept =
                LogReader::<M>::open_of(run, &logs()).map_err(|error| error.to_string())?;
            let mut messages = Vec::new();
            while let Some(message) = kept.next_message().map_err(|error| error.to_string())? {
                messages.push(message);
            }
            Ok(messages)
        };
        let more: [M; 3] = [M::zeroed(); 3];
        std::fs::write(&path, bytes).expect("shared memory");
        // Behind every place that is not as it was written the reader goes on, to the end.
        if let Ok(mut kept) = LogReader::<M>::open_of(run, &logs()) {
            kept.rows().expect(3);
            let (mut messages, mut defects) = (0, 0);
            loop {
                match kept.next_message() {
                    Ok(Some(_)) => messages += 1,
                    Ok(None) => break,
                    Err(error) => defects += usize::from(error.is_damage()),
                }
                assert!(
                    messages <= bytes.len() * 128 && defects <= bytes.len() + 2,
                    "{messages} messages, {defects} defects"
                );
            }
        }
        let before = read();
        match LogWriter::<M>::resume(run, &logs(), Place::default(), |_| {}) {
            Ok(mut keep) => {
                more.iter()
                    .for_each(|message| keep.add(message).expect("shared memory"));
                keep.finish().expect("shared memory");
                // A writer that was killed before it had made its file leaves a part of the head: its successor begins anew.
                let expected = match bytes.len() < HEAD {
                    true => Ok(more.to_vec()),
                    false => before.map(|messages| [&messages[..], &more].concat()),
                };
                let bytes = |messages: Vec<M>| bytemuck::cast_slice::<M, u8>(&messages).to_vec();
                assert_eq!(
                    read().map(bytes),
                    expected.map(bytes),
                    "what was there is there, and what came is behind it"
                );
            }
            Err(error) => assert!(
                before.is_err_and(|sentence| !sentence.is_empty()),
                "{error}"
            ),
        }
    }
    // With a right head, or with none: a fuzzer would have to find forty bytes first.
    let (choice, rest) = bytes.split_first().unwrap_or((&0, &[]));
    RUN.with(|run| {
        let run = run.path();
        // And with right checksums and numbers: a fuzzer would never find them.
        let with_head = |head: Vec<u8>| {
            let mut file = if choice & 8 != 0 {
                [head, rest.to_vec()].concat()
            } else {
                rest.to_vec()
            };
            if choice & 32 != 0 {
                message_log::seal(&mut file);
            }
            file
        };
        fn head<M: Message>(run: &Path) -> Vec<u8> {
            LogWriter::<M>::create(run, &logs())
                .and_then(LogWriter::finish)
                .expect("shared memory");
            let file = std::fs::read(run.join(format!("{}.log", M::TOPIC))).expect("shared memory");
            file[..HEAD].to_vec()
        }
        struct CheckKept<'a>(&'a dyn Fn(Vec<u8>) -> Vec<u8>, &'a Path);
        impl Each for CheckKept<'_> {
            type Output = ();
            fn each<M: Topic>(&mut self) {
                check::<M>(&(self.0)(head::<M>(self.1)), self.1);
            }
        }
        topics::named(
            TOPICS[usize::from(*choice) % COUNT],
            &mut CheckKept(&with_head, run),
        );
    });
}

/// A manifest as a run has it, but shorter.
pub const MANIFEST: &str = r#"{"mode":"lockstep","rate_hz":1000,"wait_limit":{"secs":10,"nanos":0},"processes":[
{"name":"plant","reads":["torque"],"writes":["sensor"],"polled":false,"makes_ticks":true,"core":0,"priority":80},
{"name":"controller","reads":["sensor"],"writes":["torque"],"polled":false,"core":null,"priority":null}]}"#;

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
        let _ = (control_page.stop(), control_page.live_state());
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
        let scheduled = ScheduledFault::death(3, 0, 0, 1000);
        if let Some(place) = control_page.fault_table().request(&scheduled) {
            assert!(place < MOST_FAULTS && !control_page.fault_table().is_in_force(place));
        }
        control_page.fault_table().mark_detected(3, 5, 5);
        control_page.ring_all();
    });
}
