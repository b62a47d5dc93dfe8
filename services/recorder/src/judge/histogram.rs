//! Histograms of durations.

/// Counts of values, 32 bits wide: a sample per tick fills one after 49 days at 1 kHz.
#[derive(Clone, Debug)]
pub(super) struct Histogram(pub(super) hdrhistogram::Histogram<u32>);

impl Default for Histogram {
    /// An empty one of 3 significant digits. It grows with its largest sample, so that none is left out: room for 100 s from the beginning is
    /// 4 MB of memory in all, which the recorder of a short run touches only to clear it.
    fn default() -> Self {
        Self(hdrhistogram::Histogram::new(3).expect("3 digits are valid"))
    }
}
