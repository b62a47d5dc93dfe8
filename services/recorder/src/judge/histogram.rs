//! Histograms that outlive their process.

use serde::{Deserialize, Serialize};

/// Counts of values, 32 bits wide: a sample per tick fills one after 49 days at 1 kHz. A checkpoint has the values and how often each occurred.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(from = "Values", into = "Values")]
pub(super) struct Histogram(pub(super) hdrhistogram::Histogram<u32>);

type Values = Vec<(u64, u32)>;

impl Default for Histogram {
    /// An empty one of 3 significant digits. It grows with its largest sample, so that none is left out: room for 100 s from the beginning is
    /// 4 MB of memory in all, which the recorder of a short run touches only to clear it.
    fn default() -> Self {
        Self(hdrhistogram::Histogram::new(3).expect("3 digits are valid"))
    }
}

impl From<Histogram> for Values {
    fn from(Histogram(histogram): Histogram) -> Self {
        let values = histogram.iter_recorded();
        values
            .map(|one| (one.value_iterated_to(), one.count_at_value()))
            .collect()
    }
}

impl From<Values> for Histogram {
    fn from(values: Values) -> Self {
        let mut histogram = Self::default();
        for (value, count) in values {
            histogram.0.saturating_record_n(value, count);
        }
        histogram
    }
}
