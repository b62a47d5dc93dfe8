//! Hand-overs between processes: half a round trip between two, and once around four.

use runtime::realtime::allowed_cores;
use session::{Failure, Observer};
use shared_types::topics::{CHAIN, OfTopic};
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
    measure("hop", &PAIRS, 2, samples, only, observer)
}

/// Once around the processes of the chain, by mechanism and placement.
///
/// # Errors
/// As [`hop`].
pub fn cycle(samples: u64, only: &Only<'_>, observer: Observer<'_>) -> Result<Vec<Row>, Failure> {
    measure("cycle", &[CHAIN], 1, samples, only, observer)
}

/// Rows of one bench, by placement and the topics of a ring, with their ratios to the futex among them; a trip counts as so many hand-overs.
fn measure<const N: usize>(
    bench: &'static str,
    rings: &[[&str; N]],
    hand_overs: u32,
    samples: u64,
    only: &Only<'_>,
    observer: Observer<'_>,
) -> Result<Vec<Row>, Failure> {
    let mut rows = Vec::new();
    for (placement, cores) in placements(N) {
        for topics in rings {
            let bytes = bytes_of(topics) / hand_overs as usize;
            let mechanisms = only.choose(bench, placement, bytes);
            if mechanisms.is_empty() {
                continue;
            }
            let ring = Ring {
                topics: topics.map(str::to_owned).to_vec(),
                cores: cores.clone(),
                mechanisms,
                rounds: samples.div_ceil(TRIPS),
                trips: TRIPS,
                share: f64::from(hand_overs),
            };
            let measured = ring.measure(observer)?;
            let baseline = measured[0].1;
            let ratio = |times: &Distribution, of: fn(&Distribution) -> f64| {
                (of(&baseline) > 0.0).then(|| of(times) / of(&baseline))
            };
            let row = |(mechanism, times): (Mechanism, Distribution)| Row {
                bench,
                mechanism: mechanism.name().to_owned(),
                placement,
                payload_bytes: bytes,
                ratio_p50: ratio(&times, |times| times.p50_us),
                ratio_p99: ratio(&times, |times| times.p99_us),
                times,
            };
            rows.extend(measured.into_iter().map(row));
        }
    }
    Ok(rows)
}
