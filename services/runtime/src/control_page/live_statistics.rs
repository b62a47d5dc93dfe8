//! Live statistics of a running graph on the control page: distributions of times and latest values, each written by its owner.
//!
//! Readers (`armplane top`) cost the writers nothing: no port, connection, lock or system call.
//! Each number has one writer.

use std::sync::atomic::{AtomicU64, Ordering};

use shared_types::{
    ControlState, MAX_SINGULARITIES, Message, SensorSample, ServoState, SingularityReport,
    TorqueCommand,
};

use crate::bus::format::read;

/// Buckets per factor of two: a bucket is an eighth of its value wide, at most.
const SPLIT_BITS: u32 = 3;
const SPLIT: usize = 1 << SPLIT_BITS;
/// Times of 2³⁷ ns (137 s) and more share the last bucket.
const BUCKETS: usize = (37 - SPLIT_BITS as usize + 1) * SPLIT;

#[inline]
fn bucket(ns: u64) -> usize {
    let octave = ns.max(1).ilog2();
    let index = match octave.checked_sub(SPLIT_BITS) {
        None => ns as usize,
        Some(shift) => (shift as usize + 1) * SPLIT + (ns >> shift) as usize - SPLIT,
    };
    index.min(BUCKETS - 1)
}

/// The middle of a bucket; ns.
fn middle(index: usize) -> f64 {
    match (index / SPLIT).checked_sub(1) {
        None => index as f64,
        Some(shift) => ((SPLIT + index % SPLIT) as f64 + 0.5) * (1_u64 << shift) as f64,
    }
}

/// Times in logarithmic buckets; one writer.
#[repr(C)]
#[derive(Debug)]
pub(crate) struct DurationHistogram {
    longest_ns: AtomicU64,
    counts: [AtomicU64; BUCKETS],
}

impl Default for DurationHistogram {
    fn default() -> Self {
        Self {
            longest_ns: AtomicU64::new(0),
            counts: std::array::from_fn(|_| AtomicU64::new(0)),
        }
    }
}

impl DurationHistogram {
    /// Two plain loads and stores: there is one writer, and a reader that sees one without the other sees a sample less.
    #[inline]
    pub(crate) fn record(&self, ns: u64) {
        let count = &self.counts[bucket(ns)];
        count.store(count.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
        if ns > self.longest_ns.load(Ordering::Relaxed) {
            self.longest_ns.store(ns, Ordering::Relaxed);
        }
    }

    pub(crate) fn read(&self) -> Distribution {
        Distribution {
            counts: self
                .counts
                .iter()
                .map(|count| count.load(Ordering::Relaxed))
                .collect(),
            longest_ns: self.longest_ns.load(Ordering::Relaxed),
        }
    }
}

/// A distribution of times as it was at one moment; a percentile is right within 6 %.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Distribution {
    counts: Vec<u64>,
    longest_ns: u64,
}

impl Distribution {
    /// How many times.
    pub fn count(&self) -> u64 {
        self.counts
            .iter()
            .fold(0, |sum: u64, count| sum.saturating_add(*count))
    }

    /// The difference to an earlier snapshot; the longest time still covers the whole run.
    pub fn since(&self, earlier: &Self) -> Self {
        let counts = self
            .counts
            .iter()
            .zip(&earlier.counts)
            .map(|(now, before)| now.saturating_sub(*before))
            .collect();
        Self {
            counts,
            longest_ns: self.longest_ns,
        }
    }

    /// The time below which a share of all times lies; µs, `None` without any.
    pub fn quantile_us(&self, share: f64) -> Option<f64> {
        let rank = (self.count() as f64 * share).ceil().max(1.0) as u64;
        let mut below = 0_u64;
        let reached = |count: &u64| {
            below = below.saturating_add(*count);
            below >= rank
        };
        self.counts
            .iter()
            .position(reached)
            .map(|index| (middle(index) * 1e-3).min(self.longest_us()))
    }

    /// The longest since the beginning; µs, exact.
    pub fn longest_us(&self) -> f64 {
        self.longest_ns as f64 * 1e-3
    }
}

/// The latest values for observers of the run: each topic's writer stores its own.
#[repr(C, align(64))]
#[derive(Debug, Default)]
pub(crate) struct LiveStateCells {
    /// How many singularities; of each: kind, class, inside, s.
    singularities: AtomicU64,
    singularity: [[AtomicU64; 4]; MAX_SINGULARITIES],
    mode: [AtomicU64; MAX_SINGULARITIES],
    phase: AtomicU64,
    /// The drive, and ticks since the last fresh torque.
    drive: [AtomicU64; 2],
    /// Reason, joint, its side, nearest singularity, targets refused; openness of that singularity, and speed.
    servo: [AtomicU64; 7],
}

fn store<const N: usize>(cells: &[AtomicU64; N], values: [u64; N]) {
    let pairs = cells.iter().zip(values);
    pairs.for_each(|(cell, value)| cell.store(value, Ordering::Relaxed));
}

fn load<const N: usize>(cells: &[AtomicU64; N]) -> [u64; N] {
    std::array::from_fn(|i| cells[i].load(Ordering::Relaxed))
}

/// Stores the values of a message that `armplane status` shows.
pub(crate) type Note = fn(&LiveStateCells, &[u8]);

/// How the values of a topic's messages are stored.
pub(crate) fn note_of(topic: &str) -> Note {
    fn of<M: Message>(
        cells: &LiveStateCells,
        message: &[u8],
        store: impl FnOnce(&LiveStateCells, &M),
    ) {
        read(message, |message| store(cells, message));
    }
    match topic {
        SingularityReport::TOPIC => |cells, message| {
            of(cells, message, |cells, report: &SingularityReport| {
                cells
                    .singularities
                    .store(report.count.into(), Ordering::Relaxed);
                for (cells, one) in cells.singularity.iter().zip(&report.singularities) {
                    let codes = [one.kind, one.class, one.inside].map(u64::from);
                    store(cells, [codes[0], codes[1], codes[2], one.s.to_bits()]);
                }
            })
        },
        TorqueCommand::TOPIC => |cells, message| {
            of(cells, message, |cells, command: &TorqueCommand| {
                cells.phase.store(command.phase.into(), Ordering::Relaxed);
            })
        },
        ControlState::TOPIC => |cells, message| {
            of(cells, message, |cells, state: &ControlState| {
                store(&cells.mode, state.mode.map(u64::from));
            })
        },
        ServoState::TOPIC => |cells, message| {
            of(cells, message, |cells, state: &ServoState| {
                let values = [
                    state.reason.into(),
                    state.joint.into(),
                    state.upper.into(),
                    state.singularity.into(),
                    state.refused.into(),
                    state.nearest.to_bits(),
                    state.speed_scale.to_bits(),
                ];
                store(&cells.servo, values);
            })
        },
        SensorSample::TOPIC => |cells, message| {
            of(cells, message, |cells, sample: &SensorSample| {
                store(
                    &cells.drive,
                    [sample.drive, sample.stale_ticks].map(u64::from),
                );
            })
        },
        _ => |_, _| (),
    }
}

impl LiveStateCells {
    pub(crate) fn read(&self) -> LiveState {
        let count = (load_one(&self.singularities) as usize).min(MAX_SINGULARITIES);
        let modes = load(&self.mode);
        let singularity = |index: usize| {
            let [kind, class, inside, s] = load(&self.singularity[index]);
            LiveSingularity {
                kind: kind as u32,
                class: class as u32,
                is_inside: inside != 0,
                s: f64::from_bits(s),
                mode: modes[index] as u32,
            }
        };
        let [
            reason,
            joint,
            upper,
            singularity_of,
            refused,
            nearest,
            speed,
        ] = load(&self.servo);
        let [drive, stale_ticks] = load(&self.drive);
        LiveState {
            servo: ServoState {
                reason: reason as u32,
                joint: joint as u32,
                upper: upper as u32,
                singularity: singularity_of as u32,
                refused: refused as u32,
                nearest: f64::from_bits(nearest),
                speed_scale: f64::from_bits(speed),
                ..Default::default()
            },
            singularities: (0..count).map(singularity).collect(),
            phase: load_one(&self.phase) as u32,
            drive: drive as u32,
            stale_ticks: stale_ticks as u32,
        }
    }
}

fn load_one(cell: &AtomicU64) -> u64 {
    cell.load(Ordering::Relaxed)
}

/// The arm's state, as its processes last reported it; numbers of neighbouring ticks may stand side by side.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveState {
    /// The singularities of the last report.
    pub singularities: Vec<LiveSingularity>,
    /// One of `codes::PHASES`.
    pub phase: u32,
    /// One of `codes::DRIVES`.
    pub drive: u32,
    /// Ticks since the last fresh torque.
    pub stale_ticks: u32,
    /// State of a steered run for one line of text; zero in other runs.
    pub servo: ServoState,
}

/// One singularity of a [`LiveState`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LiveSingularity {
    /// One of `codes::KINDS`.
    pub kind: u32,
    /// One of `codes::TYPES`.
    pub class: u32,
    /// Whether the arm is in its neighbourhood.
    pub is_inside: bool,
    /// Its measure s_i; dimensionless.
    pub s: f64,
    /// One of `codes::MODES`.
    pub mode: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_rise_without_gaps_and_hold_their_times() {
        let mut last = 0;
        for ns in (0..4096).chain((12..60).map(|bits| 1 << bits)) {
            let index = bucket(ns);
            assert!(
                index == last || index > last && (ns > 4096 || index == last + 1),
                "{ns} ns in bucket {index} after {last}"
            );
            last = index;
        }
        assert_eq!(last, BUCKETS - 1);
        for ns in [1, 7, 8, 100, 12_345, 999_999, 100_000_000_000] {
            let error = (middle(bucket(ns)) - ns as f64).abs() / ns as f64;
            assert!(error <= 0.0625, "{ns} ns is told as {}", middle(bucket(ns)));
        }
    }

    #[test]
    fn quantiles_are_those_of_the_samples() {
        let times = DurationHistogram::default();
        (1..=1000).for_each(|us| times.record(us * 1000));
        let (first, is_near) = (times.read(), |spread: &Distribution, share, us: f64| {
            (spread.quantile_us(share).unwrap() / us - 1.0).abs() < 0.07
        });
        assert!(is_near(&first, 0.5, 500.0) && is_near(&first, 0.99, 990.0));
        assert_eq!((first.count(), first.longest_us()), (1000, 1000.0));
        assert!(first.quantile_us(1.0).unwrap() <= 1000.0);
        (0..10).for_each(|_| times.record(5_000));
        let later = times.read().since(&first);
        assert!(later.count() == 10 && is_near(&later, 0.5, 5.0));
        assert_eq!(later.since(&later).quantile_us(0.5), None);
    }

    #[test]
    fn each_writer_notes_its_own() {
        let live_state = LiveStateCells::default();
        let mut report = SingularityReport {
            count: 2,
            ..Default::default()
        };
        let second = &mut report.singularities[1];
        (second.s, second.inside, second.kind) = (-0.25, 1, 3);
        fn note<M: Message>(cells: &LiveStateCells, message: &M) {
            note_of(M::TOPIC)(cells, bytemuck::bytes_of(message));
        }
        note(&live_state, &report);
        note(
            &live_state,
            &ControlState {
                mode: [0, 5, 0, 0],
                ..Default::default()
            },
        );
        note(
            &live_state,
            &TorqueCommand {
                phase: 1,
                ..Default::default()
            },
        );
        note(
            &live_state,
            &SensorSample {
                drive: 2,
                stale_ticks: 7,
                ..Default::default()
            },
        );
        let LiveState {
            singularities,
            phase,
            drive,
            stale_ticks,
            ..
        } = live_state.read();
        assert_eq!(
            (singularities.len(), phase, drive, stale_ticks),
            (2, 1, 2, 7)
        );
        let LiveSingularity {
            kind,
            class,
            is_inside,
            s,
            mode,
        } = singularities[1];
        assert_eq!((kind, class, is_inside, s, mode), (3, 0, true, -0.25, 5));
    }
}
