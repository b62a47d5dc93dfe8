//! Most unread messages of a topic, by their size.

use crate::bus::format::Format;
use crate::context::CHAIN_LAG;
use crate::manifest::Manifest;

/// Messages a reader of the chain can leave unread before the oldest is overwritten: twice as many as the source may be ahead.
pub(crate) const CHAIN_DEPTH: usize = 2 * CHAIN_LAG as usize;
/// Messages the recorder can leave unread before the oldest is overwritten, and in real time those that its replacement gets once more; fewer where
/// they are large: [`depth`].
pub(crate) const RECORDER_DEPTH: usize = 1024;
/// Bytes that unread messages of one reader may take, as far as that leaves [`LEAST_DEPTH`] of them.
const UNREAD_BYTES: usize = 16 << 20;
const LEAST_DEPTH: usize = 16;

/// Messages of a size that a reader of everything can leave unread: [`RECORDER_DEPTH`] up to 16 KiB, 64 of 256 KiB, 16 of 1 MiB and more.
pub(crate) const fn depth(message_bytes: usize) -> usize {
    let fitting = UNREAD_BYTES / if message_bytes == 0 { 1 } else { message_bytes };
    if fitting > RECORDER_DEPTH {
        RECORDER_DEPTH
    } else if fitting < LEAST_DEPTH {
        LEAST_DEPTH
    } else {
        fitting
    }
}

/// The least depth of all topics of a run: of the largest message.
pub(crate) fn least_depth(manifest: &Manifest) -> usize {
    let topics = manifest.topics().into_iter();
    let formats = topics.filter_map(|topic| Format::in_run(manifest, topic));
    let depths = formats.map(|format| depth(format.bytes));
    depths.min().unwrap_or(RECORDER_DEPTH)
}
