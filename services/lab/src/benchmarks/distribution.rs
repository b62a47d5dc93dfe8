//! Distributions of times, and the rows of the result that show them.

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// A distribution of times; µs, no sample left out.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Distribution {
    /// Number of samples.
    pub samples: u64,
    /// Median, µs.
    pub p50_us: f64,
    /// 99th percentile, µs.
    pub p99_us: f64,
    /// 99.9th percentile, µs.
    pub p999_us: f64,
    /// Largest, µs.
    pub max_us: f64,
    /// For the picture: (−log₁₀ of the share of samples above it, time; µs).
    pub curve: Vec<(f64, f64)>,
}

/// Points of a curve per power of ten.
const PER_DECADE: u32 = 12;

impl Distribution {
    /// The distribution of a histogram of nanoseconds.
    pub fn of(nanoseconds: &Histogram<u64>) -> Self {
        let at = |quantile| nanoseconds.value_at_quantile(quantile) as f64 / 1e3;
        let decades = (nanoseconds.len().max(1) as f64).log10();
        let nines = (0..=(decades * f64::from(PER_DECADE)) as u32)
            .map(|step| f64::from(step) / f64::from(PER_DECADE));
        Self {
            samples: nanoseconds.len(),
            p50_us: at(0.5),
            p99_us: at(0.99),
            p999_us: at(0.999),
            max_us: nanoseconds.max() as f64 / 1e3,
            curve: nines
                .map(|nines| (nines, at(1.0 - 10_f64.powf(-nines))))
                .collect(),
        }
    }

    /// Each time divided by `n`.
    pub fn divided_by(mut self, n: f64) -> Self {
        for time in [
            &mut self.p50_us,
            &mut self.p99_us,
            &mut self.p999_us,
            &mut self.max_us,
        ] {
            *time /= n;
        }
        self.curve.iter_mut().for_each(|point| point.1 /= n);
        self
    }
}

/// Nanoseconds up to 100 s, three digits.
pub(super) fn histogram() -> Histogram<u64> {
    #[allow(clippy::expect_used, reason = "the bounds are constants")]
    Histogram::new_with_bounds(1, 100_000_000_000, 3).expect("constant bounds are valid")
}

/// One line of the result.
pub struct Row {
    /// Name of the benchmark.
    pub bench: String,
    /// Transport or step measured.
    pub mechanism: String,
    /// Cores of the two ends.
    pub placement: String,
    /// Bytes of the message, or of all messages of a cycle; 0 where there is none.
    pub payload_bytes: usize,
    /// Times.
    pub distribution: Distribution,
    /// Against the baseline of the same bench, placement and payload; none where there is no baseline.
    pub ratio_p50: Option<f64>,
    /// 99th percentile over that of the futex of the same placement and payload.
    pub ratio_p99: Option<f64>,
}

impl Row {
    /// A row without a baseline.
    pub fn alone(bench: &str, mechanism: &str, distribution: Distribution) -> Self {
        let (bench, mechanism, placement) = (
            bench.to_owned(),
            mechanism.to_owned(),
            "one thread".to_owned(),
        );
        Self {
            bench,
            mechanism,
            placement,
            payload_bytes: 0,
            distribution,
            ratio_p50: None,
            ratio_p99: None,
        }
    }

    /// As JSON.
    pub fn json(&self) -> serde_json::Value {
        let Distribution {
            samples,
            p50_us,
            p99_us,
            p999_us,
            max_us,
            ..
        } = self.distribution;
        json!({
            "bench": self.bench, "mechanism": self.mechanism, "placement": self.placement, "payload_bytes": self.payload_bytes,
            "samples": samples, "p50_us": p50_us, "p99_us": p99_us, "p999_us": p999_us, "max_us": max_us,
            "ratio_p50": self.ratio_p50, "ratio_p99": self.ratio_p99,
        })
    }
}
