//! Histograms that outlive their process.

/// Counts of values, 32 bits wide: a sample per tick fills one after 49 days at 1 kHz.
pub(super) type Histogram = hdrhistogram::Histogram<u32>;

/// An empty histogram of 3 significant digits. It grows with its largest sample, so that none is left out: room for 100 s from the beginning is
/// 4 MB of memory in all, which the recorder of a short run touches only to clear it.
pub(super) fn new() -> Histogram {
    Histogram::new(3).expect("3 digits are valid")
}

/// A histogram as the values in it and how often each occurred.
pub(super) mod stored {
    use super::{Histogram, new};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(in super::super) type Values = Vec<(u64, u32)>;

    pub(in super::super) fn values(histogram: &Histogram) -> Values {
        histogram
            .iter_recorded()
            .map(|one| (one.value_iterated_to(), one.count_at_value()))
            .collect()
    }

    pub(in super::super) fn of(values: Values) -> Histogram {
        let mut histogram = new();
        values
            .into_iter()
            .for_each(|(value, count)| histogram.saturating_record_n(value, count));
        histogram
    }

    pub(in super::super) fn serialize<S: Serializer>(
        histogram: &Histogram,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        values(histogram).serialize(serializer)
    }

    pub(in super::super) fn deserialize<'a, D: Deserializer<'a>>(
        deserializer: D,
    ) -> Result<Histogram, D::Error> {
        Values::deserialize(deserializer).map(of)
    }
}
