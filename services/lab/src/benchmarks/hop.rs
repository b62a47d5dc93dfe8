//! Hand-overs between processes: half a round trip between two, and once around four.

use runtime::realtime::allowed_cores;
use session::{Failure, Observer};
use shared_types::topics::CHAIN;
use shared_types::{Message, PlantState, SensorSample, SingularityReport, TorqueCommand};

use super::ring::Ring;
use super::transports::{Kind, Mechanism};
use super::{Distribution, Row};

/// A choice among the rows: each word must be the number of bytes, or occur in the row's bench, placement or mechanism.
pub struct Only<'a>(pub &'a [String]);

impl Only<'_> {
    /// The mechanisms that are measured: those chosen, and their baseline; none where none is chosen.
    fn choose(&self, bench: &str, placement: &str, bytes: usize) -> Vec<Mechanism> {
        let is_chosen = |one: &Mechanism| {
            self.0.iter().all(|word| match word.parse::<usize>() {
                Ok(number) => number == bytes,
                Err(_) => [bench, placement, one.name()]
                    .iter()
                    .any(|text| text.to_lowercase().contains(&word.to_lowercase())),
            })
        };
        let mut chosen = Mechanism::ALL.to_vec();
        chosen.retain(is_chosen);
        if !chosen.is_empty() && chosen[0] != Mechanism::Futex {
            chosen.insert(0, Mechanism::Futex);
        }
        chosen
    }
}

/// Trips of a round: long enough to be in the steady state, short enough to see the same machine as the other mechanisms.
const TRIPS: u64 = 500;

/// Topics between which messages go to and fro: a small and a large message of the chain, each with another.
const PAIRS: [[&str; 2]; 2] = [
    [SensorSample::TOPIC, PlantState::TOPIC],
    [SingularityReport::TOPIC, TorqueCommand::TOPIC],
];

/// Where the processes of a ring are, by name.
fn placements(count: usize) -> Vec<(&'static str, Vec<Option<usize>>)> {
    let cores = allowed_cores();
    let mut placements = vec![("same core", vec![cores.first().copied(); count])];
    if cores.len() > 1 {
        let name = if count == 2 {
            "cross core"
        } else {
            "alternating cores"
        };
        placements.push((
            name,
            (0..count).map(|index| Some(cores[index % 2])).collect(),
        ));
    }
    if count > 2 {
        placements.push(("not pinned, no FIFO", vec![None; count]));
    }
    placements
}

fn bytes_of(topics: &[&str]) -> usize {
    topics
        .iter()
        .filter_map(|topic| Kind::named(topic))
        .map(|kind| kind.bytes)
        .sum()
}

/// Half a round trip between two processes, by mechanism, placement and size.
///
/// # Errors
/// A process fails, or the machine refuses memory.
pub fn hop(samples: u64, only: &Only<'_>, observer: Observer<'_>) -> Result<Vec<Row>, Failure> {
    let mut rows = Vec::new();
    for (placement, cores) in placements(2) {
        for topics in PAIRS {
            let key = ("hop", placement, bytes_of(&topics) / 2, 2.0);
            rows.extend(measure(key, &topics, &cores, samples, only, observer)?);
        }
    }
    Ok(rows)
}

/// Once around the processes of the chain, by mechanism and placement.
///
/// # Errors
/// As [`hop`].
pub fn cycle(samples: u64, only: &Only<'_>, observer: Observer<'_>) -> Result<Vec<Row>, Failure> {
    let mut rows = Vec::new();
    for (placement, cores) in placements(CHAIN.len()) {
        let key = ("cycle", placement, bytes_of(&CHAIN), 1.0);
        rows.extend(measure(key, &CHAIN, &cores, samples, only, observer)?);
    }
    Ok(rows)
}

/// Rows of one bench, placement and payload, with their ratios to the futex among them.
fn measure(
    (bench, placement, bytes, share): (&str, &str, usize, f64),
    topics: &[&str],
    cores: &[Option<usize>],
    samples: u64,
    only: &Only<'_>,
    observer: Observer<'_>,
) -> Result<Vec<Row>, Failure> {
    let mechanisms = only.choose(bench, placement, bytes);
    if mechanisms.is_empty() {
        return Ok(Vec::new());
    }
    let ring = Ring {
        topics: topics.iter().map(ToString::to_string).collect(),
        cores: cores.to_vec(),
        mechanisms,
        rounds: samples.div_ceil(TRIPS),
        trips: TRIPS,
        share,
    };
    let measured = ring.measure(observer)?;
    let baseline = measured[0].1;
    let ratio = |times: &Distribution, of: fn(&Distribution) -> f64| {
        (of(&baseline) > 0.0).then(|| of(times) / of(&baseline))
    };
    let row = |(mechanism, times): (Mechanism, Distribution)| Row {
        bench: bench.to_owned(),
        mechanism: mechanism.name().to_owned(),
        placement: placement.to_owned(),
        payload_bytes: bytes,
        ratio_p50: ratio(&times, |times| times.p50_us),
        ratio_p99: ratio(&times, |times| times.p99_us),
        times,
    };
    Ok(measured.into_iter().map(row).collect())
}
