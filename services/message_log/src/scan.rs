//! The blocks of a message log by their heads: which messages each holds, and what is wrong with their order.

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;

use crate::error::Defect;
use crate::head::{BlockHead, Identity, LONGEST};
use crate::shape::Place;

/// Bytes that are searched for the head of a block at a time.
const WINDOW: usize = 1 << 16;

/// A file of a fixed length.
pub(crate) struct Bytes {
    file: File,
    len: u64,
}

impl Bytes {
    pub(crate) fn of(file: File) -> io::Result<Self> {
        let len = file.metadata()?.len();
        Ok(Self { file, len })
    }

    /// Fills the buffer from a place on, as far as the file goes.
    pub(crate) fn read(&self, buffer: &mut [u8], from: u64) -> io::Result<usize> {
        let mut n = 0;
        while n < buffer.len() {
            match self.file.read_at(&mut buffer[n..], from + n as u64) {
                Ok(0) => break,
                Ok(more) => n += more,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(n)
    }

    /// The head of the block at a place; `None` where there is none that is as it was written.
    pub(crate) fn block_head(
        &self,
        from: u64,
        identity: Identity,
        message_bytes: usize,
    ) -> io::Result<Option<BlockHead>> {
        // Of a log of as many logs; then of any.
        for most in [identity.block_head(), LONGEST] {
            let mut head = vec![0; most];
            let n = self.read(&mut head, from)?;
            if let Some(found) = BlockHead::read(&head[..n], message_bytes) {
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    /// The first byte from `from` on at which the head of a block of this log, or of the same log of another run, begins.
    fn next_head(
        &self,
        from: u64,
        identity: Identity,
        message_bytes: usize,
    ) -> io::Result<Option<u64>> {
        let head = identity.block_head();
        let (mut window, mut begin) = (vec![0; WINDOW + head], from);
        loop {
            let n = self.read(&mut window, begin)?;
            let is_head = |at: &usize| {
                BlockHead::read(&window[*at..n.min(*at + head)], message_bytes)
                    .is_some_and(|found| found.is_like(identity))
            };
            if let Some(at) = (0..(n + 1).saturating_sub(head).min(WINDOW)).find(is_head) {
                return Ok(Some(begin + at as u64));
            }
            if n < window.len() {
                return Ok(None);
            }
            begin += WINDOW as u64;
        }
    }
}

/// A place of a log that is not as it was written.
#[derive(Clone, Debug)]
pub(crate) struct Flaw {
    pub(crate) defect: Defect,
    pub(crate) reason: String,
    /// Messages that are lost there.
    pub(crate) lost: u64,
    /// Tick of the first message of the block, where it is known.
    pub(crate) tick: Option<u64>,
}

impl Flaw {
    pub(crate) fn of(defect: Defect, reason: String) -> Self {
        Self {
            defect,
            reason,
            lost: 0,
            tick: None,
        }
    }
}

/// A block behind its head.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StoredBlock {
    /// Where its packed messages begin, and how many bytes they are.
    pub(crate) byte: u64,
    pub(crate) bytes: usize,
    pub(crate) messages: usize,
    pub(crate) checksum: u32,
    pub(crate) tick: u64,
}

/// The next thing that a reader comes to.
pub(crate) enum Entry {
    Block(StoredBlock),
    Flaw(Flaw),
}

/// The blocks of a log.
pub(crate) struct Scan {
    /// In the order in which they were written, and what is wrong before each.
    pub(crate) entries: VecDeque<Entry>,
    /// Behind the last block.
    pub(crate) tail: Vec<Flaw>,
    /// Messages in each log of the run, as the blocks tell.
    pub(crate) known: Vec<u64>,
    /// The place behind the last block.
    pub(crate) end: Place,
    /// The last block is the end that its writer gave it.
    pub(crate) is_ended: bool,
}

/// A block with the number of its first message, and what lies before it in the file.
struct Found {
    first: u64,
    block: StoredBlock,
    is_displaced: bool,
    before: Vec<Flaw>,
}

/// The heads of all blocks from a place on. The beginning of a block, at the end, of which the head is whole or ends early is what a killed writer leaves.
pub(crate) fn scan(
    bytes: &Bytes,
    from: Place,
    identity: Identity,
    message_bytes: usize,
) -> io::Result<Scan> {
    let (mut blocks, mut before, mut ranges) =
        (Vec::<Found>::new(), Vec::new(), BTreeMap::<u64, u64>::new());
    let (mut known, mut end, mut is_ended, mut most) = (
        vec![0; usize::from(identity.logs)],
        from,
        false,
        from.messages,
    );
    let mut place = from.byte;
    while bytes.len.saturating_sub(place) >= identity.block_head() as u64 {
        let head = bytes.block_head(place, identity, message_bytes)?;
        let whole = head
            .as_ref()
            .map(BlockHead::whole)
            .filter(|whole| *whole <= bytes.len - place);
        let (Some(head), Some(whole)) = (&head, whole) else {
            let next = bytes.next_head(place + 1, identity, message_bytes)?;
            let is_torn = head.is_some() && next.is_none();
            if !is_torn {
                let lack = if head.is_some() {
                    "its end is missing"
                } else {
                    "its head is damaged"
                };
                let reason = format!("the block at byte {place} is not what was written: {lack}");
                before.push(Flaw {
                    tick: head.map(|head| head.tick),
                    ..Flaw::of(Defect::Damaged, reason)
                });
            }
            match next {
                Some(next) => place = next,
                None => break,
            }
            continue;
        };
        let (first, last, byte) = (
            head.first,
            head.first.saturating_add(head.messages as u64),
            place,
        );
        let flaw = |defect, words: &str| Flaw {
            tick: Some(head.tick),
            ..Flaw::of(defect, format!("the block at byte {byte} {words}"))
        };
        place += whole;
        if !head.is_of(identity) {
            let (defect, words) = match head.run == identity.run {
                true => (Defect::OtherLog, "is of another log of its run"),
                false => (Defect::OtherRun, "is of another run"),
            };
            before.push(flaw(defect, words));
            continue;
        }
        known
            .iter_mut()
            .zip(&head.known)
            .for_each(|(known, other)| *known = (*known).max(*other));
        is_ended = head.messages == 0;
        if is_ended {
            continue;
        }
        let is_held = ranges
            .range(..=first)
            .next_back()
            .is_some_and(|(_, end)| *end > first)
            || ranges.range(first..last).next().is_some();
        if is_held || first < from.messages {
            before.push(flaw(
                Defect::Repeated,
                "repeats messages that stand before it",
            ));
            continue;
        }
        let is_displaced = first < most;
        if is_displaced {
            before.push(flaw(
                Defect::Displaced,
                "stands behind blocks that were written after it",
            ));
        }
        ranges.insert(first, last);
        most = most.max(last);
        end.byte = place;
        let head_bytes = head.bytes() as u64;
        let block = StoredBlock {
            byte: byte + head_bytes,
            bytes: head.packed,
            messages: head.messages,
            checksum: head.body,
            tick: head.tick,
        };
        blocks.push(Found {
            first,
            block,
            is_displaced,
            before: std::mem::take(&mut before),
        });
    }
    end.messages = most;
    Ok(Scan {
        entries: in_order(blocks, from.messages),
        tail: before,
        known,
        end,
        is_ended,
    })
}

/// The blocks in the order in which they were written, with what is wrong before each, and the messages that are missing there.
fn in_order(mut blocks: Vec<Found>, begin: u64) -> VecDeque<Entry> {
    blocks.sort_by_key(|found| found.first);
    let (mut entries, mut next) = (VecDeque::new(), begin);
    for Found {
        first,
        block,
        is_displaced,
        mut before,
    } in blocks
    {
        let lost = first.saturating_sub(next);
        if lost > 0 {
            // A damaged or foreign block lies where they were, unless this one has come from elsewhere.
            let is_cause = |flaw: &&mut Flaw| {
                !is_displaced
                    && matches!(
                        flaw.defect,
                        Defect::Damaged | Defect::OtherRun | Defect::OtherLog
                    )
            };
            match before.iter_mut().find(is_cause) {
                Some(cause) => cause.lost = lost,
                None => before.insert(
                    0,
                    Flaw {
                        lost,
                        ..Flaw::of(
                            Defect::Missing,
                            format!("{lost} of its messages are missing, from number {next} on"),
                        )
                    },
                ),
            }
        }
        entries.extend(before.into_iter().map(Entry::Flaw));
        entries.push_back(Entry::Block(block));
        next = first.saturating_add(block.messages as u64);
    }
    entries
}
