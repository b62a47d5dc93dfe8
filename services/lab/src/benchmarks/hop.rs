//! Hand-overs between processes: half a round trip, once around four processes, and the same on a grid of time.

use runtime::realtime::allowed_cores;
use session::{Failure, Observer, Progress};
use shared_types::topics::{CHAIN, Each, Topic, named};
use shared_types::{Message, PlantState, SensorSample, SingularityReport, TorqueCommand};

use super::distribution::{Distribution, Row};
use super::ring::{Mechanism, Ring};
use super::transports::{BLOCK_TOPICS, BLOCKS};

/// A choice among the rows: each word must be the number of bytes, or occur in the row's bench, placement or mechanism.
pub struct Only<'a>(pub &'a [String]);

impl Only<'_> {
    fn admits(&self, bench: &str, placement: &str, bytes: usize, mechanism: Mechanism) -> bool {
        let is_in = |word: &String| match word.parse::<usize>() {
            Ok(number) => number == bytes,
            Err(_) => [bench, placement, mechanism.name()]
                .iter()
                .any(|text| text.to_lowercase().contains(&word.to_lowercase())),
        };
        self.0.iter().all(is_in)
    }

    /// The mechanisms that are measured: those chosen, and their baseline; none where none is chosen.
    fn choose(
        &self,
        bench: &str,
        placement: &str,
        bytes: usize,
        mechanisms: Vec<Mechanism>,
    ) -> Vec<Mechanism> {
        let is_chosen = |one: &Mechanism| self.admits(bench, placement, bytes, *one);
        match mechanisms.iter().any(is_chosen) {
            true => mechanisms
                .into_iter()
                .filter(|one| *one == Mechanism::Futex || is_chosen(one))
                .collect(),
            false => Vec::new(),
        }
    }
}

/// Where the processes of a ring are, by name.
fn placements(count: usize) -> Vec<(&'static str, Vec<Option<usize>>)> {
    let cores = allowed_cores();
    let mut placements = vec![("same core", vec![cores.first().copied(); count])];
    if cores.len() > 1 {
        let alternating = (0..count).map(|index| Some(cores[index % 2])).collect();
        placements.push((
            if count == 2 {
                "cross core"
            } else {
                "alternating cores"
            },
            alternating,
        ));
    }
    placements
}

/// Up to here blocks go through every way of waking a reader; bytes.
const SMALL: usize = 4096;

/// From here on a pipe needs so long for its copies that a tenth of the samples must do; bytes.
const LARGE: usize = 65_536;

/// Trips of a block: long enough to be in the steady state, short enough to see the same machine as the other mechanisms.
const TRIPS: u64 = 500;

fn names(topics: &[&str]) -> Vec<String> {
    topics.iter().map(ToString::to_string).collect()
}

/// Half a round trip between two processes, by mechanism, placement and size.
///
/// # Errors
/// A process fails, or the machine refuses memory.
pub fn hop(samples: u64, only: &Only<'_>, observer: Observer<'_>) -> Result<Vec<Row>, Failure> {
    let (mut rows, rounds) = (Vec::new(), samples.div_ceil(TRIPS));
    for (placement, cores) in placements(2) {
        // Two that spin on one core only wait for each other's time slice to end.
        let is_split = placement != "same core";
        let ring = |topics: &[&str], block_bytes: Option<usize>, mechanisms: Vec<Mechanism>| Ring {
            topics: names(topics),
            block_bytes,
            cores: cores.clone(),
            mechanisms,
            rounds,
            trips: TRIPS,
            period_ns: None,
        };
        let mut measure = |mut ring: Ring, bytes: usize| -> Result<(), Failure> {
            ring.mechanisms = only.choose("hop", placement, bytes, ring.mechanisms);
            if ring.mechanisms.is_empty() {
                return Ok(());
            }
            let measured = ring
                .measure(observer)?
                .into_iter()
                .map(|one| (one.mechanism, one.trip.divided_by(2.0)));
            rows.extend(against_baseline(
                "hop",
                placement,
                bytes,
                Mechanism::Futex,
                measured.collect(),
            ));
            Ok(())
        };
        for (bytes, topics) in BLOCKS.into_iter().zip(&BLOCK_TOPICS) {
            let mut mechanisms = vec![
                Mechanism::Futex,
                Mechanism::Topic,
                Mechanism::Doorbell,
                Mechanism::Pipe,
            ];
            let (needed, free) = (
                runtime::topic_bytes(bytes) * topics.len() as u64,
                runtime::free_bytes(),
            );
            if needed > free {
                mechanisms.retain(|one| *one != Mechanism::Topic);
                let mb = |bytes: u64| bytes.div_ceil(1_000_000);
                observer(Progress::Line(&format!(
                    "left out: topics of {bytes} bytes, which need {} MB of shared memory; {} MB are free",
                    mb(needed),
                    mb(free)
                )));
            }
            if bytes <= SMALL {
                mechanisms.extend([Mechanism::Listener, Mechanism::WaitSet]);
            }
            if is_split {
                mechanisms.extend([Mechanism::Spin, Mechanism::Poll]);
            }
            let rounds = if bytes > LARGE {
                (rounds / 10).max(2)
            } else {
                rounds
            };
            measure(
                Ring {
                    rounds,
                    ..ring(topics, Some(bytes), mechanisms)
                },
                bytes,
            )?;
        }
        for topics in PAIRS {
            let mechanisms = vec![
                Mechanism::Futex,
                Mechanism::Topic,
                Mechanism::Doorbell,
                Mechanism::Pipe,
            ];
            measure(
                ring(&topics, None, mechanisms),
                bytes_of(&topics) / topics.len(),
            )?;
        }
    }
    Ok(rows)
}

/// Topics between which messages go to and fro: a small and a large message of the chain, each with another.
const PAIRS: [[&str; 2]; 2] = [
    [SensorSample::TOPIC, PlantState::TOPIC],
    [SingularityReport::TOPIC, TorqueCommand::TOPIC],
];

/// The bytes of one message of each of these topics.
fn bytes_of(topics: &[&str]) -> usize {
    struct Size;
    impl Each for Size {
        type Output = usize;
        fn each<M: Topic>(&mut self) -> usize {
            size_of::<M>()
        }
    }
    topics
        .iter()
        .filter_map(|topic| named(topic, &mut Size))
        .sum()
}

/// Once around the processes of the chain, by mechanism and placement.
///
/// # Errors
/// As [`hop`].
pub fn cycle(samples: u64, only: &Only<'_>, observer: Observer<'_>) -> Result<Vec<Row>, Failure> {
    let mut rows = Vec::new();
    for (placement, cores) in placements(4)
        .into_iter()
        .chain([("not pinned, no FIFO", vec![None; 4])])
    {
        let mechanisms = vec![
            Mechanism::Futex,
            Mechanism::Topic,
            Mechanism::Doorbell,
            Mechanism::Pipe,
        ];
        let mechanisms = only.choose("cycle", placement, bytes_of(&CHAIN), mechanisms);
        if mechanisms.is_empty() {
            continue;
        }
        let ring = Ring {
            topics: names(&CHAIN),
            block_bytes: None,
            cores,
            mechanisms,
            rounds: samples.div_ceil(TRIPS),
            trips: TRIPS,
            period_ns: None,
        };
        let measured = ring
            .measure(observer)?
            .into_iter()
            .map(|one| (one.mechanism, one.trip));
        rows.extend(against_baseline(
            "cycle",
            placement,
            bytes_of(&CHAIN),
            Mechanism::Futex,
            measured.collect(),
        ));
    }
    Ok(rows)
}

/// The cycle on a grid of `rate_hz` for `seconds`.
///
/// # Errors
/// As [`hop`].
pub fn paced(rate_hz: u64, seconds: u64, observer: Observer<'_>) -> Result<Vec<Row>, Failure> {
    // A block is a quarter of a second: the mechanisms take turns within one run.
    let (rounds, trips) = (4 * seconds, rate_hz / 4);
    let (placement, cores) = placements(4).swap_remove(0);
    let mechanisms = vec![Mechanism::Nothing, Mechanism::Futex, Mechanism::Topic];
    let period_ns = Some(1_000_000_000 / rate_hz);
    let measured = Ring {
        topics: names(&CHAIN),
        block_bytes: None,
        cores,
        mechanisms,
        rounds,
        trips,
        period_ns,
    }
    .measure(observer)?;
    let wakes = measured
        .iter()
        .map(|one| (one.mechanism, one.wake.clone()))
        .collect();
    let mut rows = against_baseline(
        &format!("wake-up at {rate_hz} Hz"),
        placement,
        0,
        Mechanism::Nothing,
        wakes,
    );
    let trips = measured
        .iter()
        .filter(|one| one.mechanism != Mechanism::Nothing)
        .map(|one| (one.mechanism, one.trip.clone()))
        .collect();
    rows.extend(against_baseline(
        &format!("paced at {rate_hz} Hz"),
        placement,
        bytes_of(&CHAIN),
        Mechanism::Futex,
        trips,
    ));
    Ok(rows)
}

/// Rows of one bench, placement and payload, with their ratios to the baseline among them.
fn against_baseline(
    bench: &str,
    placement: &str,
    payload_bytes: usize,
    baseline: Mechanism,
    measured: Vec<(Mechanism, Distribution)>,
) -> Vec<Row> {
    let baseline = measured
        .iter()
        .find(|(mechanism, _)| *mechanism == baseline)
        .map(|(_, distribution)| distribution.clone());
    let ratio = |value: f64, of: fn(&Distribution) -> f64| {
        baseline
            .as_ref()
            .map(of)
            .filter(|baseline| *baseline > 0.0)
            .map(|baseline| value / baseline)
    };
    let row = |(mechanism, distribution): (Mechanism, Distribution)| Row {
        bench: bench.to_owned(),
        mechanism: mechanism.name().to_owned(),
        placement: placement.to_owned(),
        payload_bytes,
        ratio_p50: ratio(distribution.p50_us, |baseline| baseline.p50_us),
        ratio_p99: ratio(distribution.p99_us, |baseline| baseline.p99_us),
        distribution,
    };
    measured.into_iter().map(row).collect()
}
