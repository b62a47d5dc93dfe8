//! The longest distance between checkpoints of a process that reads every message. PURE.

/// The most ticks from one checkpoint of the recorder to the next, where the run may be `most_ahead` of it, and a block of a message log holds `block`
/// messages; `usual` where the logs have all that a replacement needs.
///
/// A replacement finds messages in the message logs or in the retainers. Those that are in no log, because none is kept, or because a block of large
/// messages is more than the retainers hold, are in the retainers alone: a checkpoint comes before those have let go of them. They hold four times
/// `most_ahead`; the recorder may take in as much in one round, and the run be as much ahead of it when that ends.
pub const fn most_ticks_unsaved(are_kept: bool, most_ahead: u64, block: u64, usual: u64) -> u64 {
    if are_kept && most_ahead >= block {
        usual
    } else {
        most_ahead
    }
}
