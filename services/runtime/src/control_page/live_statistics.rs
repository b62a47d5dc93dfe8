//! Live statistics of a running graph on the control page: distributions of times, each written by its owner.
//!
//! Readers (`armplane top`) cost the writers nothing: no port, connection, lock or system call.
//! Each number has one writer.

use std::sync::atomic::{AtomicU64, Ordering};

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
}
