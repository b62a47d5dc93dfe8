//! Live statistics of a running graph on the control page: distributions of times and latest values, each written by its owner.
//!
//! A reader (`armplane top`) costs the writers nothing: no port, no connection, no lock, no system call. Each number has one writer.

use std::any::Any;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use shared_types::{
    ControlState, MAX_SINGULARITIES, Message, SensorSample, ServoState, SingularityReport,
    TorqueCommand,
};

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
    #[must_use]
    pub fn count(&self) -> u64 {
        self.counts
            .iter()
            .fold(0, |sum: u64, count| sum.saturating_add(*count))
    }

    /// The difference to an earlier snapshot; the longest stays that of the whole run.
    #[must_use]
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
    #[must_use]
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
    #[must_use]
    pub fn longest_us(&self) -> f64 {
        self.longest_ns as f64 * 1e-3
    }
}

/// The latest values for observers of the run: each topic's writer stores its own.
#[repr(C, align(64))]
#[derive(Debug, Default)]
pub(crate) struct LiveStateCells {
    singularities: AtomicU32,
    kind: [AtomicU32; MAX_SINGULARITIES],
    class: [AtomicU32; MAX_SINGULARITIES],
    inside: [AtomicU32; MAX_SINGULARITIES],
    s: [AtomicU64; MAX_SINGULARITIES],
    mode: [AtomicU32; MAX_SINGULARITIES],
    phase: AtomicU32,
    drive: AtomicU32,
    stale_ticks: AtomicU32,
    /// Reason, joint, its side, nearest singularity, targets refused.
    servo: [AtomicU32; 5],
    /// Openness of that singularity, and speed.
    servo_share: [AtomicU64; 2],
}

impl LiveStateCells {
    /// Stores a message's values; the topic is known at compile time.
    #[inline]
    pub(crate) fn note<M: Message>(&self, message: &M) {
        let message: &dyn Any = message;
        if let Some(report) = message.downcast_ref::<SingularityReport>() {
            self.singularities.store(report.count, Ordering::Relaxed);
            for (index, one) in report.singularities.iter().enumerate() {
                self.kind[index].store(one.kind, Ordering::Relaxed);
                self.class[index].store(one.class, Ordering::Relaxed);
                self.inside[index].store(one.inside, Ordering::Relaxed);
                self.s[index].store(one.s.to_bits(), Ordering::Relaxed);
            }
        } else if let Some(command) = message.downcast_ref::<TorqueCommand>() {
            self.phase.store(command.phase, Ordering::Relaxed);
        } else if let Some(state) = message.downcast_ref::<ControlState>() {
            self.mode
                .iter()
                .zip(state.mode)
                .for_each(|(shown, mode)| shown.store(mode, Ordering::Relaxed));
        } else if let Some(state) = message.downcast_ref::<ServoState>() {
            let codes = [
                state.reason,
                state.joint,
                state.upper,
                state.singularity,
                state.refused,
            ];
            self.servo
                .iter()
                .zip(codes)
                .for_each(|(shown, code)| shown.store(code, Ordering::Relaxed));
            let shares = [state.nearest, state.speed_scale];
            self.servo_share
                .iter()
                .zip(shares)
                .for_each(|(shown, share)| shown.store(share.to_bits(), Ordering::Relaxed));
        } else if let Some(sample) = message.downcast_ref::<SensorSample>() {
            self.drive.store(sample.drive, Ordering::Relaxed);
            self.stale_ticks
                .store(sample.stale_ticks, Ordering::Relaxed);
        }
    }

    pub(crate) fn read(&self) -> LiveState {
        let count = (self.singularities.load(Ordering::Relaxed) as usize).min(MAX_SINGULARITIES);
        let singularity = |index: usize| LiveSingularity {
            kind: self.kind[index].load(Ordering::Relaxed),
            class: self.class[index].load(Ordering::Relaxed),
            is_inside: self.inside[index].load(Ordering::Relaxed) != 0,
            s: f64::from_bits(self.s[index].load(Ordering::Relaxed)),
            mode: self.mode[index].load(Ordering::Relaxed),
        };
        let [reason, joint, upper, nearest, refused] =
            std::array::from_fn(|i| self.servo[i].load(Ordering::Relaxed));
        let [openness, speed_scale] =
            std::array::from_fn(|i| f64::from_bits(self.servo_share[i].load(Ordering::Relaxed)));
        LiveState {
            servo: ServoState {
                reason,
                joint,
                upper,
                singularity: nearest,
                refused,
                nearest: openness,
                speed_scale,
                ..Default::default()
            },
            singularities: (0..count).map(singularity).collect(),
            phase: self.phase.load(Ordering::Relaxed),
            drive: self.drive.load(Ordering::Relaxed),
            stale_ticks: self.stale_ticks.load(Ordering::Relaxed),
        }
    }
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
    /// Of a steered run, as far as a line of text needs it; zero elsewhere.
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
        let (first, share) = (times.read(), |spread: &Distribution, share, us: f64| {
            (spread.quantile_us(share).unwrap() / us - 1.0).abs() < 0.07
        });
        assert!(first.count() == 1000 && share(&first, 0.5, 500.0) && share(&first, 0.99, 990.0));
        assert_eq!(
            (
                first.longest_us(),
                first.quantile_us(1.0).unwrap() <= 1000.0
            ),
            (1000.0, true)
        );
        (0..10).for_each(|_| times.record(5_000));
        let later = times.read().since(&first);
        assert!(later.count() == 10 && share(&later, 0.5, 5.0));
        assert_eq!(later.since(&later).quantile_us(0.5), None);
    }

    #[test]
    fn each_writer_notes_its_own() {
        let live_state = LiveStateCells::default();
        let mut report = SingularityReport {
            count: 2,
            ..SingularityReport::default()
        };
        (
            report.singularities[1].s,
            report.singularities[1].inside,
            report.singularities[1].kind,
        ) = (-0.25, 1, 3);
        let mut state = ControlState::default();
        state.mode[1] = 5;
        live_state.note(&report);
        live_state.note(&state);
        live_state.note(&TorqueCommand {
            phase: 1,
            ..TorqueCommand::default()
        });
        live_state.note(&SensorSample {
            drive: 2,
            stale_ticks: 7,
            ..SensorSample::default()
        });
        let seen = live_state.read();
        assert_eq!(
            (
                seen.singularities.len(),
                seen.phase,
                seen.drive,
                seen.stale_ticks
            ),
            (2, 1, 2, 7)
        );
        assert_eq!(
            seen.singularities[1],
            LiveSingularity {
                kind: 3,
                class: 0,
                is_inside: true,
                s: -0.25,
                mode: 5
            }
        );
    }
}
