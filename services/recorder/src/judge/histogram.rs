//! Histograms of durations.

use hdrhistogram::Histogram;

/// An empty one of 3 significant digits. It grows with its largest sample, so that none is left out: room for 100 s from the beginning is 4 MB of memory
/// in all, which the recorder of a short run touches only to clear it. Counts have 32 bits: a sample per tick fills one after 49 days at 1 kHz.
pub(super) fn histogram() -> Histogram<u32> {
    Histogram::new(3).expect("3 digits are valid")
}
