//! Histograms that outlive their process.

use hdrhistogram::Histogram;

/// An empty histogram of 3 significant digits, up to 100 s in ns; it resizes by itself beyond, so that no sample is left out.
pub(super) fn new() -> Histogram<u64> {
    let mut histogram = Histogram::new_with_bounds(1, 100_000_000_000, 3).expect("constant bounds are valid");
    histogram.auto(true);
    histogram
}

/// A histogram as the values in it and how often each occurred.
pub(super) mod stored {
    use super::{Histogram, new};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(in super::super) type Values = Vec<(u64, u64)>;

    pub(in super::super) fn values(histogram: &Histogram<u64>) -> Values {
        histogram.iter_recorded().map(|one| (one.value_iterated_to(), one.count_at_value())).collect()
    }

    pub(in super::super) fn of(values: Values) -> Histogram<u64> {
        let mut histogram = new();
        values.into_iter().for_each(|(value, count)| histogram.saturating_record_n(value, count));
        histogram
    }

    pub(in super::super) fn serialize<S: Serializer>(histogram: &Histogram<u64>, serializer: S) -> Result<S::Ok, S::Error> {
        values(histogram).serialize(serializer)
    }

    pub(in super::super) fn deserialize<'a, D: Deserializer<'a>>(deserializer: D) -> Result<Histogram<u64>, D::Error> {
        Values::deserialize(deserializer).map(of)
    }
}
