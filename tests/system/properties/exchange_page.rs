//! The exchange page, on which a foreign program may write anything at any time.

use std::fs::{File, OpenOptions};
use std::mem::offset_of;
use std::os::unix::fs::FileExt;

use exchange::reply::{self, Answer, Draft};
use exchange::{About, Failure, Page};
use runtime::RunDir;
use shared_types::codes::{ANSWER_DONE, PROGRAM_JOINED, REQUEST_TICK, USE_READS, USE_WRITES};
use shared_types::exchange::{EXCHANGE_STATE, EXCHANGE_VERSION, ExchangeHead, ExchangeTopic};
use shared_types::graph::{BUILT_IN, Graph};
use shared_types::layout::MessageLayout;
use shared_types::wire::Part;
use shared_types::{
    ControlState, Header, SensorSample, SingularityReport, StateEstimate, TorqueCommand,
};

use super::input::Hand;

thread_local! {
    static RUN: RunDir = RunDir::create().expect("shared memory");
    static TOPICS: Vec<(MessageLayout, u32)> = topics();
}

/// The topics of a program that has many: two that it reads, three that it writes.
fn topics() -> Vec<(MessageLayout, u32)> {
    let graph = Graph::parse("graph.toml", BUILT_IN).expect("the built-in graph");
    let named = [
        ("sensor", USE_READS),
        ("torque", USE_READS),
        ("estimate", USE_WRITES),
        ("singularity", USE_WRITES),
        ("control_state", USE_WRITES),
    ];
    named
        .map(|(topic, usage)| (graph.layout(topic).expect("a topic of the list"), usage))
        .into()
}

/// A refusal is a sentence in one line of bounded length.
fn is_refusal(failure: &Failure) {
    let sentence = failure.to_string();
    let is_line = !sentence.contains(char::is_control) && sentence.len() < 2_048;
    assert!(is_line, "{sentence:?}");
}

/// The program's side of a page: a file of which it may write every byte.
struct Foreign {
    file: File,
    bytes: u64,
    /// Where the messages lie, as the page said when it was made.
    messages: Vec<u64>,
}

/// The entry of a topic on a page.
fn entry(place: usize) -> u64 {
    (size_of::<ExchangeHead>().next_multiple_of(64) + place * size_of::<ExchangeTopic>()) as u64
}

impl Foreign {
    fn open(page: &Page, topics: usize) -> std::io::Result<Self> {
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .open(page.path())?;
        let at = |place| {
            let mut at = [0; 4];
            file.read_exact_at(&mut at, entry(place) + offset_of!(ExchangeTopic, at) as u64)?;
            Ok(u64::from(u32::from_ne_bytes(at)))
        };
        let messages = (0..topics).map(at).collect::<std::io::Result<_>>()?;
        Ok(Self {
            bytes: file.metadata()?.len(),
            messages,
            file,
        })
    }

    fn write(&self, bytes: &[u8], at: u64) {
        let at = at % self.bytes;
        let n = bytes.len().min((self.bytes - at) as usize);
        self.file
            .write_all_at(&bytes[..n], at)
            .expect("shared memory");
    }

    fn word(&self, word: u32, field: usize) {
        self.write(&word.to_ne_bytes(), field as u64);
    }

    /// Joins as the contract demands.
    fn join(&self, page: &[(MessageLayout, u32)]) {
        self.word(EXCHANGE_VERSION, offset_of!(ExchangeHead, program_version));
        for (place, (layout, _)) in page.iter().enumerate() {
            let entry = entry(place);
            self.write(
                layout.type_name.as_bytes(),
                entry + offset_of!(ExchangeTopic, program_type) as u64,
            );
            self.write(
                &layout.hash.to_ne_bytes(),
                entry + offset_of!(ExchangeTopic, program_layout) as u64,
            );
        }
        self.word(PROGRAM_JOINED, offset_of!(ExchangeHead, program));
    }

    fn answer(&self, count: u32, code: u32, tick: u64) {
        self.word(code, offset_of!(ExchangeHead, answer));
        self.write(
            &tick.to_ne_bytes(),
            offset_of!(ExchangeHead, answer_tick) as u64,
        );
        self.word(count, offset_of!(ExchangeHead, answers));
    }
}

/// For any bytes that a program writes onto its exchange page, between any two looks of armplane: each look ends with a refusal in words, or with what
/// is right; nothing that is not finite is sent; nothing beyond the page is read or written.
pub fn exchange_page(bytes: &[u8]) {
    RUN.with(|run| TOPICS.with(|topics| scribble(run, topics, &mut Hand(bytes))));
}

fn scribble(run: &RunDir, topics: &[(MessageLayout, u32)], hand: &mut Hand<'_>) {
    let process = "estimator";
    let about = About {
        is_lockstep: true,
        rate_hz: 1000,
        dof: 6,
        incarnation: 1,
    };
    let page = Page::create(run.path(), process, about, topics).expect("shared memory");
    let foreign = Foreign::open(&page, topics.len()).expect("shared memory");
    let mut drafts = (
        Draft::<StateEstimate>::of(2),
        Draft::<SingularityReport>::of(3),
        Draft::<ControlState>::of(4),
    );
    let (mut tick, mut expected) = (0_u64, 0_u32);
    while !hand.0.is_empty() {
        match hand.byte() % 12 {
            0 => {
                let (place, word) = (u32::from_ne_bytes(hand.take()), hand.take::<8>());
                foreign.write(&word, u64::from(place));
            }
            // A word of the head.
            1 => {
                let (place, word) = (u64::from(hand.byte()), hand.take::<4>());
                foreign.write(&word, 4 * place % size_of::<ExchangeHead>() as u64);
            }
            2 => {
                let (place, byte, length) = (
                    u64::from(u16::from_ne_bytes(hand.take())),
                    hand.byte(),
                    usize::from(hand.byte()),
                );
                foreign.write(&vec![byte; 64 * length], place);
            }
            3 => foreign.join(topics),
            4 => match reply::has_joined(&page, topics) {
                Ok(_) => {}
                Err(failure) => is_refusal(&failure),
            },
            5 => {
                tick = u64::from(hand.byte());
                let before = expected;
                expected = page.ask(REQUEST_TICK, tick);
                assert_eq!(
                    expected,
                    before.wrapping_add(1),
                    "requests are counted, whatever is written over the count"
                );
            }
            6 => foreign.answer(expected, ANSWER_DONE, tick),
            7 => foreign.answer(
                expected
                    .wrapping_add(u32::from(hand.byte() % 3))
                    .wrapping_sub(1),
                u32::from(hand.byte() % 6),
                tick,
            ),
            8 if expected > 0 => match reply::answer(&page, expected, tick) {
                Ok(Ok(answer)) => assert_ne!(answer, Answer::Stopped, "the run goes on"),
                Ok(Err(count)) => assert_eq!(count, expected.wrapping_sub(1)),
                Err(failure) => is_refusal(&failure),
            },
            9 => {
                // The content checked is the content sent, also where the page is written after the check.
                let mut sent = |number: u8| {
                    let refused = match number % 3 {
                        0 => drafts.0.not_finite(&page),
                        1 => drafts.1.not_finite(&page),
                        _ => drafts.2.not_finite(&page),
                    };
                    foreign.write(
                        &f64::NAN.to_ne_bytes().repeat(64),
                        foreign.messages[2 + usize::from(number % 3)] + size_of::<Header>() as u64,
                    );
                    let is_finite = match number % 3 {
                        0 => drafts.0.message(tick).is_finite(),
                        1 => drafts.1.message(tick).is_finite(),
                        _ => drafts.2.message(tick).is_finite(),
                    };
                    assert_eq!(refused.is_none(), is_finite, "{refused:?}");
                };
                sent(hand.byte());
            }
            10 => match reply::state_bytes(&page, tick) {
                Ok(bytes) => page.get_state(&mut [0; EXCHANGE_STATE][..bytes]),
                Err(failure) => is_refusal(&failure),
            },
            _ => {
                let message = [hand.byte(); size_of::<SensorSample>()];
                page.put(0, &message);
                page.mark_fresh(0, true);
                page.put(1, &[hand.byte(); size_of::<TorqueCommand>()]);
                page.give_reason(&String::from_utf8_lossy(&hand.take::<8>()).repeat(40));
                page.put_state(&[7; EXCHANGE_STATE][..usize::from(hand.byte()) * 16]);
                let _ = page.number(1, offset_of!(TorqueCommand, phase));
            }
        }
    }
}
